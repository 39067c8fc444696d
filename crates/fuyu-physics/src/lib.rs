//! Dynamics, control and motion estimation of free-floating space robots.
//!
//! A free-floating base has no actuator: when the arm moves, the base moves too. This library computes with that
//! motion: the generalized Jacobian, forward dynamics with momentum as state, control laws, camera models, and the
//! estimation of a tumbling target's motion. It reads no files, and its only threads are rayon's.
//!
//! | module | contents |
//! | --- | --- |
//! | [`spatial`] | rotations, twists, wrenches, inertias |
//! | [`model`] | a URDF compiled into bodies, joints and frames |
//! | [`dynamics`] | kinematics, momentum, generalized Jacobian, forward and inverse dynamics, integrators, batches |
//! | [`control`] | control laws, guidance of a capture |
//! | [`vision`] | cameras on the moving base |
//! | [`estimation`] | the motion of an unknown tumbling body |
//!
//! # From a URDF to the generalized Jacobian
//!
//! ```
//! use fuyu_physics::{dynamics::Workspace, model::Model};
//! use nalgebra::{DVector, Matrix6xX};
//!
//! let urdf = r#"
//!     <robot name="boom">
//!       <link name="base_link"><inertial><mass value="100"/>
//!         <inertia ixx="10" iyy="10" izz="10" ixy="0" ixz="0" iyz="0"/></inertial></link>
//!       <link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="10"/>
//!         <inertia ixx="0.1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
//!       <link name="tool0"/>
//!       <joint name="shoulder" type="continuous"><parent link="base_link"/><child link="arm"/>
//!         <origin xyz="1 0 0"/><axis xyz="0 0 1"/></joint>
//!       <joint name="flange" type="fixed"><parent link="arm"/><child link="tool0"/>
//!         <origin xyz="1 0 0"/></joint>
//!     </robot>"#;
//! let model = Model::from_urdf(urdf, "boom.urdf")?; // the name is for error messages
//! let tip = model.frame("tool0").expect("a link of the robot");
//!
//! let mut workspace = Workspace::new(&model);
//! workspace.set_positions(&DVector::from_element(1, 0.3));
//! let mut fixed = Matrix6xX::zeros(model.dof()); // rows: linear, then angular
//! let mut generalized = Matrix6xX::zeros(model.dof());
//! workspace.fixed_base_jacobian(tip, &mut fixed);
//! workspace.generalized_jacobian(tip, &mut generalized);
//!
//! // The base turns the other way, so the tip turns less than the joint.
//! assert_eq!(fixed[(5, 0)], 1.0);
//! assert!(generalized[(5, 0)] > 0.0 && generalized[(5, 0)] < 1.0);
//! # Ok::<(), fuyu_physics::model::UrdfError>(())
//! ```
//!
//! [`dynamics::Floating`] steps one robot, [`dynamics::Batch`] thousands of states of one; both have examples.
//!
//! # Names and units
//!
//! Quantities have their frames in their names, in monogram notation (`X_AB`, `R_WB`, `w_WB_B`); [`spatial`] has the
//! table. In your crate, `#![allow(non_snake_case)]` silences the compiler's warnings about such names. All units are
//! SI; frames and axes are those of REP-103 and REP-105.

pub mod control;
pub mod dynamics;
pub mod estimation;
pub mod model;
pub mod spatial;
pub mod vision;

/// Compiles the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
