//! Streamed twists of the tip, with the conventions of MoveIt Servo.

use nalgebra::{DVector, UnitQuaternion};

use super::joint_spline::JointPoint;
use super::pose_path::PathFrame;
use super::tip_follower::{BaseState, TipFollower, faded};
use super::tip_resolver::{FreeMotion, TipResolver};
use crate::control::gains::{ConfigError, check_positive};
use crate::control::{RateLimits, limit_twist};
use crate::model::{Frame, Model};
use crate::spatial::Twist;

/// Look-ahead time for detecting motion towards a singular position \[s\].
const LOOK_AHEAD: f64 = 0.1;

/// Settings of [`TwistServo`]. Names and defaults of the first four are those of MoveIt Servo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwistServoConfig {
    /// Age of the last twist at which the joints are halted \[s\].
    pub incoming_command_timeout: f64,
    /// Condition number of the Jacobian above which the tip slows down.
    pub lower_singularity_threshold: f64,
    /// Condition number at which the tip halts.
    pub hard_stop_singularity_threshold: f64,
    /// Factor by which the range between the thresholds is longer for motion away from a singular position.
    pub leaving_singularity_threshold_multiplier: f64,
    /// Largest speed of the tip \[m/s\].
    pub max_linear_speed: f64,
    /// Largest angular speed of the tip \[rad/s\].
    pub max_angular_speed: f64,
    /// Largest rate of any joint \[rad/s or m/s\], in addition to its own limit.
    pub max_joint_rate: f64,
    /// Largest change of any joint's rate \[rad/s² or m/s²\].
    pub max_joint_acceleration: f64,
}

impl Default for TwistServoConfig {
    fn default() -> Self {
        Self {
            incoming_command_timeout: 0.1,
            lower_singularity_threshold: 17.0,
            hard_stop_singularity_threshold: 30.0,
            leaving_singularity_threshold_multiplier: 2.0,
            max_linear_speed: 0.5,
            max_angular_speed: 0.5,
            max_joint_rate: 1.0,
            max_joint_acceleration: 2.0,
        }
    }
}

impl TwistServoConfig {
    /// Refuses settings that are not positive and finite, or thresholds in the wrong order.
    ///
    /// # Errors
    /// [`ConfigError`] names the setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        check_positive("incoming_command_timeout", self.incoming_command_timeout)?;
        check_positive(
            "lower_singularity_threshold",
            self.lower_singularity_threshold,
        )?;
        check_positive(
            "hard_stop_singularity_threshold less lower_singularity_threshold",
            self.hard_stop_singularity_threshold - self.lower_singularity_threshold,
        )?;
        check_positive(
            "leaving_singularity_threshold_multiplier",
            self.leaving_singularity_threshold_multiplier,
        )?;
        check_positive("max_linear_speed", self.max_linear_speed)?;
        check_positive("max_angular_speed", self.max_angular_speed)?;
        check_positive("max_joint_rate", self.max_joint_rate)?;
        check_positive("max_joint_acceleration", self.max_joint_acceleration)
    }
}

/// Axes in which a twist is given.
#[derive(Debug, Clone, PartialEq)]
pub enum TwistAxes {
    /// Axes of a frame with this attitude in the world.
    World(UnitQuaternion<f64>),
    /// Axes of a frame of the robot.
    Robot(Frame),
}

/// State of the servo.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TwistStatus {
    /// The tip moves as commanded.
    Following,
    /// No twist for too long: the joints are halted.
    Silent,
    /// The tip slows down on the way to a singular position.
    Approaching,
    /// The tip has halted before a singular position.
    Halted,
    /// The tip is slower on the way out of a singular position.
    Leaving,
    /// The joint with this index slows the tip down before its position limit.
    JointBound(usize),
    /// The joint with this index is at its rate limit: the tip is slower than commanded.
    RateLimit(usize),
    /// The twist exceeds the largest speeds and is reduced.
    TooFast,
}

/// Moves the tip with streamed twists: velocity of the tip's origin and angular velocity, in inertial space, with
/// components in the axes of any frame.
///
/// Conventions are those of MoveIt Servo: the frame gives the axes only, and the reference point is the tip's origin; a
/// twist acts for `incoming_command_timeout`, then the joints are halted; near singular positions the twist is scaled
/// by `1 - (κ - κ_l)/(κ_h - κ_l)` with the condition number `κ` of the Jacobian, between the two thresholds, with a
/// longer range for motion that leaves them; near position limits all joints slow down by the same factor.
#[derive(Debug, Clone)]
pub struct TwistServo {
    config: TwistServoConfig,
    follower: TipFollower,
    limits: RateLimits,
    model: Model,
    axes: TwistAxes,
    twist: Twist,
    /// When the last twist arrived \[s\].
    since: f64,
    status: TwistStatus,
    ahead: DVector<f64>,
}

