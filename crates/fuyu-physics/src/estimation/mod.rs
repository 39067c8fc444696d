//! How an unknown tumbling body moves, from what a camera sees of it.
//!
//! Input is [`Tracks`]: image points of one body over time. Output is a [`MotionEstimate`]: the body's rotation
//! in closed form ([`free_body`]), which also tells its future. Frames: C is the camera's optical frame, which is
//! taken to be inertial; B is fixed to the body, but otherwise arbitrary.

pub mod bundle;
mod degenerate;
pub mod elliptic;
mod error;
pub mod evaluation;
pub mod filter;
pub mod free_body;
pub mod masutani1995;
mod method;
mod motion;
mod tracks;
pub mod two_view;

pub use crate::vision::{Feature, Sighting};
pub use error::EstimateError;
pub use method::{Estimated, Method, MethodError, estimate, from_rates};
pub use motion::{MotionEstimate, MotionModel};
pub use tracks::{Tracks, TracksError};
