//! ROS 2 nodes, parameters, lifecycle, actions and rosbag2 in Rust, without a ROS installation.
//!
//! Nodes communicate over DDS (RTPS) with nodes of ROS 2 Jazzy and Kilted that use Fast DDS, and with the `ros2` command
//! line; with nodes that use CycloneDDS they exchange topics only. With the feature `zenoh` they communicate over Zenoh
//! instead, as rmw_zenoh does. No ROS package, code generator or sourced environment is needed: messages are declared in
//! Rust.
//!
//! | module | content |
//! | --- | --- |
//! | [`ros`] | nodes: publishers, subscriptions, services, actions, parameters, lifecycle, clock, diagnostics, log, `--ros-args` |
//! | [`msg`] | messages of the common ROS packages, macros for user-defined ones, CDR, type hashes, schemas |
//! | [`bag`] | rosbag2 recordings (MCAP): write, read, recover, convert to CSV and Parquet |
//! | [`input_file`] | reading files whose names are input: regular files up to a size |
//! | `keys` | certificates and access control of a Zenoh graph (feature `zenoh`) |
//!
//! # A node
//!
//! A node is a function of [`&Node`](ros::Node): it declares its parameters, creates its endpoints and waits in a loop.
//! [`ros::run`] turns it into an executable that understands `--ros-args`:
//!
//! ```no_run
//! # use fuyu_ros::ros::{self, Node, NodeError};
//! # fn node(_: &Node) -> Result<(), NodeError> { Ok(()) }
//! fn main() -> std::process::ExitCode {
//!     ros::run("doubler", node)
//! }
//! ```
//!
//! [`ros::Process`] runs several nodes in one process, also inside a larger program. Here one node doubles what the other
//! publishes:
//!
//! ```
//! use fuyu_ros::msg::std_msgs::Float64;
//! use fuyu_ros::ros::{DiscoveryRange, Domain, Node, NodeError, Process, Qos, RosArgs};
//! use std::time::Duration;
//!
//! fn doubler(node: &Node) -> Result<(), NodeError> {
//!     let mut declare = node.declare();
//!     let factor = declare
//!         .param("factor", 2.0, "Factor on the input [-]")
//!         .range(0.0, 10.0)
//!         .live(); // follows `ros2 param set`
//!     declare.finish()?;
//!
//!     let input = node.subscribe::<Float64>("input", Qos::RELIABLE)?;
//!     let output = node.advertise::<Float64>("output", Qos::RELIABLE)?;
//!     // Wakes up for messages, changed parameters and the end of the node.
//!     while node.wait() {
//!         while let Some(received) = input.take() {
//!             let data = factor.get() * received.message.data;
//!             output.publish(&Float64 { data });
//!         }
//!     }
//!     Ok(())
//! }
//!
//! fn user(node: &Node) -> Result<(), NodeError> {
//!     let input = node.advertise::<Float64>("input", Qos::RELIABLE)?;
//!     let output = node.subscribe::<Float64>("output", Qos::RELIABLE)?;
//!     // Discovery takes a while, so the question is repeated.
//!     while node.ok() {
//!         input.publish(&Float64 { data: 21.0 });
//!         if let Some(received) = output.wait_next(Duration::from_millis(100)) {
//!             assert_eq!(received.message.data, 42.0);
//!             break; // the end of one node ends the process
//!         }
//!     }
//!     Ok(())
//! }
//!
//! let range = DiscoveryRange::Localhost;
//! let mut process = Process::new(RosArgs::default(), Domain { id: 87, range });
//! process.start("doubler", doubler)?;
//! process.start("user", user)?;
//! process.wait()?;
//! # Ok::<(), NodeError>(())
//! ```
//!
//! # User-defined messages, services and actions
//!
//! The macros [`messages!`], [`services!`] and [`action!`] declare them. [`Node::serve`](ros::Node::serve) and
//! [`Node::client`](ros::Node::client) serve and call services, [`ActionServer`](ros::ActionServer) and
//! [`ActionClient`](ros::ActionClient) actions.

// The message macros refer to this crate by its name, also from inside.
extern crate self as fuyu_ros;

pub mod bag;
pub mod input_file;
#[cfg(feature = "zenoh")]
pub mod keys;
pub mod msg;
pub mod ros;

/// Paths that the message macros expand to; not part of the interface.
#[doc(hidden)]
pub mod __private {
    pub use crate::msg::ros_name;
    pub use ros2_client;
    pub use serde;
}
