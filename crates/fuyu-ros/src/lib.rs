//! ROS 2 nodes and rosbag2 recordings in Rust, without a ROS installation.

pub mod bag;
pub mod msg;
pub mod ros;
