//! Mass, centre of mass and inertia of a captured or pushed body.
//!
//! Images give ratios of moments of inertia; a known change of momentum gives the scale. For a captured body the known
//! momentum is that of the robot's own arm: [`identify`] needs only the base's gyro and attitude, and the joints' encoders.
//! [`identify_from_twists`] also uses the base's velocity; [`identify_from_pushes`] uses known impulses on a free
//! body, before it is captured.

mod gyro;
mod linear;
mod parameters;
mod pushes;
mod twists;

pub use gyro::{GyroSample, Identified, identify};
pub use linear::{Excitation, IdentificationError};
pub use parameters::{InertiaCovariance, InertiaParameters};
pub use pushes::{Push, identify_from_pushes};
pub use twists::{TwistSample, identify_from_twists};
