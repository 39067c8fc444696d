//! Runs without a ROS graph (`fuyu simulate`, `fuyu campaign`), published results (`fuyu reproduce`), and analysis of
//! recorded runs (`fuyu bag check`, `plot` and `render`).

mod bag_check;
mod bag_plot;
mod bag_scene;
mod balance;
pub mod campaign;
mod capturing;
mod chart;
mod closed_loop;
mod continuous_loop;
mod estimation_loop;
mod estimation_plot;
mod events;
mod final_state;
mod fleet;
mod grasp_load;
pub mod kida1993;
pub mod masutani_ch3;
pub mod masutani_ch5;
pub mod masutani_ch6;
pub mod masutani_ch7;
pub mod masutani_ch8;
pub mod masutani_g;
mod mission_summary;
mod observations;
mod operated;
pub mod operation_counts;
mod other_bodies;
mod performance;
mod recorded;
mod recorded_contacts;
mod recorded_estimation;
pub mod recorded_mission;
mod recorded_names;
mod recorded_physics;
mod recorded_runs;
pub mod reproduce;
mod simulated_bag;
mod simulated_images;
pub mod simulation;
mod simulation_notes;
mod simulation_together;
mod target_summary;
mod tip_check;
mod topic_health;
pub mod tr942;
pub mod tracking;

pub use bag_check::{CheckLimits, CheckLine, CheckReport, Verdict, check_bag};
pub use bag_plot::plot_bag;
pub use bag_scene::{PictureError, PictureOptions, PictureTimes, Pictures, render_bag};
pub use balance::{Balance, MomentumResidual};
pub use capturing::{CaptureAnswer, Capturing};
pub use chart::{
    ChartError, Dots, Figure, MapFigure, MapPanel, MapScale, Mark, Marks, Panel, PlaneFigure,
    Series, ShapeFigure, ShapePanel,
};
pub use closed_loop::{Answer, AttitudeAnswer, ClosedLoop, Moment};
pub use continuous_loop::ContinuousLoop;
pub use estimation_loop::EstimationLoop;
pub use events::{Event, EventWatch};
pub use final_state::{
    FinalAppendage, FinalContact, FinalMomentum, FinalMotor, FinalState, FinalTarget, FinalWheel,
};
pub use fleet::Fleet;
pub use grasp_load::GraspLoad;
pub use mission_summary::{MissionSummary, PhaseSummary, mission_lines};
pub use observations::{Observations, ObservedTracks, Tracking};
pub use operated::{Drive, Operated};
pub use other_bodies::OtherBodies;
pub use performance::{Figures, Performance, Summary};
pub use recorded::{
    BaseSample, ControllerSample, DeformationSample, ExternalSample, JointSample, MomentumSample,
    RecordedRun, RecordedRuns, SeenPose,
};
pub use recorded_names::title_of;
pub use recorded_physics::{Residual, momentum_residuals};
pub use recorded_runs::RunCounter;
pub use simulated_bag::{Recorded, SimulatedBag};
pub use simulated_images::SimulatedImages;
pub use simulation_notes::{check_robots, notes, warnings};
pub use simulation_together::simulate_together;
pub use target_summary::TargetSummary;
pub use topic_health::{TopicHealth, TopicWatch};
