//! Attitude and gyro bias from gyro and star tracker: a multiplicative extended Kalman filter.

mod history;
#[cfg(test)]
mod tests;

use history::{History, Node, Uncertainty};
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3};

use super::error::{finite, finite_vector, require, require_not_negative, require_positive};
use super::{AttitudeConfigError, AttitudeInputError, GyroErrors};
use crate::control::Stamp;
use crate::spatial::exp_so3;

/// Settings of an [`AttitudeFilter`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeFilterConfig {
    /// Errors of the gyro.
    pub gyro: GyroErrors,
    /// Standard deviation of each component of the star tracker's error \[rad\].
    pub star_tracker_noise: f64,
    /// Longest gap between two gyro samples over which the rate is interpolated \[s\]. After a longer gap the attitude
    /// is unknown until the next measurement of the star tracker.
    pub longest_gap: f64,
    /// Largest accepted normalized squared innovation. It has three degrees of freedom: 1.4e-6 of correct measurements
    /// exceed 30.
    pub gate: f64,
    /// Number of consecutive measurements beyond the gate after which the filter restarts with the last one.
    pub restart_after: u32,
}

impl AttitudeFilterConfig {
    /// For a gyro and a star tracker with the usual limits: gaps of .5 s, a gate of 30, a restart after 5 outliers.
    pub fn new(gyro: GyroErrors, star_tracker_noise: f64) -> Self {
        Self {
            gyro,
            star_tracker_noise,
            longest_gap: 0.5,
            gate: 30.0,
            restart_after: 5,
        }
    }

    /// Refuses values out of their range.
    ///
    /// # Errors
    /// [`AttitudeConfigError::Value`] names the value.
    pub fn check(&self) -> Result<(), AttitudeConfigError> {
        self.gyro.check()?;
        require_positive("star_tracker_noise [rad]", self.star_tracker_noise)?;
        require_positive("longest_gap [s]", self.longest_gap)?;
        require_positive("gate", self.gate)?;
        let restart = f64::from(self.restart_after);
        require("restart_after", restart, restart > 0.0, "at least 1")?;
        require_not_negative("initial_bias [rad/s]", self.gyro.initial_bias)
    }
}

/// Estimate of an [`AttitudeFilter`] at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeEstimate {
    /// Attitude of the base.
    pub R_WB: UnitQuaternion<f64>,
    /// Angular velocity of the base, base axes \[rad/s\]: the last gyro sample minus the bias.
    pub w_WB_B: Vector3<f64>,
    /// Bias of the gyro \[rad/s\].
    pub bias: Vector3<f64>,
    /// Covariance of the rotation vector from the estimated to the true attitude, base axes \[rad²\], and of the bias.
    pub covariance: Matrix6<f64>,
    /// Whether a star tracker has measured the attitude. Otherwise `R_WB` has no meaning.
    pub attitude_known: bool,
}

impl AttitudeEstimate {
    /// Largest standard deviation of the attitude about any axis \[rad\].
    pub fn attitude_deviation(&self) -> f64 {
        let block: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        block.symmetric_eigenvalues().max().max(0.0).sqrt()
    }
}

/// Result of the processing of a star tracker measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StarTrackerUse {
    /// The measurement waits for a gyro sample that is not earlier.
    Waiting,
    /// The measurement has corrected the estimate.
    Used,
    /// The measurement has set the attitude: the first one, or one after a gap or after many outliers.
    Started,
    /// The measurement contradicts the estimate and was not used.
    Outlier,
    /// The measurement is not newer than the last one used, or older than the history.
    TooOld,
    /// The measurement is ahead of the gyro by more than the longest gap: its stamp is wrong.
    TooNew,
}

/// Multiplicative extended Kalman filter with the bias of the gyro as state (E. J. Lefferts, F. L. Markley and M. D.
/// Shuster, "Kalman filtering for spacecraft attitude estimation", J. Guidance 5, 1982; the form with errors in base
/// axes is that of F. L. Markley and J. L. Crassidis, Fundamentals of Spacecraft Attitude Determination and Control,
/// 2014, section 6.2).
///
/// The gyro is integrated, and the star tracker corrects. A late measurement corrects the estimate at its own time, in
/// a history of the last [`AttitudeFilter::HISTORY`] gyro samples; the gyro is then integrated again from there. Apart
/// from the wait, latency therefore costs no accuracy. No call allocates memory.
#[derive(Debug, Clone)]
pub struct AttitudeFilter {
    config: AttitudeFilterConfig,
    history: History,
    attitude_known: bool,
    last_used: Option<Stamp>,
    waiting: Option<(Stamp, UnitQuaternion<f64>)>,
    outliers_in_a_row: u32,
    outliers: u64,
}

impl AttitudeFilter {
    /// Gyro samples that are kept: 2.56 s at 100 Hz.
    pub const HISTORY: usize = 256;

    /// A filter without measurements.
    ///
    /// # Errors
    /// As [`AttitudeFilterConfig::check`].
    pub fn new(config: AttitudeFilterConfig) -> Result<Self, AttitudeConfigError> {
        config.check()?;
        Ok(Self {
            config,
            history: History::new(Self::HISTORY),
            attitude_known: false,
            last_used: None,
            waiting: None,
            outliers_in_a_row: 0,
            outliers: 0,
        })
    }

    /// Settings.
    pub fn config(&self) -> &AttitudeFilterConfig {
        &self.config
    }

    /// Discards all measurements.
    pub fn restart(&mut self) {
        self.history.clear();
        self.attitude_known = false;
        self.last_used = None;
        self.waiting = None;
        self.outliers_in_a_row = 0;
        self.outliers = 0;
    }

