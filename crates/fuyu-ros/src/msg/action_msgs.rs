//! ROS package [`action_msgs`](https://docs.ros.org/en/jazzy/p/action_msgs/): types that all actions share.

use super::{builtin_interfaces::Time, unique_identifier_msgs::UUID};

crate::messages! {
    package action_msgs;

    /// Which goal, and when it was accepted.
    message GoalInfo {
        /// The client's choice.
        goal_id: UUID,
        /// When it was accepted.
        stamp: Time,
    }

    /// How far a goal is.
    message GoalStatus {
        /// Which goal.
        goal_info: GoalInfo,
        /// One of the constants.
        status: i8,
    }
    constants {
        /// Never set.
        STATUS_UNKNOWN: i8 = 0,
        /// Accepted, not begun.
        STATUS_ACCEPTED: i8 = 1,
        /// Being worked on.
        STATUS_EXECUTING: i8 = 2,
        /// To be cancelled, not yet done.
        STATUS_CANCELING: i8 = 3,
        /// Reached.
        STATUS_SUCCEEDED: i8 = 4,
        /// Cancelled by a client.
        STATUS_CANCELED: i8 = 5,
        /// Given up by the server.
        STATUS_ABORTED: i8 = 6,
    }

    /// All goals that a server knows.
    message GoalStatusArray {
        /// In the order in which they came.
        status_list: Vec<GoalStatus>,
    }
}

/// The service that every action has.
pub mod services {
    use super::*;

    crate::services! {
        package action_msgs;

        /// Cancels goals: the one with this identity, those accepted up to a time, or all.
        service CancelGoal {
            CancelGoalRequest {
                /// Zero identity and zero time is all goals.
                goal_info: GoalInfo,
            }
            CancelGoalResponse {
                /// One of the constants.
                return_code: i8,
                /// Goals that will be cancelled.
                goals_canceling: Vec<GoalInfo>,
            }
        }
    }

    impl CancelGoalResponse {
        /// All goals that the request selects are being cancelled.
        pub const ERROR_NONE: i8 = 0;
        /// None of the goals can be cancelled.
        pub const ERROR_REJECTED: i8 = 1;
        /// There is no such goal.
        pub const ERROR_UNKNOWN_GOAL_ID: i8 = 2;
        /// The goal has ended already.
        pub const ERROR_GOAL_TERMINATED: i8 = 3;
    }
}
