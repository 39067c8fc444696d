//! Compliant contact of floating systems: shapes, the law of forces, and a world that steps several systems together.
//!
//! A [`ContactWorld`] owns [`Floating`](crate::dynamics::Floating) systems. [`Shape`]s are fixed to their bodies; pairs
//! of shapes touch under a [`ContactLaw`]: dissipative springs (Hunt and Crossley), smooth Coulomb friction or
//! bristles. Contact forces are equal and opposite at one point, so that total momentum does not change. Events are
//! located, and steps are controlled by their error.

mod coupling;
mod driven;
mod error;
mod events;
mod law;
mod polyhedron;
mod radau;
mod scene;
mod shape;
mod stepping;
mod touch;
mod world;

pub use error::ContactError;
pub use events::{ColliderId, ContactEvent, ContactPoint, ContactWork};
pub use law::{Bristle, ContactLaw, LawError};
pub use polyhedron::Polyhedron;
pub use shape::{Shape, ShapeError};
pub use world::ContactWorld;
