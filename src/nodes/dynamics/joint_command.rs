//! What arrives on `joint_commands`, checked before it may act.

use crate::{model::Model, msg::sensor_msgs::JointState};

/// Efforts, or rates, for some of the robot's joints.
#[derive(Debug, Clone, PartialEq)]
pub enum JointCommand {
    /// Joint index and effort \[N m or N\].
    Efforts(Vec<(usize, f64)>),
    /// Joint index and rate \[rad/s or m/s\].
    Rates(Vec<(usize, f64)>),
}

/// The largest values that a command may have.
#[derive(Debug, Clone, Copy)]
pub struct CommandLimits {
    /// Effort, `max_effort` \[N m or N\].
    pub effort: f64,
    /// Rate, `velocity_servo.max_rate` \[rad/s or m/s\].
    pub rate: f64,
}

impl JointCommand {
    /// Reads a message: efforts or rates by joint name; joints that it does not name keep theirs. Which of the two
    /// it commands is told by the list that it fills.
    ///
    /// # Errors
    /// A line that names what is wrong and what would be right; nothing of such a message acts.
    pub fn from_msg(
        message: &JointState,
        model: &Model,
        limits: CommandLimits,
    ) -> Result<Self, String> {
        if message.name.is_empty() {
            return Err(format!(
                "names no joint; expected some of {}",
                joint_names(model)
            ));
        }
        match (message.effort.is_empty(), message.velocity.is_empty()) {
            (false, false) => Err(
                "has both effort and velocity; a command is one or the other, so leave one list empty"
                    .to_owned(),
            ),
            (true, false) => {
                let limit = ("velocity_servo.max_rate", limits.rate);
                let words = ("velocity", "velocities");
                by_name(message, &message.velocity, model, words, limit).map(Self::Rates)
            }
            _ => {
                let limit = ("max_effort", limits.effort);
                let words = ("effort", "efforts");
                by_name(message, &message.effort, model, words, limit).map(Self::Efforts)
            }
        }
    }
}

/// Values by joint index, none beyond the limit of that name.
fn by_name(
    message: &JointState,
    values: &[f64],
    model: &Model,
    (one, many): (&str, &str),
    (limit_name, limit): (&str, f64),
) -> Result<Vec<(usize, f64)>, String> {
    if values.len() != message.name.len() {
        return Err(format!(
            "has {} names but {} {many}; give one {one} per name",
            message.name.len(),
            values.len()
        ));
    }
    let mut found: Vec<(usize, f64)> = Vec::with_capacity(message.name.len());
    for (name, &value) in message.name.iter().zip(values) {
        let Some(joint) = model.joint_index(name) else {
            return Err(format!(
                "names '{name}'; the robot has {}",
                joint_names(model)
            ));
        };
        // Not a number is not below it either.
        let sound = value.abs() <= limit;
        if !sound {
            return Err(format!(
                "gives joint '{name}' the {one} {value}; it must be finite and at most {limit} ({limit_name})"
            ));
        }
        if found.iter().any(|(seen, _)| *seen == joint) {
            return Err(format!("names joint '{name}' twice"));
        }
        found.push((joint, value));
    }
    Ok(found)
}

fn joint_names(model: &Model) -> String {
    let names: Vec<_> = model.joints().iter().map(|j| j.name.as_str()).collect();
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> Model {
        Model::from_urdf(include_str!("../../../urdf/planar_two_link.urdf"), "planar").unwrap()
    }

    fn message(names: &[&str], effort: &[f64]) -> JointState {
        JointState {
            name: names.iter().map(|&n| n.to_owned()).collect(),
            effort: effort.to_vec(),
            ..JointState::default()
        }
    }

    const LIMITS: CommandLimits = CommandLimits {
        effort: 1e6,
        rate: 100.0,
    };

    #[test]
    fn a_command_acts_by_name_in_any_order() {
        let efforts = message(&["joint2", "joint1"], &[2.0, -1.0]);
        let command = JointCommand::from_msg(&efforts, &model(), LIMITS).unwrap();
        assert_eq!(command, JointCommand::Efforts(vec![(1, 2.0), (0, -1.0)]));
        let rates = JointState {
            velocity: vec![0.1],
            ..message(&["joint2"], &[])
        };
        let command = JointCommand::from_msg(&rates, &model(), LIMITS).unwrap();
        assert_eq!(command, JointCommand::Rates(vec![(1, 0.1)]));
    }

    #[test]
    fn what_cannot_act_is_refused_with_the_reason() {
        let model = model();
        let refusal = |names: &[&str], effort: &[f64]| {
            JointCommand::from_msg(&message(names, effort), &model, LIMITS).unwrap_err()
        };
        assert!(refusal(&["elbow"], &[1.0]).contains("'elbow'; the robot has joint1, joint2"));
        assert!(refusal(&["joint1"], &[f64::NAN]).contains("joint 'joint1' the effort NaN"));
        assert!(refusal(&["joint1"], &[1e300]).contains("at most 1000000"));
        assert!(refusal(&["joint1", "joint2"], &[1.0]).contains("2 names but 1 efforts"));
        assert!(refusal(&["joint1", "joint1"], &[1.0, 2.0]).contains("twice"));
        assert!(refusal(&[], &[]).contains("names no joint"));
        let rates = |velocity: &[f64], effort: &[f64]| {
            let message = JointState {
                velocity: velocity.to_vec(),
                ..message(&["joint1"], effort)
            };
            JointCommand::from_msg(&message, &model, LIMITS).unwrap_err()
        };
        assert!(rates(&[f64::NAN], &[]).contains("joint 'joint1' the velocity NaN"));
        assert!(rates(&[101.0], &[]).contains("at most 100 (velocity_servo.max_rate)"));
        assert!(rates(&[1.0, 2.0], &[]).contains("1 names but 2 velocities"));
        assert!(rates(&[1.0], &[1.0]).contains("both effort and velocity"));
    }
}
