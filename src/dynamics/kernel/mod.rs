//! The recursions over the tree, for any kind of number.

mod articulated;
mod hop;
mod scalar;
mod sin_cos;
mod tree;
mod turn;
mod vector;

pub use articulated::{Branch, Slot, forward_dynamics};
pub use hop::{ArticulatedInertia, Force, Motion};
pub use scalar::{Fused, Scalar};
pub use sin_cos::{GROUP, sin_cos};
pub use tree::Tree;
pub use turn::Turn;
pub use vector::{Mat3, Sym3, Vec3};
