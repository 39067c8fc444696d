//! Least-norm solution within the span of the actuators' torques.

use nalgebra::{Matrix3, Vector3};

/// Eigenvalues of `A Aᵀ` above this count as torque about an axis, for columns of A of length near 1.
pub const SPAN: f64 = 1e-9;

/// Least-norm solution of `gram x = right` for a positive semidefinite `gram`, ignoring the part of `right` outside its
/// range.
pub fn solve_within_span(gram: &Matrix3<f64>, right: &Vector3<f64>) -> Vector3<f64> {
    let eigen = gram.symmetric_eigen();
    let axes = eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter());
    axes.filter(|(value, _)| **value > SPAN)
        .map(|(value, axis)| axis * (axis.dot(right) / value))
        .sum()
}
