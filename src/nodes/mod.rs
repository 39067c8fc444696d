//! The ROS 2 nodes: they connect the physics to topics, services and parameters.
//!
//! | node | reads | writes |
//! | --- | --- | --- |
//! | [`dynamics`] | `/clock`, `joint_commands`, `wheel_commands`, `thruster_commands`, `joint_trajectory`, `cartesian_path`, `delta_twist_cmds`, `wrench` | `/clock`, `robot_description`, `joint_states`, `/tf`, `/tf_static`, `ground_truth/odom`, `ground_truth/NAME/odom`, `ground_truth/NAME/robot_description`, `ground_truth/NAME/joint_states`, `ground_truth/NAME/momentum`, `imu`, `star_tracker`, `ground_truth/momentum`, `ground_truth/appendages`, `ground_truth/appendage_outlines`, `wheel_states`, `ground_truth/external_impulse`, `wrist/wrench`, `contacts`, `command_delay` |
//! | [`camera`] | `robot_description`, `joint_states`, `ground_truth/odom`, `ground_truth/NAME/odom`, `ground_truth/NAME/robot_description`, `ground_truth/NAME/joint_states`, `goal_pose` | `camera/tip_pose`, `camera/goal_pose`, `camera/second/tip_pose`, `camera/second/goal_pose`, `camera/camera_info`, `camera/features`, `ground_truth/features`, `camera/image_raw`, `camera/image_raw/compressed`, `camera/depth`, `camera/segmentation`, `camera/left/camera_info`, `camera/left/image_raw`, `camera/left/image_raw/compressed`, `camera/right/camera_info`, `camera/right/image_raw`, `camera/right/image_raw/compressed` |
//! | [`controller`] | `robot_description`, `joint_states`, `imu`, `command_delay`, `camera/tip_pose`, `camera/goal_pose`, `camera/second/tip_pose`, `camera/second/goal_pose`, `estimator/angular_velocity` | `joint_commands`, `controller/state` |
//! | [`attitude`] | `robot_description`, `joint_states`, `imu`, `star_tracker`, `wheel_states`, `attitude_target` | `wheel_commands`, `thruster_commands`, `attitude/state` |
//! | [`estimator`] | `/tf_static`, `imu`, `camera/camera_info`, `camera/features`, `camera/points` | `estimator/angular_velocity`, `estimator/motion`, `estimator/prediction` |
//! | [`mission`] | `robot_description`, `joint_states`, `imu`, `wheel_states`, `camera/goal_pose`, `estimator/prediction` | `joint_commands`, `wheel_commands`, `thruster_commands`, `wrench`, `mission/state` |
//! | [`tracker`] | `camera/image_raw`, `camera/segmentation` | `camera/features` |
//! | [`teleop`] | `robot_description`, `joint_states`, `imu`, `joy`, `cmd_vel` | `joint_commands` |
//! | [`views`] | `ground_truth/odom`, `ground_truth/NAME/odom`, `ground_truth/momentum`, `ground_truth/appendages`, `ground_truth/appendage_outlines`, `camera/goal_pose`, `goal_pose`, `estimator/prediction` | `markers` |
//! | [`recorder`] | any topic | a bag |
//!
//! The table is generated from the declarations in [`topics`]; `NAME` stands for the name of a target. Every node also
//! publishes `diagnostics`. [`foxglove`] and [`player`] are separate programs that take any topic.
//!
//! A node is a program `fn(&Node) -> Result<(), NodeError>`; [`by_name`] finds it.

pub mod attitude;
pub mod camera;
mod choice;
pub mod controller;
pub mod dynamics;
pub mod estimator;
pub mod features;
pub mod foxglove;
pub mod geometry;
mod joint_vectors;
mod mesh;
pub mod mission;
mod named_lists;
mod placement;
pub mod player;
pub mod recorder;
pub mod resource;
mod robot_description;
mod sampled_loop;
pub mod scenario;
pub mod teleop;
mod tip;
pub mod topics;
pub mod tracker;
pub mod views;

pub use tip::tip_frame;

use crate::ros::{Node, NodeError};

/// The program of a node.
pub type Program = fn(&Node) -> Result<(), NodeError>;

/// All nodes, in the order in which `fuyu launch` starts them: subscribers before publishers.
pub const NODES: [(&str, Program); 10] = [
    ("recorder", recorder::program),
    ("views", views::program),
    ("estimator", estimator::program),
    ("tracker", tracker::program),
    ("controller", controller::program),
    ("attitude", attitude::program),
    ("teleop", teleop::program),
    ("mission", mission::program),
    ("camera", camera::program),
    ("dynamics", dynamics::program),
];

/// The program of the node called `name` in scenario files.
pub fn by_name(name: &str) -> Option<Program> {
    NODES
        .iter()
        .find(|(known, _)| *known == name)
        .map(|(_, program)| *program)
}
