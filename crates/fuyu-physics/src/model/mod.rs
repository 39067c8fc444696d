//! A robot as the algorithms want it: bodies in topological order, joints, named frames.
//!
//! A [`Model`] is compiled once (from a URDF: [`Model::from_urdf`], or by hand: [`ModelBuilder`]) and never
//! changes. Body 0 is the base; moving joint `j` moves body `j + 1`. Bodies are numbered depth first, so
//! that a parent comes before its children and every subtree is one contiguous range. Fixed joints do not
//! exist any more: what they carried is merged into their parent's inertia, and their frames stay as
//! named [`Frame`]s.

mod build;
mod tree;
mod urdf;

pub use build::ModelBuilder;
pub use tree::{Body, Frame, Joint, JointKind, JointLimits, Model, Spring};
pub use urdf::{UrdfError, UrdfProblem};
