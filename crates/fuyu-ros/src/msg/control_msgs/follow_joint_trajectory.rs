//! The action that moves joints along a trajectory.

use super::{JointComponentTolerance, JointTolerance};
use crate::msg::{
    builtin_interfaces::Duration,
    std_msgs::Header,
    trajectory_msgs::{
        JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectory,
        MultiDOFJointTrajectoryPoint,
    },
};

crate::action! {
    package control_msgs;

    /// Moves joints along a trajectory, within tolerances.
    action FollowJointTrajectory {
        goal {
            /// Trajectory of the joints with one degree of freedom.
            trajectory: JointTrajectory,
            /// Trajectory of the joints with several.
            multi_dof_trajectory: MultiDOFJointTrajectory,
            /// Tolerances while the joints move.
            path_tolerance: Vec<JointTolerance>,
            /// The same of joints with several degrees of freedom.
            component_path_tolerance: Vec<JointComponentTolerance>,
            /// Tolerances at the end.
            goal_tolerance: Vec<JointTolerance>,
            /// The same of joints with several degrees of freedom.
            component_goal_tolerance: Vec<JointComponentTolerance>,
            /// How long after its end the goal may be reached.
            goal_time_tolerance: Duration,
        }
        outcome {
            /// One of the constants.
            error_code: i32,
            /// What went wrong.
            error_string: String,
        }
        feedback {
            /// Time of the states.
            header: Header,
            /// Names of the joints.
            joint_names: Vec<String>,
            /// Where they should be.
            desired: JointTrajectoryPoint,
            /// Where they are.
            actual: JointTrajectoryPoint,
            /// The difference.
            error: JointTrajectoryPoint,
            /// Names of the joints with several degrees of freedom.
            multi_dof_joint_names: Vec<String>,
            /// Where they should be.
            multi_dof_desired: MultiDOFJointTrajectoryPoint,
            /// Where they are.
            multi_dof_actual: MultiDOFJointTrajectoryPoint,
            /// The difference.
            multi_dof_error: MultiDOFJointTrajectoryPoint,
        }
    }
}

impl Outcome {
    /// The goal was reached.
    pub const SUCCESSFUL: i32 = 0;
    /// The goal is invalid.
    pub const INVALID_GOAL: i32 = -1;
    /// The goal's joints are not those of the robot.
    pub const INVALID_JOINTS: i32 = -2;
    /// The trajectory would have ended already.
    pub const OLD_HEADER_TIMESTAMP: i32 = -3;
    /// A joint deviated too much on its way.
    pub const PATH_TOLERANCE_VIOLATED: i32 = -4;
    /// A joint did not reach its goal in time.
    pub const GOAL_TOLERANCE_VIOLATED: i32 = -5;
}
