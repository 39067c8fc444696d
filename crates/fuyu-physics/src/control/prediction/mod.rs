//! Where tip and goal are now, as a camera on the base tells that is late and slow.
//!
//! Everything rests on one frame that the robot can know without seeing the world: I, which does not turn and
//! whose origin moves with the system's centre of mass. Nothing outside acts on a free-floating robot, so I is
//! inertial. The gyro tells how the base is turned in I and the encoders where it is ([`BaseMotion`]), whatever
//! the linear momentum is. A goal that floats freely too keeps to the laws of free motion in I, so what is
//! seen of it can be carried on from the exposure to the present ([`GoalMotion`]); and the tip's pose is carried
//! on by the encoders. [`Predictor`] joins the three.
//!
//! What the base does is known, not estimated from the camera: the arm's own motion does not disturb the estimate
//! of the goal's, and the loop through the camera has no delay left in it as far as masses, gyro and encoders
//! are right. Latency then costs accuracy, not stability.

mod base_motion;
mod goal_motion;
mod predictor;

pub use base_motion::{BaseMotion, Moment};
pub use goal_motion::{GoalMotion, GoalMotionConfig, GoalState};
pub use predictor::{Predicted, Prediction, Predictor};
