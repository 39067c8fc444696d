//! Damping, friction, stops and speed limits of joints, against closed forms.

#![allow(non_snake_case)]

mod balance;
mod batch;
mod damping;
mod friction;
mod no_allocation;
mod robots;
mod stops;
