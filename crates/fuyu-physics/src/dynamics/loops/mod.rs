//! Closed loops: a tree whose bodies are also held to each other.
//!
//! A [`LoopClosure`] holds two frames of the tree together in some directions. [`Loops`] are the closures
//! of one model with their scratch. Constraint forces are internal, so momentum stays state and nothing
//! here touches it; they act on the joints alone, through the reduced inertia `Ĥ`.
//!
//! Constraints may be redundant (a planar loop closed in all six directions, a linkage that moves only
//! thanks to its proportions) and may lose rank for a moment (a pantograph that passes its stretched
//! state). So nothing is inverted that may not be: the constraints' normals, weighted with `Ĥ⁻¹`, are made
//! orthonormal with pivoting, and what is left of a normal that depends on the others is dropped.
//! Positions and rates are projected onto the constraints at every stage of a step, so that
//! integration error cannot collect where a singular state would multiply it; where rank is lost, the
//! acceleration is its limit from both sides along the motion.
//!
//! This is the cutting of loops of TR-942 eqs. (2.3.39)-(2.3.47) on the reduced system, with what the
//! report left open: its solution (2.3.46) inverts a matrix that is singular there.

mod assembly;
mod closure;
mod constraints;
mod error;
mod forces;
mod normals;
mod singular;

pub use closure::{Direction, LoopClosure, LoopGap};
pub use constraints::Loops;
pub use error::LoopError;
