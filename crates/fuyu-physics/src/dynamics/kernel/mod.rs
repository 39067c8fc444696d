//! The recursions over the tree, for any kind of number.
//!
//! A [`Tree`] is a model in the frames that suit them. [`forward_dynamics`] and [`inverse_dynamics`] sweep over
//! one [`Slot`] per body, [`base_spin`] over one [`Carried`], [`momentum_map`] and [`generalized_jacobian`] over one
//! [`Place`] and one [`Column`]. All cost time
//! linear in the number of joints, take no memory and have no errors: what is not finite shows in the results.
//! The number is any [`Scalar`]: `f64`, [`Lanes`] of it, or one's own.
//!
//! They are what `Workspace`, `ArticulatedBody` and `Batch` are made of, and open to those who bring their own
//! number; everybody else is better served by these.

mod articulated;
mod attitude;
mod columns;
mod composite;
mod frames;
mod gather;
mod group;
mod hop;
mod inertia;
mod inverse;
mod lanes;
mod scalar;
mod sin_cos;
mod spin;
mod tree;
mod turn;
mod vector;

pub use articulated::{Slot, forward_dynamics};
pub use attitude::{Attitude, SMALL_TURN, small_turn_rate};
pub use columns::Column;
pub use composite::{Place, System, generalized_jacobian, momentum_map};
pub(crate) use group::Joints;
pub use hop::{Force, Motion};
pub use inertia::ArticulatedInertia;
pub use inverse::inverse_dynamics;
pub use lanes::{Eight, GROUP, Lanes};
pub use scalar::Scalar;
pub use sin_cos::sin_cos;
pub(crate) use spin::whole_inertia;
pub use spin::{Carried, base_spin};
pub use tree::Tree;
pub use turn::Turn;
pub use vector::{Mat3, Sym3, Vec3};
