//! ROS package [`control_msgs`](https://docs.ros.org/en/jazzy/p/control_msgs/): actions that move joints and
//! grippers, and their tolerances.

pub mod follow_joint_trajectory;
pub mod gripper_command;
pub mod parallel_gripper_command;

crate::messages! {
    package control_msgs;

    /// What a gripper with one joint is asked for.
    message GripperCommand {
        /// Position of its joint \[m or rad\].
        position: f64,
        /// Largest effort \[N or N m\]; 0 is no limit.
        max_effort: f64,
    }

    /// Tolerances of a joint: 0 is the server's default, -1 is no tolerance.
    message JointTolerance {
        /// Name of the joint.
        name: String,
        /// Of the position \[rad or m\].
        position: f64,
        /// Of the velocity \[rad/s or m/s\].
        velocity: f64,
        /// Of the acceleration \[rad/s² or m/s²\].
        acceleration: f64,
    }

    /// Tolerances of a component of a joint with several degrees of freedom.
    message JointComponentTolerance {
        /// Name of the joint.
        joint_name: String,
        /// One of the constants.
        component: u16,
        /// Of the position \[m or rad\].
        position: f64,
        /// Of the velocity \[m/s or rad/s\].
        velocity: f64,
        /// Of the acceleration \[m/s² or rad/s²\].
        acceleration: f64,
    }
    constants {
        /// Along x.
        X_AXIS: u16 = 1,
        /// Along y.
        Y_AXIS: u16 = 2,
        /// Along z.
        Z_AXIS: u16 = 3,
        /// All three axes.
        TRANSLATION: u16 = 4,
        /// The rotation.
        ROTATION: u16 = 5,
    }
}
