//! Messages on `joint_commands`, validated before they act.

use crate::{model::Model, msg::sensor_msgs::JointState};

/// What a command gives for joints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommandKind {
    /// Efforts \[N m or N\].
    Effort,
    /// Rates \[rad/s or m/s\].
    Rate,
}

/// A valid command for some of the robot's joints. It borrows its values from the message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointCommand<'a> {
    /// What the values are.
    pub kind: CommandKind,
    joints: &'a [usize],
    values: &'a [f64],
}

impl<'a> JointCommand<'a> {
    /// Joint index and value of each joint that the command names.
    pub fn values(&self) -> impl Iterator<Item = (usize, f64)> + use<'a> {
        let joints = self.joints.iter().copied();
        joints.zip(self.values.iter().copied())
    }
}

/// The largest values that a command may have.
#[derive(Debug, Clone, Copy)]
pub struct CommandLimits {
    /// Effort, `max_effort` \[N m or N\].
    pub effort: f64,
    /// Rate, `velocity_servo.max_rate` \[rad/s or m/s\].
    pub rate: f64,
}

/// Validates messages. Keeps the memory for joint indices between them.
#[derive(Debug)]
pub struct CommandReader {
    limits: CommandLimits,
    joints: Vec<usize>,
}

impl CommandReader {
    /// A reader with these limits.
    pub fn new(limits: CommandLimits) -> Self {
        Self {
            limits,
            joints: Vec::new(),
        }
    }

    /// Reads a message: efforts or rates by joint name. The list that is not empty decides which of the two it commands.
    ///
    /// # Errors
    /// A line that names what is wrong and what would be right; such a message has no effect.
    pub fn read<'a>(
        &'a mut self,
        message: &'a JointState,
        model: &Model,
    ) -> Result<JointCommand<'a>, String> {
        if message.name.is_empty() {
            return Err(format!(
                "names no joint; expected some of {}",
                joint_names(model)
            ));
        }
        let (kind, values) = match (message.effort.is_empty(), message.velocity.is_empty()) {
            (false, false) => {
                return Err(
                    "has both effort and velocity; a command is one or the other, so leave one list empty"
                        .to_owned(),
                );
            }
            (true, false) => (CommandKind::Rate, &message.velocity),
            _ => (CommandKind::Effort, &message.effort),
        };
        self.check(message, kind, values, model)?;
        Ok(JointCommand {
            kind,
            joints: &self.joints,
            values,
        })
    }

    /// Checks `values` and finds their joints.
    fn check(
        &mut self,
        message: &JointState,
        kind: CommandKind,
        values: &[f64],
        model: &Model,
    ) -> Result<(), String> {
        let (one, many, limit, parameter) = match kind {
            CommandKind::Effort => ("effort", "efforts", self.limits.effort, "max_effort"),
            CommandKind::Rate => {
                let parameter = "velocity_servo.max_rate";
                ("velocity", "velocities", self.limits.rate, parameter)
            }
        };
        if values.len() != message.name.len() {
            return Err(format!(
                "has {} names but {} {many}; give one {one} per name",
                message.name.len(),
                values.len()
            ));
        }
        self.joints.clear();
        for (name, &value) in message.name.iter().zip(values) {
            let Some(joint) = model.joint_index(name) else {
                return Err(format!(
                    "names '{name}'; the robot has {}",
                    joint_names(model)
                ));
            };
            // NaN is not within the limit either.
            let is_valid = value.abs() <= limit;
            if !is_valid {
                return Err(format!(
                    "gives joint '{name}' the {one} {value}; it must be finite and at most {limit} ({parameter})"
                ));
            }
            if self.joints.contains(&joint) {
                return Err(format!("names joint '{name}' twice"));
            }
            self.joints.push(joint);
        }
        Ok(())
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

    fn reader() -> CommandReader {
        CommandReader::new(CommandLimits {
            effort: 1e6,
            rate: 100.0,
        })
    }

    fn refusal(message: &JointState) -> String {
        reader().read(message, &model()).unwrap_err()
    }

    #[test]
    fn a_command_acts_by_name_in_any_order() {
        let (model, mut reader) = (model(), reader());
        let efforts = message(&["joint2", "joint1"], &[2.0, -1.0]);
        let command = reader.read(&efforts, &model).unwrap();
        assert_eq!(command.kind, CommandKind::Effort);
        let values: Vec<_> = command.values().collect();
        assert_eq!(values, [(1, 2.0), (0, -1.0)]);
        let rates = JointState {
            velocity: vec![0.1],
            ..message(&["joint2"], &[])
        };
        let command = reader.read(&rates, &model).unwrap();
        assert_eq!(command.kind, CommandKind::Rate);
        assert_eq!(command.values().collect::<Vec<_>>(), [(1, 0.1)]);
    }

    #[test]
    fn an_invalid_command_is_refused_with_the_reason() {
        let efforts = |names: &[&str], effort: &[f64]| refusal(&message(names, effort));
        assert!(efforts(&["elbow"], &[1.0]).contains("'elbow'; the robot has joint1, joint2"));
        assert!(efforts(&["joint1"], &[f64::NAN]).contains("joint 'joint1' the effort NaN"));
        assert!(efforts(&["joint1"], &[1e300]).contains("at most 1000000"));
        assert!(efforts(&["joint1", "joint2"], &[1.0]).contains("2 names but 1 efforts"));
        assert!(efforts(&["joint1", "joint1"], &[1.0, 2.0]).contains("twice"));
        assert!(efforts(&[], &[]).contains("names no joint"));
        let rates = |velocity: &[f64], effort: &[f64]| {
            refusal(&JointState {
                velocity: velocity.to_vec(),
                ..message(&["joint1"], effort)
            })
        };
        assert!(rates(&[f64::NAN], &[]).contains("joint 'joint1' the velocity NaN"));
        assert!(rates(&[101.0], &[]).contains("at most 100 (velocity_servo.max_rate)"));
        assert!(rates(&[1.0, 2.0], &[]).contains("1 names but 2 velocities"));
        assert!(rates(&[1.0], &[1.0]).contains("both effort and velocity"));
    }
}
