//! The matrix method of TR-942 section 2.2: Newton's and Euler's equations of each body, with hinges of 0 to 6 degrees of
//! freedom between any two bodies, and the forces in the hinges as unknowns.
//!
//! A [`System`] is any number of [`Body`]s and [`Hinge`]s, in chains, trees and loops, floating or joined to inertial
//! space. [`System::assemble`] creates an initial state with 13 numbers per body, and refuses loops that do not close
//! and redundant constraints. [`MatrixMethod`] computes the state's rates, accelerations, and the forces and torques in
//! every hinge. The method shares no code with the reduced form of [`super::Workspace`], so that each checks the other;
//! [`NewtonEuler`] is the method as a formulation for a [`crate::model::Model`].
//!
//! Integration errors violate momentum conservation and constraints; [`MatrixMethod::project`] moves a state back onto
//! the constraints.
//!
//! ```
//! use fuyu_physics::dynamics::newton_euler::{Axis, Freedom, Hinge, INERTIAL, Load, MatrixMethod, Start, SystemBuilder};
//! use fuyu_physics::spatial::{Pose, RigidInertia};
//! use nalgebra::{Matrix3, Vector3};
//!
//! // Two balls on a rod of 1 m, one of them with the rod, that spin about each other.
//! let ball = RigidInertia { mass: 2.0, com: Vector3::zeros(), about_com: Matrix3::identity() * 0.1 };
//! let system = SystemBuilder::new()
//!     .body("one", ball)
//!     .body("other", ball)
//!     .hinge(Hinge::new("float", INERTIAL, "one", Freedom::FREE))
//!     .hinge(Hinge::new("rod", "one", "other", Freedom::LOCKED).at(Pose::translation(1.0, 0.0, 0.0), Pose::identity()))
//!     .build()?;
//! let start = Start::new()
//!     .with("float", Axis::TranslationY, 0.0, -1.5)
//!     .with("float", Axis::RotationZ, 0.0, 3.0);
//! let state = system.assemble(&start)?;
//! let mut method = MatrixMethod::new(&system);
//! method.solve(&system, &state, &Load::zero(&system));
//! // The rod pulls the outer ball inward with m ω² r.
//! let rod = method.hinge_wrench(&system, system.hinge("rod").unwrap());
//! assert!((rod.force - Vector3::new(-2.0 * 9.0 * 0.5, 0.0, 0.0)).norm() < 1e-12);
//! # Ok::<(), fuyu_physics::dynamics::newton_euler::SystemError>(())
//! ```

mod augmented;
mod axis;
mod bodies;
mod error;
mod gear;
mod hinge_motion;
mod method;
mod projection;
mod qr_factorization;
mod redundancy;
mod start;
mod state;
mod system;
mod tree;

pub use axis::{Axis, Freedom};
pub use error::SystemError;
pub use method::{Load, MatrixMethod};
pub use start::Start;
pub use state::BodyState;
pub use system::{Body, Hinge, INERTIAL, System, SystemBuilder};
pub use tree::NewtonEuler;
