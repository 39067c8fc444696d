//! How a goal moves that is seen now and then.

use nalgebra::{Matrix3, RowVector3, Translation3, UnitQuaternion, Vector3};

use crate::control::gains::{GainError, check_not_negative, check_positive};
use crate::spatial::{Pose, Twist, exp_so3};

/// What is known of goals and of the sensor before any is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalMotionConfig {
    /// Standard deviation of each coordinate of a measured position \[m\].
    pub position_noise: f64,
    /// Standard deviation of each component of a measured attitude \[rad\].
    pub attitude_noise: f64,
    /// Root of the spectral density of the goal's jerk \[m/s^2.5\]: how fast its acceleration may change.
    pub jerk: f64,
    /// The same of the attitude \[rad/s^2.5\].
    pub angular_jerk: f64,
    /// Standard deviation of each component of an angular velocity that somebody else has estimated \[rad/s\];
    /// zero: none is heeded.
    pub rate_noise: f64,
}

impl Default for GoalMotionConfig {
    /// Fits a point 1 m from the centre of a body that tumbles at some 3 deg/s (its acceleration of 3 mm/s²
    /// turns in 20 s) and a camera that is a little worse than ideal.
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
    /// Refuses what no filter can work with.
    ///
    /// # Errors
    /// [`GainError`] names the setting.
    pub fn check(&self) -> Result<(), GainError> {
        check_positive("goal_position_noise", self.position_noise)?;
        check_positive("goal_attitude_noise", self.attitude_noise)?;
        check_positive("goal_jerk", self.jerk)?;
        check_positive("goal_angular_jerk", self.angular_jerk)?;
        check_not_negative("goal_rate_noise", self.rate_noise)
    }
}

/// Standard deviations of speed and acceleration before two frames are seen \[m/s, m/s²; rad/s, rad/s²\].
const PRIOR: (f64, f64) = (0.1, 0.01);

/// Deviations beyond so many standard deviations are not noise.
const GATE: f64 = 8.0;

/// The goal at one time, in I.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalState {
    /// Pose in I.
    pub X_ID: Pose,
    /// Angular velocity, and velocity of its origin, axes of I.
    pub V_ID_I: Twist,
    /// Their rates of change.
    pub A_ID_I: Twist,
}

/// A Kalman filter for position and attitude with their first two derivatives, driven by white jerk. A body in
/// free rotation has smooth accelerations; over the fraction of a second by which a camera is late, a constant
/// one leaves an error of `w³ r t³/6`, micrometres for what a servicer can follow at all.
///
/// Measurement noise is alike in all directions, so one 3 × 3 covariance serves the three coordinates of the
/// position, and one those of the attitude (whose error is a small rotation in the axes of I).
#[derive(Debug, Clone)]
pub struct GoalMotion {
    config: GoalMotionConfig,
    known: Option<Known>,
    /// Frames in a row that did not fit.
    strangers: u32,
}

#[derive(Debug, Clone, Copy)]
struct Known {
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
    /// Nothing is known yet.
    pub fn new(config: GoalMotionConfig) -> Self {
        Self {
            config,
            known: None,
            strangers: 0,
        }
    }

    /// Changes what is known of goals and sensor, from now on.
    pub fn set_config(&mut self, config: GoalMotionConfig) {
        self.config = config;
    }

    /// Forgets the goal.
    pub fn clear(&mut self) {
        self.known = None;
        self.strangers = 0;
    }

