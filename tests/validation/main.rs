//! The physical evidence: fuyu against numbers and identities that do not share its code.
//!
//! Each module names its source. Where a tolerance stands, the reason stands beside it.

mod conservation;
mod fixtures;
mod free_body;
mod generalized_jacobian;
mod kane;
mod no_allocation;
#[cfg(feature = "ros")]
mod pinocchio;
mod positioning;
mod random_trees;
mod trees;
