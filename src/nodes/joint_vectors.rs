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

/// Speeds of wheels in the order of `names` \[rad/s\].
///
/// # Errors
/// Names the wheel that is missing.
pub fn wheel_speeds<'a>(
    names: impl IntoIterator<Item = &'a str>,
    message: &JointState,
) -> Result<Vec<f64>, String> {
    let speed = |name: &str| {
        let at = message.name.iter().position(|known| known == name);
        let value = at.and_then(|at| message.velocity.get(at)).copied();
        value.ok_or_else(|| format!("has no velocity for wheel '{name}'"))
    };
    names.into_iter().map(speed).collect()
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
