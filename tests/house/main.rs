//! The order of the house: what the documents and the layout promise about the sources.

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
