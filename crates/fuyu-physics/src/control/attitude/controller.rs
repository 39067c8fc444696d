//! The attitude controller: holds the newest measurements, limits their ages, and falls back when one is too old.

use nalgebra::{DVector, Vector3};

use super::error::{finite, finite_vector, require_positive};
use super::{
    ArmMotion, AttitudeConfigError, AttitudeDeviation, AttitudeEstimate, AttitudeFilter,
    AttitudeInputError, AttitudeLaw, AttitudeRegulator, AttitudeTarget, RegulatorInput,
    RegulatorReport, StarTrackerUse,
};
use crate::control::{InputStatus, Stamp};
use crate::spatial::exp_so3;

/// Settings of an [`AttitudeController`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeControllerConfig {
    /// Largest age of gyro, wheel and joint samples that are used \[s\].
    pub timeout: f64,
    /// Age of the star tracker's last measurement from which it counts as lost \[s\].
    pub star_tracker_timeout: f64,
    /// Largest standard deviation of the estimated attitude about any axis with which it is controlled \[rad\].
    pub largest_uncertainty: f64,
}

impl Default for AttitudeControllerConfig {
    fn default() -> Self {
        Self {
            timeout: 0.5,
            star_tracker_timeout: 2.0,
            largest_uncertainty: 0.1,
        }
    }
}

/// Origin of the torques of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttitudeMode {
    /// Torques of the law, for the deviation from the reference.
    Law,
    /// Torques of the law for the rate alone: the attitude is not known well enough.
    RateDamping,
    /// Zero torques and closed valves: there is no recent gyro sample.
    ZeroTorque,
}

/// A step of an [`AttitudeController`].
#[derive(Debug, Clone, PartialEq)]
pub struct AttitudeReport {
    /// Time of the step.
    pub stamp: Stamp,
    /// Origin of the torques.
    pub mode: AttitudeMode,
    /// Estimated attitude, rate and bias, once there is a gyro sample.
    pub estimate: Option<AttitudeEstimate>,
    /// Deviation from the reference, if the attitude is known.
    pub deviation: Option<AttitudeDeviation>,
    /// Torques and momentum; `None` in [`AttitudeMode::ZeroTorque`].
    pub regulator: Option<RegulatorReport>,
    /// Status of the gyro.
    pub gyro: InputStatus,
    /// Status of the star tracker. If stale, the attitude is integrated from the gyro since its last measurement.
    pub star_tracker: InputStatus,
    /// Status of the wheel speeds.
    pub wheels: InputStatus,
    /// Status of the joint states.
    pub joints: InputStatus,
    /// Measurements of the star tracker so far that contradict the estimate.
    pub outliers: u64,
}

/// Attitude control with its inputs: filter, law, feed-forward, allocation and desaturation. A step allocates no
/// memory.
/// Samples arrive one by one, late, or not at all; a step uses the newest of each. The node and the simulation call
/// this same step, at times of their choice.
/// same step, at times that they choose.
///
/// | input | if missing or too old |
/// | --- | --- |
/// | gyro | zero torque, valves closed |
/// | star tracker | the gyro alone carries the attitude on, and its covariance grows; beyond [`AttitudeControllerConfig::largest_uncertainty`], and before the first measurement, the rate is damped and the attitude left free |
/// | wheel speeds | no momentum limits, no gyroscopic torque, no desaturation |
/// | joint states | no feed-forward |
/// | reference | the attitude of the first step at which it is known |
///
/// A gyro sample or joint state with an earlier stamp than the last starts another run.
#[derive(Debug)]
pub struct AttitudeController {
    config: AttitudeControllerConfig,
    filter: AttitudeFilter,
    regulator: AttitudeRegulator,
    target: Option<(Stamp, AttitudeTarget)>,
    wheel_speeds: Sample,
    q: Sample,
    qd: Sample,
    no_torques: DVector<f64>,
    no_on_times: Vec<f64>,
    mode: AttitudeMode,
    restarts: u32,
}

/// The newest values of an input.
#[derive(Debug)]
struct Sample {
    stamp: Option<Stamp>,
    values: DVector<f64>,
}

impl Sample {
    fn new(length: usize) -> Self {
        Self {
            stamp: None,
            values: DVector::zeros(length),
        }
    }

    /// Takes the values unless they are older than those held; if they are older by more than `timeout`, time has
    /// jumped back and they are taken.
    fn offer(&mut self, stamp: Stamp, values: &[f64], timeout: f64) {
        let is_late = |held: Stamp| (0.0..=timeout).contains(&held.seconds_since(stamp));
        if self
            .stamp
            .is_none_or(|held| stamp >= held || !is_late(held))
        {
            self.stamp = Some(stamp);
            self.values.copy_from_slice(values);
        }
    }
}

