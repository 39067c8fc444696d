//! How far the estimator's covariances can be trusted: problems from a simulator that shares no code with it, solved
//! and judged by category. `cargo test --release -p fuyu-physics --test estimation -- --ignored --nocapture` prints
//! the tables of docs/estimation.md.
#![allow(non_snake_case)]

mod judge;
mod problems;
mod push;
mod ranges;
mod rates;
mod world;
