//! The `fuyu` executable as a user meets it: exit codes, what it prints, what it says about bad input.

mod bad_urdf;
mod control;
mod estimate;
mod estimate_bad_input;
mod examples;
mod free_motion;
mod fuyu;
mod inspect;
mod reproduce;
mod tracking;
mod views;
