//! Closed loops: constraints between bodies of a tree.
//!
//! A [`LoopClosure`] constrains two frames of the tree in some directions. [`Loops`] are the closures of one model with
//! their scratch memory. Constraint forces are internal: they do not change momentum, and act on the joints only,
//! through the reduced inertia `Ĥ`.
//!
//! Constraints may be redundant (a planar loop closed in all six directions, an overconstrained linkage) and may lose rank
//! in isolated states (a pantograph that passes its stretched state). No matrix that can be singular is inverted: the
//! constraints' normals, weighted with `Ĥ⁻¹`, are orthonormalized with pivoting, and the remainder of a normal that depends
//! on the others is dropped. Positions and rates are projected onto the constraints at every stage of a step, since a
//! singular state would amplify accumulated integration errors. Where rank is lost, the acceleration is the limit from both
//! sides along the motion.
//!
//! The method is that of TR-942 eqs. (2.3.39)-(2.3.47), which cuts the loops open, applied to the reduced system. It also works at
//! singular states, where the report's solution (2.3.46) inverts a singular matrix.

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