/// Whether a sample with this stamp may be used at `now`.
fn status(stamp: Option<Stamp>, now: Stamp, timeout: f64) -> InputStatus {
    match stamp.map(|stamp| now.seconds_since(stamp)) {
        None => InputStatus::Missing,
        Some(age) if age.abs() <= timeout => InputStatus::Used { age },
        Some(age) => InputStatus::Stale { age },
    }
}

impl AttitudeController {
    /// A controller before any input.
    ///
    /// # Errors
    /// [`AttitudeConfigError`] for a timeout or uncertainty that is not positive.
    pub fn new(
        filter: AttitudeFilter,
        regulator: AttitudeRegulator,
        config: AttitudeControllerConfig,
    ) -> Result<Self, AttitudeConfigError> {
        for (name, value) in [
            ("timeout [s]", config.timeout),
            ("star_tracker_timeout [s]", config.star_tracker_timeout),
            ("largest_uncertainty [rad]", config.largest_uncertainty),
        ] {
            require_positive(name, value)?;
        }
        let joints = regulator.joints();
        let wheels = regulator.wheels().wheels().len();
        Ok(Self {
            config,
            filter,
            target: None,
            wheel_speeds: Sample::new(wheels),
            q: Sample::new(joints),
            qd: Sample::new(joints),
            no_torques: DVector::zeros(wheels),
            no_on_times: vec![0.0; regulator.on_times().len()],
            mode: AttitudeMode::ZeroTorque,
            restarts: 0,
            regulator,
        })
    }

    /// Law, allocation and their settings.
    pub fn regulator(&self) -> &AttitudeRegulator {
        &self.regulator
    }

    /// Replaces the law without a step in the torque, see [`AttitudeRegulator::set_law`].
    pub fn set_law(&mut self, law: Box<dyn AttitudeLaw>) {
        self.regulator.set_law(law);
    }

    /// Sets the torques to zero until the next step, which starts like the first one, without state of the law. Filter
    /// and reference are kept.
    pub fn release(&mut self) {
        self.regulator.reset();
        self.mode = AttitudeMode::ZeroTorque;
    }

    /// Joint positions of the newest joint state \[rad or m\]; `None` before the first one.
    pub fn joint_positions(&self) -> Option<&[f64]> {
        self.q.stamp.map(|_| self.q.values.as_slice())
    }

    /// The attitude filter.
    pub fn filter(&self) -> &AttitudeFilter {
        &self.filter
    }

    /// Motor torques of the wheels of the last step \[N m\]. Always finite.
    pub fn wheel_torques(&self) -> &[f64] {
        match self.mode {
            AttitudeMode::ZeroTorque => self.no_torques.as_slice(),
            _ => self.regulator.wheel_torques(),
        }
    }

    /// On-times of the thrusters from the time of the last step on \[s\]; empty if thrusters are not used.
    pub fn on_times(&self) -> &[f64] {
        match self.mode {
            AttitudeMode::ZeroTorque => &self.no_on_times,
            _ => self.regulator.on_times(),
        }
    }

    /// Number of restarts.
    pub fn restarts(&self) -> u32 {
        self.restarts
    }

    /// Discards all inputs, including the reference.
    pub fn restart(&mut self) {
        self.restarts = self.restarts.wrapping_add(1);
        self.filter.restart();
        self.regulator.reset();
        self.target = None;
        for sample in [&mut self.wheel_speeds, &mut self.q, &mut self.qd] {
            sample.stamp = None;
        }
        self.mode = AttitudeMode::ZeroTorque;
    }

    /// Adds a gyro measurement, base axes \[rad/s\]. Returns the result for a star tracker measurement that waited for
    /// this sample.
    ///
    /// # Errors
    /// A value that is not finite; the sample is then not added.
    pub fn add_gyro(
        &mut self,
        stamp: Stamp,
        w_WB_B: Vector3<f64>,
    ) -> Result<Option<StarTrackerUse>, AttitudeInputError> {
        finite_vector("angular_velocity", &w_WB_B)?;
        if self.filter.newest_gyro().is_some_and(|last| stamp < last) {
            self.restart();
        }
        self.filter.add_gyro(stamp, w_WB_B)
    }

    /// Adds a measurement of the star tracker, at its time of exposure.
    ///
    /// # Errors
    /// A value that is not finite; the measurement is then not added.
    pub fn add_star_tracker(
        &mut self,
        stamp: Stamp,
        R_WB: &nalgebra::UnitQuaternion<f64>,
    ) -> Result<StarTrackerUse, AttitudeInputError> {
        self.filter.add_star_tracker(stamp, R_WB)
    }