    /// Measurements of the star tracker that were not used because they contradict the estimate.
    pub fn outliers(&self) -> u64 {
        self.outliers
    }

    /// Stamp of the newest gyro sample.
    pub fn newest_gyro(&self) -> Option<Stamp> {
        self.history.newest().map(|node| node.stamp)
    }

    /// Stamp of the newest measurement of the star tracker that was used.
    pub fn newest_star_tracker(&self) -> Option<Stamp> {
        self.last_used
    }

    /// Adds a gyro sample, base axes \[rad/s\]. An earlier stamp than the last one starts another run; an equal stamp
    /// is ignored. Returns the result for a star tracker measurement that waited for this sample.
    ///
    /// # Errors
    /// A value that is not finite; the sample is then not added.
    pub fn add_gyro(
        &mut self,
        stamp: Stamp,
        w_measured: Vector3<f64>,
    ) -> Result<Option<StarTrackerUse>, AttitudeInputError> {
        finite_vector("angular_velocity", &w_measured)?;
        if self.newest_gyro().is_some_and(|last| stamp < last) {
            self.restart();
        }
        match self.history.newest().copied() {
            None => self.history.push(Node {
                stamp,
                w_measured,
                R_WB: UnitQuaternion::identity(),
                bias: Vector3::zeros(),
                uncertainty: Uncertainty::of_bias(self.config.gyro.initial_bias),
            }),
            Some(last) if stamp == last.stamp => return Ok(None),
            Some(last) if stamp.seconds_since(last.stamp) > self.config.longest_gap => {
                let variance =
                    self.config.gyro.rate_random_walk.powi(2) * stamp.seconds_since(last.stamp);
                self.history.clear();
                self.attitude_known = false;
                self.history.push(Node {
                    stamp,
                    w_measured,
                    uncertainty: last.uncertainty.after_gap(variance),
                    ..last
                });
            }
            Some(last) => {
                let next = last.propagated(stamp, w_measured, &self.config.gyro);
                self.history.push(next);
            }
        }
        let due = self.waiting.filter(|(waiting, _)| *waiting <= stamp);
        Ok(due.map(|(waiting, R_WB)| {
            self.waiting = None;
            self.correct(waiting, &R_WB)
        }))
    }

    /// Adds a measurement of the star tracker at its time of exposure.
    ///
    /// # Errors
    /// A value that is not finite; the measurement is then not added.
    pub fn add_star_tracker(
        &mut self,
        stamp: Stamp,
        R_WB: &UnitQuaternion<f64>,
    ) -> Result<StarTrackerUse, AttitudeInputError> {
        finite(R_WB.coords.as_slice(), |i| {
            format!("quaternion.{}", ["x", "y", "z", "w"][i])
        })?;
        let newest = self.newest_gyro();
        let gap = self.config.longest_gap;
        if newest.is_some_and(|newest| stamp.seconds_since(newest) > gap) {
            return Ok(StarTrackerUse::TooNew);
        }
        if newest.is_none_or(|newest| stamp > newest) {
            // A measurement from before the first gyro sample may also have a wrong stamp.
            let is_wrong = |waiting: Stamp| newest.is_some_and(|n| waiting.seconds_since(n) > gap);
            if self
                .waiting
                .is_none_or(|(waiting, _)| stamp >= waiting || is_wrong(waiting))
            {
                self.waiting = Some((stamp, *R_WB));
            }
            return Ok(StarTrackerUse::Waiting);
        }
        Ok(self.correct(stamp, R_WB))
    }

    /// The estimate at `now`: that at the newest gyro sample, extrapolated with its rate. `None` without a gyro sample.
    pub fn estimate(&self, now: Stamp) -> Option<AttitudeEstimate> {
        let node = self.history.newest()?;
        let w_WB_B = node.w_measured - node.bias;
        let ahead = now
            .seconds_since(node.stamp)
            .clamp(0.0, self.config.longest_gap);
        Some(AttitudeEstimate {
            R_WB: node.R_WB * exp_so3(&(w_WB_B * ahead)),
            w_WB_B,
            bias: node.bias,
            covariance: node.uncertainty.covariance,
            attitude_known: self.attitude_known,
        })
    }

    /// Corrects the estimate at the time `stamp`, which is not after the newest gyro sample, and integrates again from
    /// there.
    fn correct(&mut self, stamp: Stamp, R_WB: &UnitQuaternion<f64>) -> StarTrackerUse {
        let at = self.history.place(stamp);
        let Some(at) = at.filter(|_| self.last_used.is_none_or(|last| stamp > last)) else {
            return StarTrackerUse::TooOld;
        };
        // The measurement is moved to the preceding gyro sample.
        let after = self.history.rate_after(at, stamp);
        let node = self.history.node_mut(at);
        let ahead = stamp.seconds_since(node.stamp);
        let measured = R_WB * exp_so3(&(-(after - node.bias) * ahead));
        let variance = self.config.star_tracker_noise.powi(2)
            + self.config.gyro.angle_random_walk.powi(2) * ahead;
        let outcome = if !self.attitude_known {
            node.start(&measured, variance);
            StarTrackerUse::Started
        } else if node.correct(&measured, variance, self.config.gate) {
            StarTrackerUse::Used
        } else {
            self.outliers += 1;
            self.outliers_in_a_row += 1;
            if self.outliers_in_a_row < self.config.restart_after {
                return StarTrackerUse::Outlier;
            }
            node.start(&measured, variance);
            StarTrackerUse::Started
        };
        self.outliers_in_a_row = 0;
        self.attitude_known = true;
        self.last_used = Some(stamp);
        self.history.propagate_from(at, &self.config.gyro);
        outcome
    }
}
