//! Mobility of the tip of a free-floating robot (inverse of its inertia against a wrench), and its effective mass.

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, Vector3, Vector6};

use super::tip_impedance::stacked;
use crate::dynamics::{Momentum, Workspace};
use crate::model::Frame;
use crate::spatial::Twist;

/// Inverse of the tip's inertia against a wrench at the tip (linear first, base axes) at the positions of `workspace`:
/// `Ĵ Ĥ⁻¹ Ĵᵀ` (O. Khatib, Inertial properties in robotic manipulation, Int. J. Robotics Research 14, 1995; for a
/// free-floating robot K. Yoshida and N. Sashida, 1993) plus the mobility of the base with locked joints.
fn mobility(
    workspace: &mut Workspace,
    (tip, jacobian): (&Frame, &mut Matrix6xX<f64>),
) -> Matrix6<f64> {
    let n = jacobian.ncols();
    workspace.generalized_jacobian(tip, jacobian);
    let H = workspace.reduced_inertia().clone();
    let mut mobility = Matrix6::zeros();
    if let Some(factor) = H.cholesky() {
        let J = DMatrix::from_fn(6, n, |r, c| jacobian[(r, c)]);
        mobility.copy_from(&(&J * factor.solve(&J.transpose())));
    }
    // Response of the base with its locked arm to unit wrenches at the tip, which act as momenta.
    let at_rest = DVector::zeros(n);
    let p_BE = workspace.X_BF(tip).translation.vector;
    let p_CE = p_BE - workspace.p_BC();
    for k in 0..6 {
        let mut wrench = Vector6::zeros();
        wrench[k] = 1.0;
        let force = Vector3::from(wrench.fixed_rows::<3>(0));
        let couple = Vector3::from(wrench.fixed_rows::<3>(3));
        let momentum = Momentum {
            linear: force,
            angular: couple + p_CE.cross(&force),
        };
        let base = workspace.base_twist(&momentum, &at_rest);
        let of_tip = Twist::new(base.angular, base.linear + base.angular.cross(&p_BE));
        let mut column = mobility.column_mut(k);
        column += stacked(&of_tip);
    }
    mobility
}

/// Effective mass \[kg\] of the tip in an impact along `direction` (base axes) at the positions of `workspace`.
/// `jacobian` is overwritten.
pub(super) fn effective_mass(
    workspace: &mut Workspace,
    tip: (&Frame, &mut Matrix6xX<f64>),
    direction: &Vector3<f64>,
) -> f64 {
    let n = direction.normalize();
    let mobility = mobility(workspace, tip);
    1.0 / n.dot(&(mobility.fixed_view::<3, 3>(0, 0) * n))
}
