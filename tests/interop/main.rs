//! fuyu with other stacks (rclpy of Jazzy and Kilted on Fast DDS, CycloneDDS), on networks that
//! lose and delay packets, with peers that die, send garbage or share a name, and under load.

#[path = "../support/binaries.rs"]
mod binaries;
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

mod child;
mod dynamics_restart;
mod echo;
mod hashes;
mod hostile;
mod launch_files;
mod link_loss;
mod load;
mod lossy;
mod matrix;
mod names;
mod robots;
mod security;
mod slow_network;
mod soak;
mod speed;
mod static_peers;
mod time_jumps;
mod two_computers;
mod wire;
mod wireguard;
#[cfg(feature = "zenoh")]
mod zenoh;