impl TwistServo {
    /// Starts with the joints' motion of `follower`, without a twist yet. Its resolver should not avoid joint limits
    /// ([`TipResolver::without_limits`]): the servo slows all joints down by the same factor instead, which keeps the
    /// tip's direction.
    pub fn new(model: &Model, follower: TipFollower, config: TwistServoConfig) -> Self {
        Self {
            limits: RateLimits::new(model, config.max_joint_rate, config.max_joint_acceleration),
            follower,
            ahead: DVector::zeros(model.dof()),
            model: model.clone(),
            axes: TwistAxes::World(UnitQuaternion::identity()),
            twist: Twist::new(nalgebra::Vector3::zeros(), nalgebra::Vector3::zeros()),
            since: f64::NEG_INFINITY,
            status: TwistStatus::Silent,
            config,
        }
    }

    /// Takes a twist in `axes` that arrives at `time` \[s\].
    pub fn command(&mut self, axes: TwistAxes, twist: Twist, time: f64) {
        (self.axes, self.twist, self.since) = (axes, twist, time);
    }

    /// State of the servo.
    pub fn status(&self) -> TwistStatus {
        self.status
    }

    /// Advances from `time` by `dt` \[s\]. Writes the joints' motion of the step.
    pub fn advance(&mut self, base: &BaseState, time: f64, dt: f64, out: &mut [JointPoint]) {
        let Self {
            config,
            follower,
            limits,
            model,
            axes,
            twist,
            since,
            status,
            ahead,
        } = self;
        let is_silent = time - *since > config.incoming_command_timeout + 1e-9;
        follower.drive(dt, out, |resolver, q, before, rates| {
            if is_silent {
                *status = TwistStatus::Silent;
                rates.fill(0.0);
            } else {
                let V_B = in_base_axes(resolver, base, axes, twist, q);
                let (V_B, is_cut) =
                    limit_twist(&V_B, config.max_linear_speed, config.max_angular_speed);
                ahead.copy_from(before);
                *ahead *= faded(dt);
                let free = FreeMotion {
                    preferred: ahead,
                    before,
                    faded: faded(dt),
                };
                resolver.rates(q, PathFrame::World, &base.momentum_B, &V_B, free, rates);
                *status = match is_cut {
                    true => TwistStatus::TooFast,
                    false => TwistStatus::Following,
                };
                if let Some((part, reason)) = slow_down(config, resolver, q, rates, ahead) {
                    *rates *= part;
                    *status = reason;
                }
            }
            let limited = limits.apply(model, q, before, dt, rates);
            if let Some(j) = limited.position {
                *status = TwistStatus::JointBound(j);
            } else if let (Some(j), TwistStatus::Following) = (limited.rate, *status) {
                *status = TwistStatus::RateLimit(j);
            }
        });
    }
}

/// The commanded twist in base axes.
fn in_base_axes(
    resolver: &mut TipResolver,
    base: &BaseState,
    axes: &TwistAxes,
    twist: &Twist,
    q: &DVector<f64>,
) -> Twist {
    let R_BA = match axes {
        TwistAxes::World(R_WA) => base.X_WB.rotation.inverse() * R_WA.to_rotation_matrix(),
        TwistAxes::Robot(frame) => resolver.X_BF(q, frame).rotation,
    };
    Twist::new(R_BA * twist.angular, R_BA * twist.linear)
}

/// Fraction of `rates` allowed near a singular position, and the reason; `None` for no reduction.
fn slow_down(
    config: &TwistServoConfig,
    resolver: &mut TipResolver,
    q: &DVector<f64>,
    rates: &DVector<f64>,
    ahead: &mut DVector<f64>,
) -> Option<(f64, TwistStatus)> {
    let condition = resolver.condition(q, PathFrame::World);
    let lower = config.lower_singularity_threshold;
    if condition <= lower {
        return None;
    }
    ahead.copy_from(q);
    ahead.axpy(LOOK_AHEAD, rates, 1.0);
    let is_approaching = resolver.condition(ahead, PathFrame::World) > condition;
    let range = config.hard_stop_singularity_threshold - lower;
    let (range, reason) = match is_approaching {
        true => (range, TwistStatus::Approaching),
        false => {
            let longer = range * config.leaving_singularity_threshold_multiplier;
            (longer, TwistStatus::Leaving)
        }
    };
    let part = 1.0 - (condition - lower) / range;
    match (part > 0.0, is_approaching) {
        (true, _) => Some((part, reason)),
        (false, true) => Some((0.0, TwistStatus::Halted)),
        // Motion that leaves the singular position remains possible.
        (false, false) => Some((LEAST_LEAVING, reason)),
    }
}

/// Least fraction of a twist that leaves a singular position.
const LEAST_LEAVING: f64 = 0.1;
