//! Validation of the physics against independent numbers and identities.
//!
//! Each module names the source of its reference values, and each tolerance is explained.

#[cfg(feature = "batch")]
mod batch;
mod bundle;
mod certainty;
mod conservation;
mod elliptic;
mod filter;
mod fixtures;
mod formulations;
mod free_body;
mod free_body_closed_form;
mod generalized_jacobian;
mod half_a_minute;
mod kane;
mod latency;
mod loops;
mod lyapunov;
mod masutani1995;
mod masutani_ch3;
mod masutani_ch6;
mod masutani_ch7;
#[cfg(feature = "batch")]
mod misuse;
mod newton_euler;
mod no_allocation;
mod null_space;
mod operation_counts;
mod operational_space;
#[cfg(feature = "ros")]
mod pinocchio;
mod positioning;
mod precision;
#[cfg(feature = "ros")]
#[path = "../support/python.rs"]
mod python;
mod random_trees;
#[cfg(feature = "ros")]
mod sampled_loops;
mod singularity_escape;
mod teleoperation;
mod tracking;
mod trees;
mod tumbling;
