//! Dynamics, control and motion estimation for free-floating space robots.

pub mod control;
pub mod dynamics;
pub mod estimation;
pub mod model;
pub mod spatial;
pub mod vision;
