//! Robot models: bodies in topological order, joints, named frames.
//!
//! A [`Model`] is compiled once (from a URDF: [`Model::from_urdf`], or by hand: [`ModelBuilder`]) and never
//! changes. Body 0 is the base; moving joint `k` of the tree moves body `k + 1`. Bodies are numbered depth first, so
//! that a parent comes before its children and every subtree is one contiguous range. A model has no fixed
//! joints: a link that is fixed to a body is merged into its inertia, and its frame is kept as a named [`Frame`].
//! Mimic joints have no coordinate: a model with them has more joints in its tree than in [`Model::joints`]
//! ([`Coupling`]).

mod build;
mod coupling;
mod joined;
mod tree;
mod urdf;

pub use build::ModelBuilder;
pub use coupling::{Coupling, Mimic};
pub use joined::{Connection, Joined};
pub use tree::{Body, Frame, Joint, JointKind, JointLimits, Model, Spring};
pub use urdf::{
    CollisionElement, CollisionGeometry, Repair, RepairKind, Repaired, UrdfError, UrdfProblem,
    without_surroundings,
};
