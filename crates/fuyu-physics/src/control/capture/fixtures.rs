//! Bodies of the unit tests.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::estimation::free_body::FreeRotation;

/// A body that tumbles at some 3 deg/s, in closed form.
pub(in crate::control::capture) fn tumbling() -> FreeRotation {
    let inertia = Matrix3::from_diagonal(&Vector3::new(94.2, 53.8, 40.4));
    let rate = Vector3::new(0.03, 0.02, 0.04);
    let attitude = UnitQuaternion::from_euler_angles(0.3, -0.5, 0.8);
    FreeRotation::new(&inertia, attitude, &rate, 0.0).unwrap()
}

/// Fails if the vectors differ by more than `tolerance`.
#[track_caller]
pub(in crate::control::capture) fn within(a: &Vector3<f64>, b: &Vector3<f64>, tolerance: f64) {
    assert!((a - b).norm() <= tolerance, "{a} is not {b}");
}
