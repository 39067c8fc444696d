//! Guidance of a capture: rendezvous, impedance of the tip, and whole missions against simulated bodies.

mod impedance;
mod mission;
mod rendezvous;
mod world;
