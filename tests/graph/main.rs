//! The ROS layer in a real graph: nodes of this crate with rclpy nodes (Jazzy, Fast DDS) on loopback.

#[path = "../support/lateness.rs"]
mod lateness;
#[path = "../support/measuring.rs"]
mod measuring;
#[path = "../support/namespace.rs"]
mod namespace;
#[path = "../support/peer.rs"]
mod peer;
#[path = "../support/python.rs"]
#[expect(dead_code, reason = "no script is given an input here")]
mod python;
#[path = "../support/waiting.rs"]
mod waiting;
#[path = "../support/wall_clock.rs"]
mod wall_clock;

mod delivery;
mod first_calls;
mod first_messages;
mod isolation;
mod joining;
mod parameters;
mod participant_watchdog;
mod probe;
mod processes;
mod sharing;
mod survival;
mod topics;
mod upstream;
mod wall_clock_steps;
