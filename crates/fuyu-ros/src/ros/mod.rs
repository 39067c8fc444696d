//! The ROS layer: what rclcpp is to a C++ node, in the shape that Rust gives it. It knows no physics.
//!
//! A node is a function of `&Node` that declares its parameters, makes its endpoints and then waits in a
//! loop; [`run`] makes an executable of it and [`Process`] runs several in one process.
//!
//! ```no_run
//! use fuyu::msg::geometry_msgs::{PoseStamped, TwistStamped};
//! use fuyu::ros::{self, Node, NodeError, Qos};
//! use std::time::Duration;
//!
//! fn follower(node: &Node) -> Result<(), NodeError> {
//!     let mut declare = node.declare();
//!     let gain = declare
//!         .param("gain", 0.5, "Speed per metre of error [1/s]")
//!         .range(0.0, 10.0)
//!         .live();
//!     let rate = declare
//!         .param("rate", 50.0, "Commands per second [Hz]")
//!         .range(1.0, 1000.0)
//!         .read_only()
//!         .value();
//!     declare.finish()?;
//!
//!     let poses = node.subscribe::<PoseStamped>("goal_pose", Qos::RELIABLE.depth(1))?;
//!     let commands = node.advertise::<TwistStamped>("cmd_vel", Qos::RELIABLE)?;
//!     let status = node.diagnostics().status("goal");
//!     let mut timer = node.timer(Duration::from_secs_f64(1.0 / rate));
//!     let mut goal = None;
//!     while node.wait_until(timer.next()) {
//!         goal = poses.latest().or(goal);
//!         if timer.due() {
//!             match &goal {
//!                 None => status.warn("no goal_pose has arrived"),
//!                 Some(pose) => {
//!                     let mut command = TwistStamped::default();
//!                     command.header.stamp = node.now().into();
//!                     command.twist.linear.x = gain.get() * pose.message.pose.position.x;
//!                     commands.publish(&command);
//!                     status.ok("following");
//!                 }
//!             }
//!         }
//!     }
//!     Ok(())
//! }
//!
//! fn main() -> std::process::ExitCode {
//!     ros::run("follower", follower)
//! }
//! ```
//!
//! # How a node runs
//! Three threads per node beside the two of its DDS participant: the program itself, one that receives
//! ([`Subscription`] queues, service requests) and one that sends (every [`Publisher`] of the node has a
//! bounded queue, so that publishing never blocks the program). Threads rather than an async runtime,
//! since a program here owns a loop that keeps time: it blocks on purpose.
//!
//! # DDS
//! rustdds carries bytes; types live at the edge ([`crate::msg::cdr`]). All endpoints therefore share one
//! instance of the DDS code, the recorder subscribes to types that it knows only by name, and a lost
//! participant is replaced below handles that live on. From ros2-client come the ROS conventions on the
//! wire: mangled type names and the `ros_discovery_info` that tells peers which endpoint is whose.

mod action;
mod action_client;
mod allocator;
pub mod args;
mod client;
mod clock;
mod context;
mod diagnostics;
mod discovery;
mod discovery_settling;
mod endpoint;
mod error;
mod events;
mod graph_cache;
mod lifecycle;
pub mod logging;
pub mod names;
mod node;
mod node_core;
pub mod params;
pub mod params_file;
mod participant_watchdog;
mod process;
mod publisher;
pub mod qos;
mod raw_endpoints;
mod service;
mod session;
mod signals;
mod subscription;
mod time;
mod type_hash_check;

pub use action::{ActionServer, Goal};
pub use action_client::{ActionClient, GoalHandle};
pub use allocator::return_free_memory;
pub use args::RosArgs;
pub use client::{CallError, PendingCall, ServiceClient};
pub use clock::{Clock, Timer};
pub use context::{DiscoveryRange, Domain, DomainError};
pub use diagnostics::{Diagnostics, Status};
pub use discovery::DiscoveredPublisher;
pub use error::NodeError;
pub use lifecycle::{Lifecycle, LifecycleState, Transition};
pub use names::NodeName;
pub use node::{Node, NodeOptions};
pub use params::{Declare, Param, ParameterValue};
pub use params_file::ParamsFile;
pub use process::{Process, Stopper, run};
pub use publisher::{Publisher, RawPublisher};
pub use qos::Qos;
pub use raw_endpoints::{Gid, RawSample};
pub use service::{Call, Calls, Reply, ServiceServer};
pub use subscription::{RawSubscription, Received, Subscription};
pub use time::Time;
