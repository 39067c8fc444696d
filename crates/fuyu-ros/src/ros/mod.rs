//! ROS 2 nodes, with the functions that rclcpp provides to C++ programs.
//!
//! A node is a function of `&Node` that declares its parameters, creates its endpoints and then waits in a
//! loop; [`run`] makes it an executable, and [`Process`] runs several nodes in one process.
//!
//! ```no_run
//! use fuyu_ros::msg::geometry_msgs::{PoseStamped, TwistStamped};
//! use fuyu_ros::ros::{self, Node, NodeError, Qos};
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
//! # Threads of a node
//! A node has three threads: the program, the receiving thread (handlers of raw subscriptions and services) and the
//! sending thread (every [`Publisher`] has a bounded queue, so that publishing never blocks the program). A DDS
//! participant has three more. There is no async runtime, since a node's program is a loop with its own timing that
//! blocks on purpose.
//!
//! # Several nodes in one process
//! Nodes of a process share one participant, like composable nodes of ROS 2. Messages between them are passed in
//! memory, without serialization if the Rust types are the same, with the same quality of service as over DDS. Every
//! topic is also available to other processes over DDS. [`Process::isolated`] gives every node a participant of its
//! own.
//!
//! # DDS
//! rustdds transports bytes; fuyu serializes messages ([`crate::msg::cdr`]). So all endpoints share one instance of the
//! generic DDS code, a program can subscribe to types that it knows only by name, and a failed participant can be
//! replaced while the handles of endpoints stay valid. ros2-client provides the message `ros_discovery_info`, which
//! assigns endpoints to nodes.

mod action;
mod action_client;
mod allocator;
pub mod args;
mod client;
mod clock;
mod clock_follower;
mod clock_source;
mod context;
mod descriptor_limit;
mod diagnostics;
mod discovery;
mod endpoint;
mod error;
mod events;
mod graph_cache;
mod handler_queue;
mod held_replies;
mod help;
mod invalid_samples;
mod lifecycle;
mod local_delivery;
pub mod logging;
pub mod names;
mod node;
mod node_core;
pub mod params;
pub mod params_file;
mod participant;
mod process;
mod publisher;
pub mod qos;
mod receive_queue;
mod sample;
mod service;
mod signals;
mod subscription;
mod time;
mod transport;
mod wall_clock_watch;

pub use action::{ActionServer, Goal, GoalRequest};
pub use action_client::{ActionClient, GoalHandle, PendingGoal};
pub use allocator::return_free_memory;
pub use args::RosArgs;
pub use client::{CallError, PendingCall, ServiceClient};
pub use clock::{Clock, Timer};
pub use context::{DiscoveryRange, Domain, DomainError};
pub use diagnostics::{Diagnostics, Status};
pub use discovery::{DiscoveredPublisher, LocalTopicUse};
pub use error::NodeError;
pub use events::publish_together;
pub use lifecycle::{Lifecycle, LifecycleState, Transition};
pub use names::NodeName;
pub use node::{Node, NodeOptions};
pub use params::{Declare, Param, ParameterValue};
pub use params_file::ParamsFile;
pub use process::{Process, Stopper, run};
pub use publisher::{Publisher, RawPublisher};
pub use qos::Qos;
pub use receive_queue::Received;
pub use sample::{Gid, RawSample};
pub use service::{Call, Calls, Reply, ServiceServer};
pub use subscription::{RawSubscription, Subscription};
pub use time::Time;
pub use transport::Middleware;
#[cfg(feature = "zenoh")]
pub use transport::{RouterLog, ZenohConfig, ZenohRouter};
