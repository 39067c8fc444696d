//! Identification of a free body from known pushes: the change of its motion by an impulse.

use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};

use super::linear::{Excitation, IdentificationError, Scaled};
use super::parameters::{InertiaParameters, unit_inertia};
use crate::spatial::Twist;

/// A known impulse on a free body, and the change of its motion; world axes. The body's frame is that of the result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Push {
    /// Attitude of the body's frame.
    pub R_WF: UnitQuaternion<f64>,
    /// The impulse \[N s\].
    pub impulse: Vector3<f64>,
    /// Where it acts, from the frame's origin \[m\].
    pub at: Vector3<f64>,
    /// An impulse of torque in addition \[N m s\].
    pub couple: Vector3<f64>,
    /// Change of the frame's twist.
    pub change: Twist,
}

/// Identifies a body from pushes. Three in different directions at different points determine everything.
///
/// # Errors
/// [`IdentificationError`] with the number of parameters that the pushes determine.
pub fn identify_from_pushes(
    pushes: &[Push],
) -> Result<(InertiaParameters, Excitation), IdentificationError> {
    let mut matrix = DMatrix::zeros(6 * pushes.len().max(2), 10);
    let mut rhs = DVector::zeros(matrix.nrows());
    for (k, push) in pushes.iter().enumerate() {
        let to_body = push.R_WF.inverse();
        let [impulse, at, couple, du, dw] = [
            push.impulse,
            push.at,
            push.couple,
            push.change.linear,
            push.change.angular,
        ]
        .map(|v| to_body * v);
        let row = 6 * k;
        // m Δu + Δw × mc = j and mc × Δu + I Δw = s × j + n.
        matrix.fixed_view_mut::<3, 1>(row, 0).copy_from(&du);
        matrix
            .fixed_view_mut::<3, 3>(row, 1)
            .copy_from(&dw.cross_matrix());
        matrix
            .fixed_view_mut::<3, 3>(row + 3, 1)
            .copy_from(&-du.cross_matrix());
        for i in 0..6 {
            matrix
                .fixed_view_mut::<3, 1>(row + 3, 4 + i)
                .copy_from(&(unit_inertia(i) * dw));
        }
        rhs.fixed_rows_mut::<3>(row).copy_from(&impulse);
        rhs.fixed_rows_mut::<3>(row + 3)
            .copy_from(&(at.cross(&impulse) + couple));
    }
    let scaled = Scaled::new(matrix);
    scaled.check()?;
    let solution = scaled.solve(&rhs);
    let inertia = InertiaParameters::from_vector(&solution.fixed_rows::<10>(0).into_owned());
    Ok((inertia, scaled.excitation))
}
