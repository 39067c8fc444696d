//! fuyu over Zenoh, in the networks in which the other tests of this program run it over DDS. rclpy of ROS without a
//! ROS installation has no rmw_zenoh, so all nodes are fuyu's here; `crates/fuyu-ros/tests/transports` has a peer.

mod compare;
mod interruptions;
mod network;
mod robot;
mod robots;
mod router;
mod slow_network;
mod tunnel;
pub mod watch;

pub use compare::{receive_images, send_images, steer, steered};
pub use robots::listen;
