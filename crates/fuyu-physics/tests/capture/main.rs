//! Capture: impulses, the motion of what has been joined, contact, the gripper.
//!
//! The numbers in `fixtures` are from other programs (Pinocchio, and Newton-Euler equations in maximal
//! coordinates), which share no code with this library.

mod contact;
mod detumble;
mod gripper;
mod gyrostat;
mod identify;
mod impulse;
mod motion;
mod no_allocation;
mod support;
mod two_arms;
