//! Estimation of the goal's motion from camera frames.

use nalgebra::{Matrix3, RowVector3, Translation3, UnitQuaternion, Vector3};

use crate::control::gains::{ConfigError, check_not_negative, check_positive};
use crate::spatial::{Pose, Twist, exp_so3};

/// Noise of the sensors and smoothness of the goal's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalMotionConfig {
    /// Standard deviation of each coordinate of a measured position \[m\].
    pub position_noise: f64,
    /// Standard deviation of each component of a measured attitude \[rad\].
    pub attitude_noise: f64,
    /// Root of the spectral density of the goal's jerk \[m/s^2.5\]: how fast its acceleration may change.
    pub jerk: f64,
    /// Root of the spectral density of the angular jerk \[rad/s^2.5\].
    pub angular_jerk: f64,
    /// Standard deviation of each component of an externally estimated angular velocity \[rad/s\]; with zero, such
    /// estimates are not used.
    pub rate_noise: f64,
}

impl Default for GoalMotionConfig {
    /// For a point 1 m from the centre of a body that tumbles at some 3 deg/s (its acceleration of 3 mm/s²
    /// rotates by a radian in 20 s) and a camera that is a little worse than ideal.
    fn default() -> Self {
        Self {
            position_noise: 1e-3,
            attitude_noise: 1e-3,
            jerk: 3e-4,
            angular_jerk: 3e-4,
            rate_noise: 0.0,
        }
    }
}

impl GoalMotionConfig {
    /// Refuses settings of the wrong sign or that are not finite.
    ///
    /// # Errors
    /// [`ConfigError`] names the setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        check_positive("goal_position_noise", self.position_noise)?;
        check_positive("goal_attitude_noise", self.attitude_noise)?;
        check_positive("goal_jerk", self.jerk)?;
        check_positive("goal_angular_jerk", self.angular_jerk)?;
        check_not_negative("goal_rate_noise", self.rate_noise)
    }
}

/// Standard deviations of speed and acceleration before two frames are seen \[m/s, m/s²; rad/s, rad/s²\].
const PRIOR: (f64, f64) = (0.1, 0.01);

/// Gate of the filter, in standard deviations; larger deviations are outliers.
const GATE: f64 = 8.0;

/// The goal at one time, in I.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GoalState {
    /// Pose in I.
    pub X_ID: Pose,
    /// Angular velocity and velocity of its origin, axes of I.
    pub V_ID_I: Twist,
    /// Rate of change of the twist.
    pub A_ID_I: Twist,
}

/// A Kalman filter for position and attitude with their first two derivatives, driven by white jerk. A body in
/// free rotation has smooth accelerations; over a latency of a fraction of a second, a constant
/// acceleration leaves an error of `w³ r t³/6`, micrometres for a goal that a servicer can follow.
///
/// Measurement noise is isotropic, so one 3 × 3 covariance holds for all three coordinates of the position, and one for
/// all three of the attitude (whose error is a small rotation in the axes of I).
#[derive(Debug, Clone)]
pub(super) struct GoalMotion {
    config: GoalMotionConfig,
    estimate: Option<Estimate>,
    /// Number of consecutive frames outside the gate.
    outliers: u32,
}

/// State of the filter at one time, in I; each covariance is that of (value, rate, acceleration) of one coordinate.
#[derive(Debug, Clone, Copy)]
struct Estimate {
    time: f64,
    R_ID: UnitQuaternion<f64>,
    w: Vector3<f64>,
    alpha: Vector3<f64>,
    p: Vector3<f64>,
    v: Vector3<f64>,
    a: Vector3<f64>,
    position: Matrix3<f64>,
    attitude: Matrix3<f64>,
}

impl GoalMotion {
    /// A filter without measurements.
    pub fn new(config: GoalMotionConfig) -> Self {
        Self {
            config,
            estimate: None,
            outliers: 0,
        }
    }

    /// Changes the settings from now on.
    pub fn set_config(&mut self, config: GoalMotionConfig) {
        self.config = config;
    }

    /// Discards the goal.
    pub fn clear(&mut self) {
        self.estimate = None;
        self.outliers = 0;
    }

