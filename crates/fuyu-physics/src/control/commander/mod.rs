//! Motions that a commander (another program) requests: joint trajectories, timed poses of the tip, streamed twists of
//! the tip; and the servo that tracks them on a free-floating base.
//!
//! A [`JointTrajectory`] becomes a [`JointSpline`] that starts from the joints' present motion, so that replacing one
//! trajectory by another causes no jump. A [`PosePath`] and the twists of a [`TwistServo`] are resolved into joint
//! rates by a [`TipFollower`], which can use redundant joints to turn the base as little as possible. [`ArmMotion`]
//! unites the three: at every sample it gives a [`JointPoint`] per joint, from which [`JointServo`] computes efforts
//! with the joints' inertia on a free base.

mod arm_motion;
mod joint_servo;
mod joint_spline;
mod joint_trajectory;
mod pose_path;
mod tip_follower;
mod tip_resolver;
mod tolerances;
mod twist_servo;

pub use arm_motion::ArmMotion;
pub use joint_servo::{JointDuty, JointServo};
pub use joint_spline::{JointPoint, JointSpline};
pub use joint_trajectory::{JointTrajectory, TrajectoryError, Waypoint};
pub use pose_path::{PathError, PathFrame, PosePath, PoseSpline, TimedPose};
pub use tip_follower::{BaseState, TipFollower};
pub use tip_resolver::{FreeMotion, KeptTip, TipResolver};
pub use tolerances::{
    GoalMonitor, Progress, Quantity, StateTolerance, TrajectoryTolerances, Violation,
};
pub use twist_servo::{TwistAxes, TwistServo, TwistServoConfig, TwistStatus};
