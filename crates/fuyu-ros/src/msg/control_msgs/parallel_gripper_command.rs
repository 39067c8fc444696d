//! The action that opens and closes a gripper with parallel jaws.

use crate::msg::sensor_msgs::JointState;

crate::action! {
    package control_msgs;

    /// Moves the jaws of a gripper to a position with limited effort and rate.
    action ParallelGripperCommand {
        goal {
            /// Position and, if they are given, largest rate and effort of the joint.
            command: JointState,
        }
        outcome {
            /// Position, rate and effort of the joint.
            state: JointState,
            /// Whether the gripper presses and does not move.
            stalled: bool,
            /// Whether it is at the goal.
            reached_goal: bool,
        }
        feedback {
            /// Position, rate and effort of the joint.
            state: JointState,
        }
    }
}
