//! Prediction of tip and goal at the present time, from late and infrequent camera measurements.
//!
//! The predictions use the frame I, which does not rotate and whose origin is the system's centre of mass. No external
//! force acts on a free-floating robot, so I is inertial, and the robot knows its motion in I for any linear momentum:
//! the gyro gives the attitude of the base, the encoders its position (`BaseMotion`). A goal that floats freely also
//! moves inertially in I, so its measured motion can be extrapolated from the exposure to the present (`GoalMotion`).
//! The tip's pose follows from the encoders. `Predictor` combines the three motions.
//!
//! The motion of the base is measured, not estimated from the camera. So the arm's own motion does not disturb the
//! estimate of the goal's motion, and the loop through the camera has no remaining delay if masses, gyro and encoders
//! are exact. Latency then costs accuracy, not stability.

mod base_motion;
mod goal_motion;
mod predictor;

pub use goal_motion::GoalMotionConfig;
pub use predictor::{Prediction, TipPrediction};

pub(in crate::control) use base_motion::BaseMotion;
use base_motion::BaseState;
use goal_motion::GoalMotion;
pub(super) use predictor::Predictor;
