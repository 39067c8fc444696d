//! The physical evidence: fuyu against numbers and identities that do not share its code.
//!
//! Each module names its source. Where a tolerance stands, the reason stands beside it.

mod bundle;
mod conservation;
mod elliptic;
mod fixtures;
mod free_body;
mod free_body_closed_form;
mod generalized_jacobian;
mod kane;
mod masutani1995;
mod masutani_ch3;
mod newton_euler;
mod no_allocation;
#[cfg(feature = "ros")]
mod pinocchio;
mod positioning;
mod random_trees;
mod trees;
mod tumbling;
