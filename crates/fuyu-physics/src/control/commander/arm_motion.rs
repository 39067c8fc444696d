//! The motion that an arm executes, sampled.

use nalgebra::DVector;

use super::joint_spline::{JointPoint, JointSpline};
use super::pose_path::{PathFrame, PoseSpline};
use super::tip_follower::{BaseState, TipFollower};
use super::twist_servo::TwistServo;
use crate::dynamics::Momentum;

/// Rate at which redundant joints approach their trajectory \[1/s\].
const POSTURE_GAIN: f64 = 1.0;

/// A motion of all joints, defined by joint positions or by the tip.
#[derive(Debug, Clone)]
pub enum ArmMotion {
    /// The joints follow splines.
    Joints(JointSpline),
    /// The tip follows its motion on the splines, relative to the base; redundant joints turn the base as little as
    /// possible.
    LeastReaction(Box<LeastReaction>),
    /// The tip follows a path.
    Path(Box<PathMotion>),
    /// The tip moves with streamed twists.
    Twist(Box<TwistServo>),
}

/// See [`ArmMotion::LeastReaction`].
#[derive(Debug, Clone)]
pub struct LeastReaction {
    spline: JointSpline,
    follower: TipFollower,
    /// Computes the tip's motion on the splines.
    kinematics: TipFollower,
    /// Joint rates of the splines.
    preferred: DVector<f64>,
}

/// See [`ArmMotion::Path`].
#[derive(Debug, Clone)]
pub struct PathMotion {
    spline: PoseSpline,
    follower: TipFollower,
}

impl ArmMotion {
    /// Follows the tip's part of a joint trajectory. `follower` holds the joints' present motion.
    pub fn least_reaction(spline: JointSpline, follower: TipFollower) -> Self {
        Self::LeastReaction(Box::new(LeastReaction {
            preferred: DVector::zeros(spline.dof()),
            kinematics: follower.clone(),
            spline,
            follower,
        }))
    }

    /// Follows a path of the tip. `follower` holds the joints' present motion.
    pub fn path(spline: PoseSpline, follower: TipFollower) -> Self {
        Self::Path(Box::new(PathMotion { spline, follower }))
    }

    /// End of the motion \[s\]; infinite for streamed twists.
    pub fn end(&self) -> f64 {
        match self {
            Self::Joints(spline) => spline.end(),
            Self::LeastReaction(motion) => motion.spline.end(),
            Self::Path(motion) => motion.spline.end(),
            Self::Twist(_) => f64::INFINITY,
        }
    }

    /// Acceleration of joint `j` at `time` \[s\] for splines; zero for motions of the tip.
    pub fn acceleration(&self, j: usize, time: f64) -> f64 {
        match self {
            Self::Joints(spline) => spline.at(j, time).acceleration,
            _ => 0.0,
        }
    }

    /// Advances from `time` by `dt` \[s\], with the robot's `base` at `time`. Writes for each joint its position and
    /// rate at `time` and its mean acceleration until `time + dt`.
    ///
    /// # Panics
    /// If `out` does not have one element per joint.
    pub fn advance(&mut self, base: &BaseState, time: f64, dt: f64, out: &mut [JointPoint]) {
        match self {
            Self::Joints(spline) => {
                assert_eq!(out.len(), spline.dof(), "out has one element per joint");
                for (j, point) in out.iter_mut().enumerate() {
                    let (now, next) = (spline.at(j, time), spline.at(j, time + dt));
                    *point = JointPoint {
                        acceleration: (next.rate - now.rate) / dt,
                        ..now
                    };
                }
            }
            Self::LeastReaction(motion) => motion.advance(base, time, dt, out),
            Self::Path(motion) => {
                let (frame, middle) = (motion.spline.frame(), time + 0.5 * dt);
                let ((X, _), (_, V)) = (motion.spline.at(time), motion.spline.at(middle));
                (motion.follower).follow(base, frame, (&X, &V), None, dt, out);
            }
            Self::Twist(servo) => servo.advance(base, time, dt, out),
        }
    }
}

impl LeastReaction {
    fn advance(&mut self, base: &BaseState, time: f64, dt: f64, out: &mut [JointPoint]) {
        let (spline, frame) = (&self.spline, PathFrame::Base);
        let still = BaseState {
            momentum_B: Momentum::default(),
            ..*base
        };
        let mut tip_at = |time: f64| {
            self.kinematics.place(|j| spline.at(j, time));
            self.kinematics.tip(&still, frame)
        };
        let ((X, _), (_, V)) = (tip_at(time), tip_at(time + 0.5 * dt));
        let q = self.follower.positions();
        for (j, rate) in self.preferred.iter_mut().enumerate() {
            let planned = spline.at(j, time);
            *rate = planned.rate + POSTURE_GAIN * (planned.position - q[j]);
        }
        (self.follower).follow(base, frame, (&X, &V), Some(&self.preferred), dt, out);
    }
}
