//! Joint vectors from messages, by joint name.

use nalgebra::DVector;

use crate::{model::Model, msg::sensor_msgs::JointState};

/// Joint positions in the model's order \[rad or m\].
///
/// # Errors
/// Names the joint that is missing or whose position is not finite.
pub fn positions(model: &Model, message: &JointState) -> Result<DVector<f64>, String> {
    by_name(model, &message.name, &message.position, "position")
}

/// Joint rates in the model's order \[rad/s or m/s\].
///
/// # Errors
/// Names the joint that is missing or whose rate is not finite.
pub fn velocities(model: &Model, message: &JointState) -> Result<DVector<f64>, String> {
    by_name(model, &message.name, &message.velocity, "velocity")
}

fn by_name(
    model: &Model,
    names: &[String],
    values: &[f64],
    what: &str,
) -> Result<DVector<f64>, String> {
    let mut vector = DVector::zeros(model.dof());
    for (slot, joint) in vector.iter_mut().zip(model.joints()) {
        let at = names.iter().position(|name| *name == joint.name);
        match at.and_then(|at| values.get(at)) {
            Some(value) if value.is_finite() => *slot = *value,
            Some(value) => {
                return Err(format!(
                    "joint '{}' has {what} {value}; it must be finite",
                    joint.name
                ));
            }
            None => return Err(format!("has no {what} for joint '{}'", joint.name)),
        }
    }
    Ok(vector)
}
