//! fuyu beside stacks that no one here wrote (rclpy of Jazzy and Kilted on Fast DDS, CycloneDDS), on networks that
//! lose and delay, with peers that die, lie or share a name; and for as long as it takes.

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
#[path = "../support/waiting.rs"]
mod waiting;

mod child;
mod dynamics_restart;
mod echo;
mod hashes;
mod hostile;
mod launch_files;
mod load;
mod lossy;
mod matrix;
mod names;
mod robots;
mod security;
mod soak;
mod speed;
mod time_jumps;
