//! Prediction of tip and goal at the present, from camera measurements that are late and slow.
//!
//! The predictions use one frame that the robot knows without seeing the world: I, which does not rotate and
//! whose origin moves with the system's centre of mass. Nothing outside acts on a free-floating robot, so I is
//! inertial. The gyro gives the attitude of the base in I and the encoders its position (`BaseMotion`), for any
//! linear momentum. A goal that floats freely also moves inertially in I, so its measured
//! motion can be extrapolated from the exposure to the present (`GoalMotion`); the tip's pose follows from
//! the encoders. `Predictor` joins the three.
//!
//! The motion of the base is measured, not estimated from the camera: the arm's own motion does not disturb the estimate
//! of the goal's motion, and the loop through the camera has no remaining delay as far as masses, gyro and encoders
//! are right. Latency then costs accuracy, not stability.

mod base_motion;
mod goal_motion;
mod predictor;

pub use goal_motion::GoalMotionConfig;
pub use predictor::{Prediction, TipPrediction};

pub(in crate::control) use base_motion::BaseMotion;
use base_motion::BaseState;
use goal_motion::GoalMotion;
pub(super) use predictor::Predictor;
