//! Closed loops: TR-942's pantograph through its singular states, linkages against their loop-free
//! equations, redundant constraints, and errors.

mod kinds;
mod linkages;
pub mod mechanisms;
mod pantograph;
mod refusals;