    /// Takes in the goal's pose in I at `time` \[s\]. One frame that does not fit is taken for a fault of the
    /// sensor; two in a row for another goal, with which the estimate begins anew.
    pub fn see(&mut self, time: f64, X_ID: &Pose) {
        let Some(known) = self.known.filter(|known| time >= known.time) else {
            self.begin(time, X_ID);
            return;
        };
        let mut next = known.carried_on(time - known.time, &self.config);
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
            self.strangers += 1;
            if self.strangers > 1 {
                self.begin(time, X_ID);
            }
            return;
        }
        self.strangers = 0;
        let seen = RowVector3::new(1.0, 0.0, 0.0);
        let gain = correct(&mut next.position, &seen, position_noise);
        next.p += off_p * gain.x;
        next.v += off_p * gain.y;
        next.a += off_p * gain.z;
        let gain = correct(&mut next.attitude, &seen, attitude_noise);
        next.turn(&off_R, &gain);
        self.known = Some(next);
    }

    /// Takes in an angular velocity `w_ID_I` \[rad/s\] at `time` \[s\] that somebody else has estimated (axes of
    /// I).
    pub fn see_rate(&mut self, time: f64, w_ID_I: &Vector3<f64>) {
        let noise = self.config.rate_noise;
        if let Some(known) = self.known.as_mut().filter(|_| noise > 0.0) {
            let dt = time - known.time;
            let off = w_ID_I - (known.w + known.alpha * dt);
            let gain = correct(&mut known.attitude, &RowVector3::new(0.0, 1.0, dt), noise);
            known.turn(&off, &gain);
        }
    }

    /// The goal at `time` \[s\]; `None` before one was seen.
    pub fn at(&self, time: f64) -> Option<GoalState> {
        let known = self.known.as_ref()?.moved(time - self.known?.time);
        Some(GoalState {
            X_ID: Pose::from_parts(Translation3::from(known.p), known.R_ID.to_rotation_matrix()),
            V_ID_I: Twist::new(known.w, known.v),
            A_ID_I: Twist::new(known.alpha, known.a),
        })
    }

    /// When the goal was last seen \[s\].
    pub fn last_seen(&self) -> Option<f64> {
        self.known.map(|known| known.time)
    }

    fn begin(&mut self, time: f64, X_ID: &Pose) {
        let prior = |noise: f64| {
            Matrix3::from_diagonal(&Vector3::new(
                noise * noise,
                PRIOR.0 * PRIOR.0,
                PRIOR.1 * PRIOR.1,
            ))
        };
        self.strangers = 0;
        self.known = Some(Known {
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

impl Known {
    fn moved(&self, dt: f64) -> Self {
        let half = 0.5 * dt * dt;
        // Magnus: the angular velocity at the two ends is w and w + α dt.
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

    fn carried_on(&self, dt: f64, config: &GoalMotionConfig) -> Self {
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

/// Kalman gain for a measurement `seen` of (value, rate, acceleration) with deviation `noise`; the covariance is
/// brought down by it, in Joseph's form.
fn correct(P: &mut Matrix3<f64>, seen: &RowVector3<f64>, noise: f64) -> Vector3<f64> {
    let cross = *P * seen.transpose();
    let r = noise * noise;
    let gain = cross / ((seen * cross).x + r);
    let keep = Matrix3::identity() - gain * seen;
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
            motion.see(t, &goal(t).0);
        }
        let (now, ahead) = (motion.at(30.0).unwrap(), motion.at(31.0).unwrap());
        let (_, V) = goal(30.0);
        // The point's jerk, 1.6e-4 m/s³, is what the filter does not follow.
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
    fn another_goal_is_taken_over_at_the_second_frame_and_a_flash_is_not() {
        let mut motion = GoalMotion::new(GoalMotionConfig::default());
        for k in 0..100 {
            let t = 0.1 * f64::from(k);
            motion.see(t, &goal(t).0);
        }
        let mut other = goal(10.0).0;
        other.translation.x += 1.0;
        motion.see(10.0, &other);
        let kept = motion.at(10.0).unwrap().X_ID.translation.x;
        assert!((kept - goal(10.0).0.translation.x).abs() < 1e-3);
        motion.see(10.1, &other);
        let taken = motion.at(10.1).unwrap();
        assert_eq!(taken.X_ID.translation.x, other.translation.x);
        assert_eq!(taken.V_ID_I.linear, Vector3::zeros());
    }

    #[test]
    fn a_known_rate_is_heeded() {
        let noisy = GoalMotionConfig {
            attitude_noise: 0.1,
            rate_noise: 1e-4,
            ..GoalMotionConfig::default()
        };
        let mut motion = GoalMotion::new(noisy);
        motion.see(0.0, &goal(0.0).0);
        let w = goal(0.0).1.angular;
        for _ in 0..3 {
            motion.see_rate(0.0, &w);
        }
        assert!((motion.at(0.0).unwrap().V_ID_I.angular - w).norm() < 1e-5);
    }
}
