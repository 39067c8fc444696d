//! The action that opens and closes a gripper with one joint.

use super::GripperCommand as Command;

crate::action! {
    package control_msgs;

    /// Moves a gripper to a position with limited effort.
    action GripperCommand {
        goal {
            /// Position and largest effort.
            command: Command,
        }
        outcome {
            /// Position of the joint \[m or rad\].
            position: f64,
            /// Its effort \[N or N m\].
            effort: f64,
            /// Whether the gripper presses and does not move.
            stalled: bool,
            /// Whether it is at the goal.
            reached_goal: bool,
        }
        feedback {
            /// Position of the joint \[m or rad\].
            position: f64,
            /// Its effort \[N or N m\].
            effort: f64,
            /// Whether the gripper presses and does not move.
            stalled: bool,
            /// Whether it is at the goal.
            reached_goal: bool,
        }
    }
}
