//! Rules of the repository: layers, file lengths, and documents that agree with the sources.

#[cfg(feature = "ros")]
#[path = "../support/python.rs"]
#[expect(dead_code, reason = "no script is given an input here")]
mod python;

mod cargo_tree;
mod documents;
#[cfg(feature = "ros")]
mod first_hour;
#[cfg(feature = "ros")]
mod generated;
mod layers;
mod package;
#[cfg(feature = "ros")]
mod readme;
mod shared_builds;
mod sources;
#[cfg(feature = "ros")]
mod your_own_arm;
