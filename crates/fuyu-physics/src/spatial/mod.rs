//! Rotations, poses, spatial vectors and inertias.
//!
//! # Notation
//!
//! Quantities carry their frames in their names, in monogram style:
//!
//! | name | meaning |
//! | --- | --- |
//! | `R_AB` | rotation that takes components in frame B to components in frame A |
//! | `X_AB` | pose of frame B in frame A: `p_A = X_AB * p_B` |
//! | `p_AoBo_C` (short `p_AB`, expressed in A) | position from A's origin to B's origin, components in C |
//! | `w_AB_C` | angular velocity of B in A, components in C \[rad/s\] |
//! | `v_AB_C` | velocity of B's origin in A, components in C \[m/s\] |
//! | `I_BP_C` | rotational inertia of body B about point P, components in C \[kg m²\] |
//!
//! W is the inertial world, I the non-rotating frame at the system's centre of mass, B the base (`base_link`), E the
//! tip (end effector), D the desired tip pose (goal), C the system's centre of mass. All units are SI.
//! `docs/symbols.md` defines further frames, and the inertias.
//!
//! # Conventions
//!
//! - Order: [`Twist`] and [`Wrench`] are angular first, in their fields and in the arguments of their constructors:
//!   `Twist { angular, linear }`, `Wrench { torque, force }`. They are never stacked into a vector of six; code reads the
//!   named fields. The matrices with six rows (Jacobians, base map) are linear first, as in Masutani 1995: rows 0 to 2 are
//!   the velocity of the point, rows 3 to 5 the angular velocity.
//! - A twist's linear part is the velocity of the point at the frame's origin. In accelerations it is the acceleration of
//!   that point, not the spatial acceleration of Featherstone.
//! - Arguments: functions take vectors, matrices, poses, twists and wrenches by reference, as nalgebra does, and return
//!   values. Constructors and builders take by value what they store. The operators `+`, `-` and `*` take twists and
//!   wrenches by value, since they are `Copy`. The generic kernels (`dynamics::kernel`) pass vectors by value, so that
//!   they stay in registers.

mod inertia;
mod nearest_inertia;
mod rotation;
mod segments;
mod symmetric;
mod vector;

pub use inertia::{InertiaError, RigidInertia, SpatialInertia};
pub(crate) use rotation::rotation_vector_rate;
pub use rotation::{
    exp_so3, roll_pitch_yaw_intrinsic, rotation_from_roll_pitch_yaw_intrinsic, unwound,
};
pub(crate) use segments::closest_points;
pub use symmetric::Symmetric3;
pub use vector::{Twist, Wrench};

/// A pose `X_AB` with its rotation as a matrix, as the recursions use it.
pub type Pose = nalgebra::IsometryMatrix3<f64>;
