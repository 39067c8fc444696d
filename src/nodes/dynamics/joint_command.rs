//! Validation of messages on `joint_commands`.

use crate::{model::Model, msg::sensor_msgs::JointState};

/// Setpoint for a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Setpoint {
    /// Effort \[N m or N\] to hold.
    Effort(f64),
    /// Rate to drive to \[rad/s or m/s\].
    Rate(f64),
    /// Position to drive to and hold \[rad or m\].
    Position(f64),
}

/// A valid command for some of the robot's joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointCommand<'a> {
    setpoints: &'a [(usize, Setpoint)],
}

impl<'a> JointCommand<'a> {
    /// Joint index and setpoint of each joint that the command names.
    pub fn setpoints(&self) -> &'a [(usize, Setpoint)] {
        self.setpoints
    }

    /// Whether it sets an effort: then its sender closes a control loop.
    pub fn has_efforts(&self) -> bool {
        let is_effort = |(_, setpoint): &(usize, Setpoint)| matches!(setpoint, Setpoint::Effort(_));
        self.setpoints.iter().any(is_effort)
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

/// Largest position in a command \[rad or m\]. A smaller one beyond the joint's limits is clamped to them.
const LARGEST_POSITION: f64 = 1e6;

/// One of a message's lists: positions, velocities or efforts.
struct List<'a> {
    one: &'static str,
    many: &'static str,
    values: &'a [f64],
    largest: f64,
    parameter: &'static str,
    setpoint: fn(f64) -> Setpoint,
}

/// Validates messages. Reuses the memory for setpoints.
#[derive(Debug)]
pub struct CommandReader {
    limits: CommandLimits,
    setpoints: Vec<(usize, Setpoint)>,
}

impl CommandReader {
    /// A reader with these limits.
    pub fn new(limits: CommandLimits) -> Self {
        Self {
            limits,
            setpoints: Vec::new(),
        }
    }

    /// Reads a message: efforts, rates or positions by joint name. The non-empty list determines the kind of setpoint.
    /// If several lists are non-empty, each joint must have a number in exactly one of them, and NaN in the others.
    ///
    /// # Errors
    /// A line that names the mistake and the correct form; such a message has no effect.
    pub fn read<'a>(
        &'a mut self,
        message: &JointState,
        model: &Model,
    ) -> Result<JointCommand<'a>, String> {
        if message.name.is_empty() {
            return Err(format!(
                "names no joint; expected some of {}",
                joint_names(model)
            ));
        }
        let all = [
            List {
                one: "effort",
                many: "efforts",
                values: &message.effort,
                largest: self.limits.effort,
                parameter: " (max_effort)",
                setpoint: Setpoint::Effort,
            },
            List {
                one: "velocity",
                many: "velocities",
                values: &message.velocity,
                largest: self.limits.rate,
                parameter: " (velocity_servo.max_rate)",
                setpoint: Setpoint::Rate,
            },
            List {
                one: "position",
                many: "positions",
                values: &message.position,
                largest: LARGEST_POSITION,
                parameter: "",
                setpoint: Setpoint::Position,
            },
        ];
        let count = message.name.len();
        let is_filled = |list: &&List| !list.values.is_empty();
        let filled = all.iter().filter(is_filled).count();
        for (i, list) in all.iter().enumerate() {
            let needed = is_filled(&list) || (filled == 0 && i == 0);
            if needed && list.values.len() != count {
                let (one, many) = (list.one, list.many);
                return Err(format!(
                    "has {count} names but {} {many}; give one {one} per name",
                    list.values.len()
                ));
            }
        }
        self.setpoints.clear();
        for (i, name) in message.name.iter().enumerate() {
            let Some(joint) = model.joint_index(name) else {
                return Err(format!(
                    "names '{name}'; the robot has {}",
                    joint_names(model)
                ));
            };
            // If only one list is non-empty, NaN is an error.
            let is_given =
                |list: &&List| is_filled(list) && (filled == 1 || !list.values[i].is_nan());
            let mut given = all.iter().filter(is_given);
            let Some(list) = given.next() else {
                return Err(format!(
                    "gives joint '{name}' no number: all its values are NaN"
                ));
            };
            if let Some(second) = given.next() {
                let (one, other) = (list.one, second.one);
                return Err(format!(
                    "gives joint '{name}' both {one} and {other}; give one of them, and leave the other list empty or NaN for this joint"
                ));
            }
            let value = list.values[i];
            // This is false for NaN, too.
            let is_valid = value.abs() <= list.largest;
            if !is_valid {
                return Err(format!(
                    "gives joint '{name}' the {} {value}; it must be finite and at most {}{}",
                    list.one, list.largest, list.parameter
                ));
            }
            if self.setpoints.iter().any(|(other, _)| *other == joint) {
                return Err(format!("names joint '{name}' twice"));
            }
            self.setpoints.push((joint, (list.setpoint)(value)));
        }
        Ok(JointCommand {
            setpoints: &self.setpoints,
        })
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
        assert!(command.has_efforts());
        let expected = [(1, Setpoint::Effort(2.0)), (0, Setpoint::Effort(-1.0))];
        assert_eq!(command.setpoints(), expected);
        let rates = JointState {
            velocity: vec![0.1],
            ..message(&["joint2"], &[])
        };
        let command = reader.read(&rates, &model).unwrap();
        assert!(!command.has_efforts());
        assert_eq!(command.setpoints(), [(1, Setpoint::Rate(0.1))]);
    }

    #[test]
    fn joints_of_one_command_may_have_different_kinds() {
        let (model, mut reader) = (model(), reader());
        let mixed = JointState {
            position: vec![f64::NAN, 0.5],
            ..message(&["joint1", "joint2"], &[2.0, f64::NAN])
        };
        let command = reader.read(&mixed, &model).unwrap();
        let expected = [(0, Setpoint::Effort(2.0)), (1, Setpoint::Position(0.5))];
        assert_eq!(command.setpoints(), expected);
        let twice = JointState {
            position: vec![0.1, 0.5],
            ..message(&["joint1", "joint2"], &[2.0, f64::NAN])
        };
        assert!(refusal(&twice).contains("'joint1' both effort and position"));
        let none = JointState {
            position: vec![0.1, f64::NAN],
            ..message(&["joint1", "joint2"], &[f64::NAN; 2])
        };
        assert!(refusal(&none).contains("joint 'joint2' no number"));
        let far = JointState {
            position: vec![1e300],
            ..message(&["joint1"], &[])
        };
        assert!(refusal(&far).contains("the position 1"));
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
