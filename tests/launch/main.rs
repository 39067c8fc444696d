//! The running graph, end to end: `fuyu launch`, the nodes' executables and `fuyu simulate`, together with
//! rclpy nodes (Jazzy, Fast DDS). Every test has its own DDS domain, on loopback.

#[path = "../support/binaries.rs"]
mod binaries;
#[path = "../support/lateness.rs"]
mod lateness;
#[path = "../support/measuring.rs"]
mod measuring;
#[path = "../support/peer.rs"]
mod peer;
#[path = "../support/python.rs"]
#[expect(dead_code, reason = "no script is given an input here")]
mod python;
#[path = "../support/waiting.rs"]
mod waiting;

mod articulated_targets;
mod attitude;
mod attitude_faults;
mod bad_input;
mod command_arbiter;
mod commanders;
mod contract;
mod descriptors;
mod estimator;
mod executables;
mod external_features;
mod faults;
mod filter;
mod flexible;
mod free_motion;
mod grasping;
mod grippers;
mod images;
mod joining;
mod large_commands;
mod lifecycle;
mod lockstep;
mod mission;
mod motions;
mod observer;
mod overload;
mod own_controller;
mod positioning;
mod process;
mod reset;
mod robots_apart;
mod silent_gyro;
mod simulation_control;
mod survival;
mod switching;
mod teleop;
mod tracker;
mod tumbling;
mod two_servicers;
mod wrenches;