    /// Adds speeds of the wheels relative to the base \[rad/s\], in the robot's order.
    ///
    /// # Errors
    /// A wrong number of values, or one that is not finite.
    pub fn add_wheel_speeds(
        &mut self,
        stamp: Stamp,
        speeds: &[f64],
    ) -> Result<(), AttitudeInputError> {
        check_length("wheel speeds", speeds, self.wheel_speeds.values.len())?;
        finite(speeds, |i| {
            format!(
                "speed of wheel {}",
                self.regulator.wheels().wheels()[i].name
            )
        })?;
        self.wheel_speeds.offer(stamp, speeds, self.config.timeout);
        Ok(())
    }

    /// Adds joint positions \[rad or m\] and rates \[rad/s or m/s\], in the model's order.
    ///
    /// # Errors
    /// A wrong number of values, or one that is not finite.
    pub fn add_joint_state(
        &mut self,
        stamp: Stamp,
        q: &[f64],
        qd: &[f64],
    ) -> Result<(), AttitudeInputError> {
        for (what, values) in [("joint positions", q), ("joint rates", qd)] {
            check_length(what, values, self.q.values.len())?;
            finite(values, |i| format!("{what}[{i}]"))?;
        }
        if self.q.stamp.is_some_and(|last| stamp < last) {
            self.restart();
        }
        self.q.offer(stamp, q, self.config.timeout);
        self.qd.offer(stamp, qd, self.config.timeout);
        Ok(())
    }

    /// Sets the reference: its attitude at `stamp`, from which it continues with its rate.
    ///
    /// # Errors
    /// A value that is not finite; the previous reference is then kept.
    pub fn set_target(
        &mut self,
        stamp: Stamp,
        target: &AttitudeTarget,
    ) -> Result<(), AttitudeInputError> {
        finite(target.R_WD.coords.as_slice(), |i| {
            format!("quaternion.{}", ["x", "y", "z", "w"][i])
        })?;
        finite_vector("angular_velocity", &target.w_WD_D)?;
        self.target = Some((stamp, *target));
        Ok(())
    }

    /// The reference at `now`, if there is one.
    pub fn target(&self, now: Stamp) -> Option<AttitudeTarget> {
        self.target.map(|(stamp, target)| AttitudeTarget {
            R_WD: target.R_WD * exp_so3(&(target.w_WD_D * now.seconds_since(stamp))),
            ..target
        })
    }

    /// Computes torques and on-times for the period that begins at `now`.
    pub fn step(&mut self, now: Stamp) -> AttitudeReport {
        let AttitudeControllerConfig {
            timeout,
            star_tracker_timeout,
            largest_uncertainty,
        } = self.config;
        let gyro = status(self.filter.newest_gyro(), now, timeout);
        let wheels = status(self.wheel_speeds.stamp, now, timeout);
        let joints = status(self.q.stamp, now, timeout);
        let estimate = self.filter.estimate(now);
        let known = estimate.filter(|estimate| {
            estimate.attitude_known && estimate.attitude_deviation() <= largest_uncertainty
        });
        if let Some(estimate) = &known
            && self.target.is_none()
        {
            self.target = Some((now, AttitudeTarget::fixed(estimate.R_WB)));
        }
        let deviation = known.zip(self.target(now)).map(|(estimate, target)| {
            AttitudeDeviation::new(&estimate.R_WB, &estimate.w_WB_B, &target)
        });
        let mut regulator = None;
        self.mode = AttitudeMode::ZeroTorque;
        if let Some(estimate) = estimate.filter(|_| gyro.is_used()) {
            let report = self.regulator.step(&RegulatorInput {
                deviation: deviation.unwrap_or(AttitudeDeviation {
                    angle: Vector3::zeros(),
                    rate: estimate.w_WB_B,
                }),
                w_WB_B: estimate.w_WB_B,
                wheel_speeds: wheels
                    .is_used()
                    .then(|| self.wheel_speeds.values.as_slice()),
                arm: joints.is_used().then(|| ArmMotion {
                    q: self.q.values.as_slice(),
                    qd: self.qd.values.as_slice(),
                    qdd: None,
                }),
            });
            let torques = self.regulator.wheel_torques();
            let mut values = torques.iter().chain(self.regulator.on_times());
            if values.all(|value| value.is_finite()) {
                regulator = Some(report);
                self.mode = match deviation {
                    Some(_) => AttitudeMode::Law,
                    None => AttitudeMode::RateDamping,
                };
            }
        }
        if self.mode == AttitudeMode::ZeroTorque {
            self.regulator.reset();
        }
        AttitudeReport {
            stamp: now,
            mode: self.mode,
            estimate,
            deviation,
            regulator,
            gyro,
            star_tracker: status(self.filter.newest_star_tracker(), now, star_tracker_timeout),
            wheels,
            joints,
            outliers: self.filter.outliers(),
        }
    }
}

fn check_length(
    what: &'static str,
    values: &[f64],
    expected: usize,
) -> Result<(), AttitudeInputError> {
    if values.len() == expected {
        return Ok(());
    }
    Err(AttitudeInputError::Length {
        what,
        got: values.len(),
        expected,
    })
}
