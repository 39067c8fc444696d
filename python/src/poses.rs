//! Poses from and to numpy: a position and a quaternion (x, y, z, w).

use fuyu::spatial::Pose;
use nalgebra::{IsometryMatrix3, Quaternion, Translation3, UnitQuaternion};
use numpy::PyArray1;
use pyo3::prelude::*;

use crate::arrays::{Given, array, numbers, vector};
use crate::error::input;

/// Largest deviation of a quaternion's norm from one.
const NORM_TOLERANCE: f64 = 1e-6;

/// Position and quaternion of a pose, as new arrays.
pub type PoseArrays<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// A rotation from its quaternion; `None` is no rotation.
pub fn rotation(name: &str, given: Option<&Given<'_>>) -> PyResult<UnitQuaternion<f64>> {
    unit_quaternion(
        &format!("`{name}`"),
        numbers(name, given, [0.0, 0.0, 0.0, 1.0])?,
    )
}

/// The rotation of a quaternion x, y, z, w.
pub fn unit_quaternion(name: &str, [x, y, z, w]: [f64; 4]) -> PyResult<UnitQuaternion<f64>> {
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    if (norm - 1.0).abs() > NORM_TOLERANCE {
        return Err(input(format!(
            "{name} has the norm {norm}; a rotation is a quaternion x, y, z, w of norm 1"
        )));
    }
    Ok(UnitQuaternion::new_normalize(quaternion))
}

/// A pose from position \[m\] and quaternion.
pub fn pose(name: &str, position: &Given<'_>, orientation: &Given<'_>) -> PyResult<Pose> {
    let p = vector(&format!("{name} position"), Some(position))?;
    let R = rotation(&format!("{name} orientation"), Some(orientation))?;
    Ok(IsometryMatrix3::from_parts(
        Translation3::from(p),
        R.to_rotation_matrix(),
    ))
}

/// Position \[m\] and quaternion of `pose`.
pub fn pose_arrays<'py>(py: Python<'py>, pose: &Pose) -> PoseArrays<'py> {
    let q = UnitQuaternion::from_rotation_matrix(&pose.rotation);
    (
        array(py, pose.translation.vector.as_slice()),
        array(py, q.coords.as_slice()),
    )
}
