//! The recursions over the tree, for any kind of number.

mod articulated;
mod composite;
mod hop;
mod inverse;
mod lanes;
mod scalar;
mod sin_cos;
mod tree;
mod turn;
mod vector;

pub use articulated::{Slot, forward_dynamics};
pub use composite::{Place, System, generalized_jacobian, momentum_map};
pub use hop::{ArticulatedInertia, Force, Motion};
pub use inverse::inverse_dynamics;
pub use lanes::Lanes;
pub use scalar::Scalar;
pub use sin_cos::{GROUP, sin_cos};
pub use tree::Tree;
pub use turn::Turn;
pub use vector::{Mat3, Sym3, Vec3};
