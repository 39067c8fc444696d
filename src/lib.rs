//! Free-floating space robots as ROS 2 nodes.

pub mod control;
pub mod dynamics;
pub mod model;
pub mod spatial;
pub mod vision;

#[cfg(feature = "ros")]
pub mod bag;
#[cfg(feature = "ros")]
pub mod cli;
#[cfg(feature = "ros")]
pub mod experiments;
#[cfg(feature = "ros")]
pub mod msg;
#[cfg(feature = "ros")]
pub mod nodes;
#[cfg(feature = "ros")]
pub mod ros;
