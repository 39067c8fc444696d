//! Rules of the repository: layers, file lengths, and documents that agree with the sources.

mod documents;
#[cfg(feature = "ros")]
mod first_hour;
#[cfg(feature = "ros")]
mod generated;
mod layers;
mod package;
#[cfg(feature = "ros")]
mod readme;
mod sources;
