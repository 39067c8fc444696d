//! ROS 2 nodes and rosbag2 recordings in Rust, without a ROS installation.

// The message macros refer to this crate by its name, also from inside.
extern crate self as fuyu_ros;

pub mod bag;
pub mod msg;
pub mod ros;

/// What the message macros expand to; not part of the interface.
#[doc(hidden)]
pub mod __private {
    pub use crate::msg::ros_name;
    pub use ros2_client;
    pub use serde;
}
