//! Recursive dynamics algorithms over the tree, for any number type.
//!
//! A [`Tree`] is a model compiled into kernel frames. [`forward_dynamics`] and [`inverse_dynamics`] use one
//! [`LinkScratch`] per body, [`base_angular_velocity`] one [`SubtreeMomentum`], [`momentum_map`] and
//! [`generalized_jacobian`] one [`LinkPlacement`] per body and one [`MomentumColumn`] per joint. All take time linear in the
//! number of joints, allocate nothing and return no errors: input that is not finite gives results that are not finite.
//! The number type is any [`Scalar`]: `f64`, SIMD registers of it, or one of the caller's.
//!
//! `Workspace`, `ArticulatedBody` and `Batch` are built on these functions, and are the better choice for callers that
//! do not need their own number type.

// Functions are inlined into the dispatched entry points, so that the compiler uses the instructions enabled there. Without
// optimisation, inlining gives every temporary its own place on the stack, 12 MiB in total: there only the small operations
// are inlined (`cfg_attr(not(debug_assertions), ..)` on the others).

mod articulated_body;
mod articulated_inertia;
mod base_velocity;
mod composite_inertia;
mod inverse_dynamics;
mod joint_groups;
mod joint_transform;
mod kernel_frames;
mod lanes;
mod link_scratch;
mod momentum_columns;
mod momentum_map;
mod planar_rotation;
mod quaternion;
mod scalar;
mod sin_cos;
mod tree;
mod vector;

pub use articulated_body::forward_dynamics;
pub(crate) use articulated_body::{articulated_tree, propagate_acceleration};
pub(crate) use articulated_inertia::ArticulatedInertia;
pub use base_velocity::{SubtreeMomentum, base_angular_velocity};
pub(crate) use base_velocity::{locked_inertia, whole_tree};
pub use inverse_dynamics::inverse_dynamics;
pub(crate) use joint_groups::JointKinematics;
pub use joint_transform::{SpatialForce, SpatialMotion};
pub(crate) use lanes::{F64x8, GROUP_SIZE, Lanes};
pub use link_scratch::LinkScratch;
pub use momentum_columns::MomentumColumn;
pub use momentum_map::{LinkPlacement, SystemInertia, generalized_jacobian, momentum_map};
pub use planar_rotation::PlanarRotation;
pub(crate) use quaternion::{Quat, SERIES_LIMIT, rotation_vector_rate_series};
pub use scalar::Scalar;
pub(crate) use sin_cos::sin_cos;
pub use tree::Tree;
pub use vector::{Mat3, Sym3, Vec3};
