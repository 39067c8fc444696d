//! The library against closed forms, printed tables, independent computations (`../fixtures`, which another program made with other
//! formulations) and second formulations.

#![allow(non_snake_case, missing_docs)]

mod empty;
mod kida_tables;
mod kinetics;
mod links;
mod modes_files;
mod nodal;
mod panel;
mod random;
mod servicer;
mod spin;
mod support;
mod theorems;
mod vehicle;
