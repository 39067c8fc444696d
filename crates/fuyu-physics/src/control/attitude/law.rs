//! Interface of an attitude law.

use std::fmt::Debug;

use fuyu_lti::{LtiError, StateSpace};
use nalgebra::Vector3;

use super::AttitudeDeviation;

/// An attitude law: computes the torque on the base from its deviation. A step allocates no memory.
pub trait AttitudeLaw: Debug + Send {
    /// Torque on the base, base axes \[N m\], to be held until the next sample.
    fn torque(&mut self, deviation: &AttitudeDeviation) -> Vector3<f64>;

    /// Discards past deviations: the next one belongs to another run.
    fn reset(&mut self) {}

    /// The law in continuous time, from `[angle; rate]` (six inputs) to the torque, closed by negative feedback.
    ///
    /// # Errors
    /// [`LtiError`] if the law has no such form.
    fn linear(&self) -> Result<StateSpace, LtiError>;
}
