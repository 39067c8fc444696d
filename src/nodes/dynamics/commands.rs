//! What arrives on `joint_commands`, checked before it may act.

use crate::{model::Model, msg::sensor_msgs::JointState};

/// Efforts for some of the robot's joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Command {
    /// Joint index and effort \[N m or N\].
    pub efforts: Vec<(usize, f64)>,
}

impl Command {
    /// Reads a message: efforts by joint name, at most `max_effort` \[N m or N\]; joints that it does not name
    /// keep theirs.
    ///
    /// # Errors
    /// A line that names what is wrong and what would be right; nothing of such a message acts.
    pub fn from_msg(message: &JointState, model: &Model, max_effort: f64) -> Result<Self, String> {
        if message.name.is_empty() {
            return Err(format!(
                "names no joint; expected some of {}",
                joint_names(model)
            ));
        }
        if message.effort.len() != message.name.len() {
            return Err(format!(
                "has {} names but {} efforts; give one effort per name",
                message.name.len(),
                message.effort.len()
            ));
        }
        let mut efforts: Vec<(usize, f64)> = Vec::with_capacity(message.name.len());
        for (name, &effort) in message.name.iter().zip(&message.effort) {
            let Some(joint) = model.joint_index(name) else {
                return Err(format!(
                    "names '{name}'; the robot has {}",
                    joint_names(model)
                ));
            };
            // Not a number is not below it either.
            let sound = effort.abs() <= max_effort;
            if !sound {
                return Err(format!(
                    "gives joint '{name}' the effort {effort}; it must be finite and at most {max_effort} (max_effort)"
                ));
            }
            if efforts.iter().any(|(seen, _)| *seen == joint) {
                return Err(format!("names joint '{name}' twice"));
            }
            efforts.push((joint, effort));
        }
        Ok(Self { efforts })
    }
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

    #[test]
    fn a_command_acts_by_name_in_any_order() {
        let command =
            Command::from_msg(&message(&["joint2", "joint1"], &[2.0, -1.0]), &model(), 1e6);
        assert_eq!(command.unwrap().efforts, [(1, 2.0), (0, -1.0)]);
    }

    #[test]
    fn what_cannot_act_is_refused_with_the_reason() {
        let model = model();
        let refusal = |names: &[&str], effort: &[f64]| {
            Command::from_msg(&message(names, effort), &model, 1e6).unwrap_err()
        };
        assert!(refusal(&["elbow"], &[1.0]).contains("'elbow'; the robot has joint1, joint2"));
        assert!(refusal(&["joint1"], &[f64::NAN]).contains("joint 'joint1' the effort NaN"));
        assert!(refusal(&["joint1"], &[1e300]).contains("at most 1000000"));
        assert!(refusal(&["joint1", "joint2"], &[1.0]).contains("2 names but 1 efforts"));
        assert!(refusal(&["joint1", "joint1"], &[1.0, 2.0]).contains("twice"));
        assert!(refusal(&[], &[]).contains("names no joint"));
    }
}
