//! The running graph, end to end: `fuyu launch`, the nodes' own executables and `fuyu simulate`, with
//! rclpy (Jazzy, Fast DDS) beside them. Every test has a DDS domain of its own, on loopback.

#[path = "../support/binaries.rs"]
mod binaries;
#[path = "../support/measuring.rs"]
mod measuring;
#[path = "../support/peer.rs"]
mod peer;
#[path = "../support/waiting.rs"]
mod waiting;

mod bad_input;
mod commander;
mod contract;
mod estimator;
mod executables;
mod faults;
mod filter;
mod free_motion;
mod joining;
mod lifecycle;
mod lockstep;
mod own_controller;
mod positioning;
mod process;
mod reset;
mod silent_gyro;
mod simulation_control;
mod starvation;
mod strangers;
mod survival;
mod switching;
mod teleop;
mod tumbling;
mod view;
