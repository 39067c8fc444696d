//! ROS package [`trajectory_msgs`](https://docs.ros.org/en/jazzy/p/trajectory_msgs/).

use super::builtin_interfaces::Duration;
use super::geometry_msgs::{Transform, Twist};
use super::std_msgs::Header;

crate::messages! {
    package trajectory_msgs;

    /// A point of a trajectory of joints. Lists have one element per joint of the trajectory, or none.
    message JointTrajectoryPoint {
        /// Positions \[rad or m\].
        positions: Vec<f64>,
        /// Velocities \[rad/s or m/s\].
        velocities: Vec<f64>,
        /// Accelerations \[rad/s² or m/s²\].
        accelerations: Vec<f64>,
        /// Efforts \[N m or N\].
        effort: Vec<f64>,
        /// Time since the start of the trajectory.
        time_from_start: Duration,
    }

    /// A trajectory of joints with one degree of freedom each.
    message JointTrajectory {
        /// Time of the start; zero is at once.
        header: Header,
        /// Names of the joints.
        joint_names: Vec<String>,
        /// Its points, in order of time.
        points: Vec<JointTrajectoryPoint>,
    }

    /// A point of a trajectory of joints with several degrees of freedom each.
    message MultiDOFJointTrajectoryPoint {
        /// Poses.
        transforms: Vec<Transform>,
        /// Twists.
        velocities: Vec<Twist>,
        /// Accelerations.
        accelerations: Vec<Twist>,
        /// Time since the start of the trajectory.
        time_from_start: Duration,
    }

    /// A trajectory of joints with several degrees of freedom each.
    message MultiDOFJointTrajectory {
        /// Time of the start; zero is at once.
        header: Header,
        /// Names of the joints.
        joint_names: Vec<String>,
        /// Its points, in order of time.
        points: Vec<MultiDOFJointTrajectoryPoint>,
    }
}
