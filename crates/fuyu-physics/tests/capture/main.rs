//! Capture: impulses, the motion of what has been joined, contact, the gripper.
//!
//! The numbers in `fixtures` are from other programs (Pinocchio, and Newton-Euler equations in maximal coordinates), which share
//! no code with this library.

mod contact;
mod gripper;
mod impulse;
mod motion;
mod support;
