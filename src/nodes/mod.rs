//! The ROS 2 nodes: physics joined to topics, services and parameters.
//!
//! | node | reads | writes |
//! | --- | --- | --- |
//! | [`dynamics`] | `joint_commands` | `/clock`, `robot_description`, `joint_states`, `imu`, `/tf`, `/tf_static`, `ground_truth/...` |
//! | [`camera`] | `robot_description`, `joint_states`, `ground_truth/odom`, `goal_pose` | `camera/tip_pose`, `camera/goal_pose`, `camera/second/...`, `camera/camera_info` |
//! | [`controller`] | `robot_description`, `joint_states`, `imu`, `camera/tip_pose`, `camera/goal_pose`, `camera/second/...`, `estimator/angular_velocity` | `joint_commands`, `controller/state` |
//! | [`estimator`] | `camera/features`, `camera/camera_info`, `imu`, `/tf_static` | `estimator/...` |
//! | [`teleop`] | `robot_description`, `joint_states`, `imu`, `joy`, `cmd_vel` | `joint_commands` |
//! | [`recorder`] | any topic | a bag |
//! | [`views`] | `goal_pose`, `camera/goal_pose`, `ground_truth/...`, `estimator/prediction` | `markers` |
//!
//! A node is a program `fn(&Node) -> Result<(), NodeError>`; [`by_name`] finds it.

pub mod camera;
mod choice;
pub mod controller;
pub mod dynamics;
pub mod estimator;
pub mod features;
pub mod foxglove;
pub mod geometry;
mod joint_vectors;
mod placement;
pub mod player;
pub mod recorder;
pub mod resource;
mod robot_description;
pub mod scenario;
pub mod teleop;
mod tip;
pub mod topics;
pub mod views;

pub use tip::tip_frame;

use crate::ros::{Node, NodeError};

/// The program of a node.
pub type Program = fn(&Node) -> Result<(), NodeError>;

/// All nodes, in the order in which a launch starts them: whoever listens comes first.
pub const NODES: [(&str, Program); 7] = [
    ("recorder", recorder::program),
    ("views", views::program),
    ("estimator", estimator::program),
    ("controller", controller::program),
    ("teleop", teleop::program),
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
