//! Estimation of the motion of an unknown tumbling body from images.
//!
//! Input: [`Tracks`], image points of one body over time. Result: a [`MotionEstimate`], the body's rotation in closed
//! form ([`free_body`]), which also predicts its future. [`estimate`] is the entry point for all methods;
//! [`MotionTracker`] updates a result with every further frame.
//!
//! Frames: C is the camera's optical frame, inertial unless a [`bundle::CameraMotion`] is given; B is fixed to the
//! body, but otherwise arbitrary.

pub mod bundle;
mod change_detector;
mod degenerate;
pub mod elliptic;
mod error;
pub mod evaluation;
pub mod filter;
pub mod free_body;
mod gyro_attitude;
pub mod inertia;
pub mod masutani1995;
mod method;
mod motion;
mod motion_state;
mod motion_tracker;
mod rate_fit;
mod tracks;
mod two_view;

pub use crate::vision::{Feature, FeatureFrame};
pub use error::EstimateError;
pub use gyro_attitude::{GYRO_GAP, GyroAttitude};
pub use method::{Estimated, EstimationMethod, MethodError, estimate, from_rates};
pub use motion::{MotionEstimate, MotionModel};
pub use motion_state::{Disturbance, MotionState};
pub use motion_tracker::{BatchSolution, MIN_KNOWN_POINTS, MotionSource, MotionTracker, TrackLoss};
pub use rate_fit::fit_rates;
pub use tracks::{Tracks, TracksError};
pub use two_view::TwoViewError;
