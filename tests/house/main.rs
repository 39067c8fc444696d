//! The order of the house: what the documents and the layout promise about the sources.

mod documents;
mod layers;
mod package;
mod sources;
