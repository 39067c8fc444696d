//! Parameter `lockstep_on`: the commands for which lockstep waits.

use crate::{nodes::topics, ros::Declare};

/// The commands for which every state waits in lockstep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LockstepOn {
    /// Joints: `joint_commands`, or a motion of the arm.
    pub joints: bool,
    /// Wheels: `wheel_commands`, if the robot has wheels.
    pub wheels: bool,
}

impl LockstepOn {
    /// Declares `lockstep_on` and reads it.
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let known = [topics::JOINT_COMMANDS.name, topics::WHEEL_COMMANDS.name];
        let expected = format!("one or both of {}", known.join(", "));
        let names: Vec<String> = declare
            .param(
                "lockstep_on",
                vec![known[0].to_owned()],
                "Topics of the commands that every state waits for in lockstep",
            )
            .read_only()
            .check(&expected.clone(), move |names: &Vec<String>| {
                let is_known = |name: &String| known.contains(&name.as_str());
                match !names.is_empty() && names.iter().all(is_known) {
                    true => Ok(()),
                    false => Err(format!("{names:?} is wrong, expected {expected}")),
                }
            })
            .value();
        let has = |name: &str| names.iter().any(|n| n == name);
        Self {
            joints: has(known[0]),
            wheels: has(known[1]),
        }
    }
}
