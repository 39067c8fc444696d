//! Robots with deformable bodies, elastic joints, wheels and thrusters, against independent computations.
//!
//! The numbers in `fixtures` are from another program (Python: world-axis Jacobians per body, mass invariants, DOP853
//! at a relative tolerance of 1e-13), which was checked against Pinocchio and SLICOT. Quaternions are x, y, z, w.

#![allow(non_snake_case)]

mod attitude;
mod chain;
mod conservation;
mod cost;
mod elastic_joints;
mod elastic_links;
mod hold;
mod limits;
mod linear;
mod no_allocation;
mod runs;
mod second_order;
mod segments;
mod support;
mod thrusters;
mod wheels;
