//! Closed loops and analyses, run without a ROS graph.

mod closed_loop;
mod performance;
mod simulated_bag;

pub use closed_loop::{ClosedLoop, Moment};
pub use performance::{MomentumResidual, Performance, Summary};
pub use simulated_bag::SimulatedBag;
