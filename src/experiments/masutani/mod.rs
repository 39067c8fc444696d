//! Runs of Masutani 1995: what was simulated.

pub mod positioning;
