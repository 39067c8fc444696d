//! Models of the body's pose in every frame.

pub mod free_positions;
pub mod independent_poses;
pub mod linear_com_motion;
