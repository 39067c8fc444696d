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

mod articulated_body;
mod articulated_inertia;
mod base_velocity;
mod composite_inertia;
mod inverse_dynamics;
mod joint_groups;
mod joint_transform;
mod kernel_frames;
mod lanes;
mod momentum_columns;
mod momentum_map;
mod planar_rotation;
mod quaternion;
mod scalar;
mod sin_cos;
mod tree;
mod vector;

pub use articulated_body::{Slot, forward_dynamics};
pub use articulated_inertia::ArticulatedInertia;
pub(crate) use base_velocity::whole_inertia;
pub use base_velocity::{Carried, base_spin};
pub use inverse_dynamics::inverse_dynamics;
pub(crate) use joint_groups::Joints;
pub use joint_transform::{Force, Motion};
pub use lanes::{Eight, GROUP, Lanes};
pub use momentum_columns::Column;
pub use momentum_map::{Place, System, generalized_jacobian, momentum_map};
pub use planar_rotation::Turn;
pub use quaternion::{Attitude, SMALL_TURN, small_turn_rate};
pub use scalar::Scalar;
pub use sin_cos::sin_cos;
pub use tree::Tree;
pub use vector::{Mat3, Sym3, Vec3};
