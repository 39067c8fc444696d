//! Identification from the motion of the base, its velocity included: momentum about a fixed point is linear in the
//! ten parameters.

use nalgebra::{DMatrix, DVector, Matrix6xX, UnitQuaternion, Vector3};

use super::linear::{Excitation, IdentificationError, Scaled};
use super::parameters::{InertiaParameters, unit_inertia};
use crate::dynamics::Workspace;
use crate::model::{Frame, Model};
use crate::spatial::Twist;

/// One measurement of the base's pose and twist, and of the joints.
#[derive(Debug, Clone, PartialEq)]
pub struct TwistSample {
    /// Attitude of the base.
    pub R_WB: UnitQuaternion<f64>,
    /// Position of the base's origin \[m\].
    pub p_WB: Vector3<f64>,
    /// Twist of the base, world axes.
    pub V_WB: Twist,
    /// Joint positions.
    pub q: DVector<f64>,
    /// Joint rates.
    pub qd: DVector<f64>,
}

/// Identifies the body that `robot` holds at `frame`, about that frame's origin in its axes, from the conservation
/// of linear and angular momentum, both unknown.
///
/// # Errors
/// [`IdentificationError`] if the motion does not determine all parameters.
pub fn identify_from_twists(
    robot: &Model,
    frame: &Frame,
    samples: &[TwistSample],
) -> Result<(InertiaParameters, Excitation), IdentificationError> {
    let mut workspace = Workspace::new(robot);
    let mut matrix = DMatrix::zeros(6 * samples.len(), 16);
    let mut rhs = DVector::zeros(6 * samples.len());
    let mut jacobian = Matrix6xX::zeros(robot.dof());
    for (k, sample) in samples.iter().enumerate() {
        if sample.q.len() != robot.dof() || sample.qd.len() != robot.dof() {
            let problem = "it must have one position and one rate per joint of the robot";
            return Err(IdentificationError::Sample { index: k, problem });
        }
        workspace.set_positions(&sample.q);
        let R_WB = sample.R_WB.to_rotation_matrix();
        let V_B = Twist::new(
            R_WB.inverse() * sample.V_WB.angular,
            R_WB.inverse() * sample.V_WB.linear,
        );
        let own = workspace.momentum_of(&V_B, &sample.qd);
        let p_WC = sample.p_WB + R_WB * workspace.p_BC();
        let p = R_WB * own.linear;
        let h = R_WB * own.angular + p_WC.cross(&p);
        let X_BF = workspace.X_BF(frame);
        workspace.fixed_base_jacobian(frame, &mut jacobian);
        let moving = &jacobian * &sample.qd;
        let arm = R_WB * X_BF.translation.vector;
        let (r, R) = (sample.p_WB + arm, (R_WB * X_BF.rotation).into_inner());
        let w = sample.V_WB.angular + R_WB * Vector3::from(moving.fixed_rows::<3>(3));
        let u = sample.V_WB.linear
            + sample.V_WB.angular.cross(&arm)
            + R_WB * Vector3::from(moving.fixed_rows::<3>(0));
        let [of_r, of_w, of_u] = [r, w, u].map(|v| v.cross_matrix());
        let row = 6 * k;
        let mut set = |column: usize, linear: Vector3<f64>, angular: Vector3<f64>| {
            matrix
                .fixed_view_mut::<3, 1>(row, column)
                .copy_from(&linear);
            matrix
                .fixed_view_mut::<3, 1>(row + 3, column)
                .copy_from(&angular);
        };
        set(0, u, r.cross(&u));
        let (of_moment, of_spin) = (of_w * R, (of_r * of_w - of_u) * R);
        for i in 0..3 {
            set(1 + i, of_moment.column(i).into(), of_spin.column(i).into());
            set(10 + i, -Vector3::ith(i, 1.0), Vector3::zeros());
            set(13 + i, Vector3::zeros(), -Vector3::ith(i, 1.0));
        }
        for i in 0..6 {
            set(
                4 + i,
                Vector3::zeros(),
                R * (unit_inertia(i) * R.tr_mul(&w)),
            );
        }
        rhs.fixed_rows_mut::<3>(row).copy_from(&-p);
        rhs.fixed_rows_mut::<3>(row + 3).copy_from(&-h);
    }
    let scaled = Scaled::new(matrix);
    scaled.check()?;
    let solution = scaled.solve(&rhs);
    let inertia = InertiaParameters::from_vector(&solution.fixed_rows::<10>(0).into_owned());
    Ok((inertia, scaled.excitation))
}