    /// Adds the goal's pose in I at `time` \[s\]. A single frame outside the gate is treated as a sensor fault; after
    /// two in a row the estimate restarts, with another goal.
    pub fn add_pose(&mut self, time: f64, X_ID: &Pose) {
        let Some(estimate) = self.estimate.filter(|estimate| time >= estimate.time) else {
            self.begin(time, X_ID);
            return;
        };
        let mut next = estimate.predicted(time - estimate.time, &self.config);
        let off_p = X_ID.translation.vector - next.p;
        let off_R = (UnitQuaternion::from(X_ID.rotation) * next.R_ID.inverse()).scaled_axis();
        let fits = |off: &Vector3<f64>, P: &Matrix3<f64>, noise: f64| {
            off.norm_squared() <= GATE * GATE * 3.0 * (P.m11 + noise * noise)
        };
        let GoalMotionConfig {
            position_noise,
            attitude_noise,
            ..
        } = self.config;
        if !(fits(&off_p, &next.position, position_noise)
            && fits(&off_R, &next.attitude, attitude_noise))
        {
            self.outliers += 1;
            if self.outliers > 1 {
                self.begin(time, X_ID);
            }
            return;
        }
        self.outliers = 0;
        let row = RowVector3::new(1.0, 0.0, 0.0);
        let gain = correct(&mut next.position, &row, position_noise);
        next.p += off_p * gain.x;
        next.v += off_p * gain.y;
        next.a += off_p * gain.z;
        let gain = correct(&mut next.attitude, &row, attitude_noise);
        next.turn(&off_R, &gain);
        self.estimate = Some(next);
    }

    /// Adds an externally estimated angular velocity `w_ID_I` \[rad/s\] at `time` \[s\] (axes of I).
    pub fn add_rate(&mut self, time: f64, w_ID_I: &Vector3<f64>) {
        let noise = self.config.rate_noise;
        if let Some(estimate) = self.estimate.as_mut().filter(|_| noise > 0.0) {
            let dt = time - estimate.time;
            let off = w_ID_I - (estimate.w + estimate.alpha * dt);
            let gain = correct(
                &mut estimate.attitude,
                &RowVector3::new(0.0, 1.0, dt),
                noise,
            );
            estimate.turn(&off, &gain);
        }
    }

    /// The goal at `time` \[s\]; `None` before the first frame.
    pub fn at(&self, time: f64) -> Option<GoalState> {
        let goal = self.estimate.as_ref()?.moved(time - self.estimate?.time);
        Some(GoalState {
            X_ID: Pose::from_parts(Translation3::from(goal.p), goal.R_ID.to_rotation_matrix()),
            V_ID_I: Twist::new(goal.w, goal.v),
            A_ID_I: Twist::new(goal.alpha, goal.a),
        })
    }

    fn begin(&mut self, time: f64, X_ID: &Pose) {
        let prior = |noise: f64| {
            Matrix3::from_diagonal(&Vector3::new(
                noise * noise,
                PRIOR.0 * PRIOR.0,
                PRIOR.1 * PRIOR.1,
            ))
        };
        self.outliers = 0;
        self.estimate = Some(Estimate {
            time,
            R_ID: UnitQuaternion::from(X_ID.rotation),
            w: Vector3::zeros(),
            alpha: Vector3::zeros(),
            p: X_ID.translation.vector,
            v: Vector3::zeros(),
            a: Vector3::zeros(),
            position: prior(self.config.position_noise),
            attitude: prior(self.config.attitude_noise),
        });
    }
}

impl Estimate {
    fn moved(&self, dt: f64) -> Self {
        let half = 0.5 * dt * dt;
        // Magnus expansion: the angular velocity at the two ends is w and w + α dt.
        let turn =
            self.w * dt + self.alpha * half - self.w.cross(&self.alpha) * (dt * dt * dt / 12.0);
        Self {
            time: self.time + dt,
            R_ID: exp_so3(&turn) * self.R_ID,
            w: self.w + self.alpha * dt,
            p: self.p + self.v * dt + self.a * half,
            v: self.v + self.a * dt,
            ..*self
        }
    }

    fn predicted(&self, dt: f64, config: &GoalMotionConfig) -> Self {
        let mut next = self.moved(dt);
        #[rustfmt::skip]
        let F = Matrix3::new(
            1.0, dt, 0.5 * dt * dt,
            0.0, 1.0, dt,
            0.0, 0.0, 1.0,
        );
        let (d2, d3) = (dt * dt, dt * dt * dt);
        #[rustfmt::skip]
        let Q = Matrix3::new(
            d3 * d2 / 20.0, d2 * d2 / 8.0, d3 / 6.0,
            d2 * d2 / 8.0, d3 / 3.0, d2 / 2.0,
            d3 / 6.0, d2 / 2.0, dt,
        );
        next.position = F * self.position * F.transpose() + Q * config.jerk.powi(2);
        next.attitude = F * self.attitude * F.transpose() + Q * config.angular_jerk.powi(2);
        next
    }

