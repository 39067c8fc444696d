//! How an unknown tumbling body moves, from what a camera sees of it.
//!
//! Input is [`Tracks`]: image points of one body over time. Frames: C is the camera's optical frame, which is
//! taken to be inertial; B is fixed to the body, but otherwise arbitrary.

pub mod bundle;
mod tracks;
pub mod two_view;

pub use crate::vision::{Feature, Sighting};
pub use tracks::{Tracks, TracksError};
