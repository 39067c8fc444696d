<<<<<<< HEAD
//! Closed loops and published results, and what recordings of them show.

mod bag_check;
mod bag_plot;
mod chart;
mod recorded;
mod topic_health;

pub use bag_check::{CheckLimits, CheckLine, CheckReport, Verdict, check_bag};
pub use bag_plot::plot_bag;
pub use chart::{ChartError, Figure, Panel, Series};
pub use recorded::{
    BaseSample, ControllerSample, JointSample, MomentumSample, RecordedRun, RecordedRuns,
};
pub use topic_health::{TopicHealth, TopicWatch};
=======
//! Closed loops and analyses, run without a ROS graph.

mod closed_loop;
mod performance;
mod simulated_bag;

pub use closed_loop::{ClosedLoop, Moment};
pub use performance::{MomentumResidual, Performance, Summary};
pub use simulated_bag::SimulatedBag;
>>>>>>> main
