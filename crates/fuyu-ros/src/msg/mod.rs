//! ROS 2 messages. One declaration gives the Rust struct, the `.msg` text, the schema in a bag, the RIHS01 type hash
//! and the serialization (CDR).
//!
//! Each ROS package is a module. All messages implement [`Interface`]; [`find`] returns the definition of a ROS type
//! name. [`messages!`](crate::messages) declares further messages.
//!
//! ```
//! use fuyu_ros::msg::{Interface, sensor_msgs::JointState};
//!
//! assert_eq!(JointState::DEFINITION.type_name(), "sensor_msgs/msg/JointState");
//! assert!(JointState::DEFINITION.type_hash().starts_with("RIHS01_a13ee3a3"));
//! ```

mod definition;
mod interface;
mod macros;
mod service_definition;
mod type_hash;

pub mod cdr;
pub mod scan;
pub mod schema;

pub mod action_msgs;
pub mod builtin_interfaces;
pub mod control_msgs;
pub mod diagnostic_msgs;
pub mod fuyu_msgs;
pub mod geometry_msgs;
pub mod lifecycle_msgs;
pub mod nav_msgs;
pub mod rcl_interfaces;
pub mod ros_gz_interfaces;
pub mod rosbag2_interfaces;
pub mod rosgraph_msgs;
pub mod sensor_msgs;
pub mod simulation_interfaces;
pub mod std_msgs;
pub mod std_srvs;
pub mod tf2_msgs;
pub mod trajectory_msgs;
pub mod unique_identifier_msgs;
pub mod visualization_msgs;

#[doc(hidden)]
pub use definition::ros_name;
pub use definition::{Constant, Definition, FieldDefinition, Kind};
pub use interface::{Action, Base, Bounded, Byte, Field, FieldType, Interface, Service, Shape};
pub use service_definition::ServiceDefinition;

/// All message types of this module, package by package.
pub fn definitions() -> impl Iterator<Item = &'static Definition> {
    [
        action_msgs::DEFINITIONS,
        builtin_interfaces::DEFINITIONS,
        control_msgs::DEFINITIONS,
        diagnostic_msgs::DEFINITIONS,
        fuyu_msgs::DEFINITIONS,
        geometry_msgs::DEFINITIONS,
        lifecycle_msgs::DEFINITIONS,
        nav_msgs::DEFINITIONS,
        rcl_interfaces::DEFINITIONS,
        ros_gz_interfaces::DEFINITIONS,
        rosgraph_msgs::DEFINITIONS,
        sensor_msgs::DEFINITIONS,
        simulation_interfaces::DEFINITIONS,
        std_msgs::DEFINITIONS,
        tf2_msgs::DEFINITIONS,
        trajectory_msgs::DEFINITIONS,
        unique_identifier_msgs::DEFINITIONS,
        visualization_msgs::DEFINITIONS,
    ]
    .into_iter()
    .flatten()
    .copied()
}

/// Requests and responses of all services and all parts of all actions of this module.
pub fn service_definitions() -> impl Iterator<Item = &'static Definition> {
    [
        action_msgs::services::DEFINITIONS,
        control_msgs::follow_joint_trajectory::DEFINITIONS,
        control_msgs::gripper_command::DEFINITIONS,
        control_msgs::parallel_gripper_command::DEFINITIONS,
        fuyu_msgs::capture::DEFINITIONS,
        fuyu_msgs::services::DEFINITIONS,
        lifecycle_msgs::services::DEFINITIONS,
        rcl_interfaces::services::DEFINITIONS,
        rosbag2_interfaces::DEFINITIONS,
        simulation_interfaces::services::DEFINITIONS,
        simulation_interfaces::simulate_steps::DEFINITIONS,
        std_srvs::DEFINITIONS,
    ]
    .into_iter()
    .flatten()
    .copied()
}

/// The definition of the message type `type_name` (`"pkg/msg/Name"`), if it is declared in this module.
pub fn find(type_name: &str) -> Option<&'static Definition> {
    let mut parts = type_name.split('/');
    let (package, kind, name) = (parts.next()?, parts.next()?, parts.next()?);
    if kind != "msg" || parts.next().is_some() {
        return None;
    }
    definitions().find(|d| d.package == package && d.name == name)
}