    fn turn(&mut self, off: &Vector3<f64>, gain: &Vector3<f64>) {
        self.R_ID = exp_so3(&(off * gain.x)) * self.R_ID;
        self.R_ID.renormalize();
        self.w += off * gain.y;
        self.alpha += off * gain.z;
    }
}

/// Kalman gain for a measurement of `row` times (value, rate, acceleration) with the standard deviation `noise`;
/// updates the covariance in Joseph's form.
fn correct(P: &mut Matrix3<f64>, row: &RowVector3<f64>, noise: f64) -> Vector3<f64> {
    let cross = *P * row.transpose();
    let r = noise * noise;
    let gain = cross / ((row * cross).x + r);
    let keep = Matrix3::identity() - gain * row;
    *P = keep * *P * keep.transpose() + gain * gain.transpose() * r;
    gain
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    /// A point 1 m from the centre of a body that spins about a fixed axis and drifts.
    fn goal(t: f64) -> (Pose, Twist) {
        let w = Vector3::new(0.02, -0.03, 0.04);
        let R = Rotation3::new(w * t);
        let arm = R * Vector3::new(0.9, 0.4, 0.0);
        let drift = Vector3::new(0.01, -0.02, 0.0);
        let pose = Pose::from_parts(Translation3::from(drift * t + arm), R);
        (pose, Twist::new(w, drift + w.cross(&arm)))
    }

    #[test]
    fn a_moving_goal_is_predicted_a_second_ahead() {
        let mut motion = GoalMotion::new(GoalMotionConfig::default());
        assert!(motion.at(0.0).is_none());
        for k in 0..=300 {
            let t = 0.1 * f64::from(k);
            motion.add_pose(t, &goal(t).0);
        }
        let (now, ahead) = (motion.at(30.0).unwrap(), motion.at(31.0).unwrap());
        let (_, V) = goal(30.0);
        // The filter does not follow the point's jerk of 1.6e-4 m/s³.
        let off = now.V_ID_I - V;
        assert!(off.linear.norm() < 4e-4, "{}", off.linear.norm());
        assert!(off.angular.norm() < 1e-5, "{}", off.angular.norm());
        let truth = goal(31.0).0;
        let off = ahead.X_ID.translation.vector - truth.translation.vector;
        // Without velocity it would be 59 mm, without acceleration 1.5 mm.
        assert!(off.norm() < 8e-4, "{}", off.norm());
        assert!(ahead.X_ID.rotation.angle_to(&truth.rotation) < 1e-5);
    }

    #[test]
    fn two_frames_of_another_goal_restart_the_estimate_and_one_does_not() {
        let mut motion = GoalMotion::new(GoalMotionConfig::default());
        for k in 0..100 {
            let t = 0.1 * f64::from(k);
            motion.add_pose(t, &goal(t).0);
        }
        let mut other = goal(10.0).0;
        other.translation.x += 1.0;
        motion.add_pose(10.0, &other);
        let kept = motion.at(10.0).unwrap().X_ID.translation.x;
        assert!((kept - goal(10.0).0.translation.x).abs() < 1e-3);
        motion.add_pose(10.1, &other);
        let taken = motion.at(10.1).unwrap();
        assert_eq!(taken.X_ID.translation.x, other.translation.x);
        assert_eq!(taken.V_ID_I.linear, Vector3::zeros());
    }

    #[test]
    fn an_external_rate_is_used() {
        let noisy = GoalMotionConfig {
            attitude_noise: 0.1,
            rate_noise: 1e-4,
            ..GoalMotionConfig::default()
        };
        let mut motion = GoalMotion::new(noisy);
        motion.add_pose(0.0, &goal(0.0).0);
        let w = goal(0.0).1.angular;
        for _ in 0..3 {
            motion.add_rate(0.0, &w);
        }
        assert!((motion.at(0.0).unwrap().V_ID_I.angular - w).norm() < 1e-5);
    }
}
