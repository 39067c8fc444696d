//! The crate against fixtures that were computed independently, printed values, closed forms and second formulations.

mod air_table;
mod analysis;
mod chapter3;
mod chapter4;
mod equations;
mod hinf;
mod models;
mod servicer;
mod support;
