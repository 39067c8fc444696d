//! Pose and vector parameters.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::geometry::unit_quaternion;
use crate::ros::Declare;

/// Declares and reads `PREFIX.position` and `PREFIX.orientation`, a pose in the world. If `optional`, the position may
/// be empty, which is the default; then the result is `None`.
///
/// # Errors
/// A line that names the parameter if the orientation is not a unit quaternion.
pub fn declare_pose(
    declare: &mut Declare,
    prefix: &str,
    what: &str,
    optional: bool,
) -> Result<Option<Isometry3<f64>>, String> {
    let default: &[f64] = if optional { &[] } else { &[0.0; 3] };
    let none = if optional { "; empty is none" } else { "" };
    let position = declare
        .param(
            &format!("{prefix}.position"),
            default.to_vec(),
            &format!("Position of the {what} in the world at the start [m]{none}"),
        )
        .read_only()
        .check(&format!("3 finite numbers{none}"), move |v| {
            if optional && v.is_empty() {
                Ok(())
            } else {
                finite(v, 3)
            }
        })
        .value();
    let rotation = declare_orientation(
        declare,
        &format!("{prefix}.orientation"),
        &format!("Attitude of the {what} in the world at the start (x, y, z, w)"),
    )?;
    let translation = match position.as_slice() {
        &[x, y, z] => Translation3::new(x, y, z),
        _ => return Ok(None),
    };
    Ok(Some(Isometry3::from_parts(translation, rotation)))
}

/// Declares and reads a unit quaternion (x, y, z, w); the default is no rotation.
///
/// # Errors
/// A line that names the parameter if its norm is not 1.
pub fn declare_orientation(
    declare: &mut Declare,
    name: &str,
    description: &str,
) -> Result<UnitQuaternion<f64>, String> {
    let values = declare
        .param(name, [0.0, 0.0, 0.0, 1.0], description)
        .read_only()
        .check("4 finite numbers, norm 1", |v| finite(v, 4))
        .value();
    match values.as_slice() {
        &[x, y, z, w] => unit_quaternion(x, y, z, w).map_err(|e| format!("parameter {name}: {e}")),
        // A wrong length has been reported by the declaration.
        _ => Ok(UnitQuaternion::identity()),
    }
}

/// Declares and reads a vector of three finite numbers; the default is zero.
pub fn declare_vector(declare: &mut Declare, name: &str, description: &str) -> Vector3<f64> {
    let values = declare
        .param(name, [0.0; 3], description)
        .read_only()
        .check("3 finite numbers", |v| finite(v, 3))
        .value();
    match values.as_slice() {
        &[x, y, z] => Vector3::new(x, y, z),
        // A wrong length has been reported by the declaration.
        _ => Vector3::zeros(),
    }
}

/// Checks that a list consists of `length` finite numbers.
///
/// # Errors
/// A line with the list and its expected form.
pub fn finite(values: &[f64], length: usize) -> Result<(), String> {
    if values.len() == length && values.iter().all(|x| x.is_finite()) {
        Ok(())
    } else {
        Err(format!(
            "{values:?} is wrong; expected {length} finite numbers"
        ))
    }
}
