//! Torque-free rotation of a rigid body in closed form: Masutani 1995 sec. 2.3 and app. B.
//!
//! [`DynamicParameters`] are the parameters of a body that its motion determines; a [`FreeRotation`] is one motion with
//! its attitude.

mod aperiodic;
mod herpolhode;
mod parameters;
mod periodic;
mod rotation;

pub use herpolhode::Herpolhode;
pub use parameters::{DynamicParameters, ParametersError};
pub(crate) use rotation::frame;
pub use rotation::{FreeRotation, FreeRotationError, SolutionKind};
