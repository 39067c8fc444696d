//! The control loop: takes measurements that arrive one by one, and returns joint efforts and a report.

mod joint_states;
mod newest;
mod report;
mod stamp;
mod stamp_pairs;
#[cfg(test)]
mod tests;

pub use report::{ControlMode, InputError, InputStatus, LoopReport};
pub use stamp::Stamp;
pub use stamp_pairs::StampPairs;

use joint_states::{JointSample, JointStates};
use nalgebra::{DVector, Vector3};
use newest::{FutureLimit, Newest};

use super::effort_delay_compensation::DelayCompensation;
use super::prediction::Prediction;
use super::{
    ConfigError, Controller, ControllerConfig, DelayStatus, GoalRate, Measurement, TipMeasurement,
};
use crate::spatial::Pose;

/// Settings of a [`ControlLoop`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlLoopConfig {
    /// Largest difference between the stamp of a measurement and that of the joint state being answered \[s\].
    pub timeout: f64,
    /// Whether every joint state waits for the measurements with its own stamp. The goal's angular velocity is then not
    /// used: an estimator publishes it at unpredictable times, so runs would not be reproducible.
    pub lockstep: bool,
    /// Whether the delay of the efforts is compensated ([`ControlLoop::add_command_delay`]): the law then gets the
    /// joint state, and the base's angular velocity, predicted for the time at which its efforts act. Until delays have
    /// been measured, and if the loop would not be stable, efforts are zero ([`DelayStatus`]). Tips and goals are
    /// predicted for the same time: [`Prediction::None`] is replaced by [`Prediction::Latency`]. The prediction assumes
    /// rigid links without closed loops.
    pub compensates_delay: bool,
}

/// A controller with its inputs. A step allocates no memory; queues are bounded.
///
/// A [`Controller`] evaluates its law for one consistent [`Measurement`]. Real inputs arrive separately, late, or not
/// at all. A [`ControlLoop`] combines such inputs into a consistent measurement: it pairs tip and goal poses by stamp,
/// keeps the newest sample of every input, decides by the age of a sample whether it may be used, and defines the
/// fallback without it. It reads no clock: the time of a step is the stamp of the joint state being answered. The
/// controller node and `fuyu simulate` run this same loop.
///
/// # Rules
/// - **Pairing.** A tip pose and a goal pose with equal stamps are one camera measurement, in any order of arrival.
/// - **Order.** The newest stamp counts. A sample older than the one held is dropped.
/// - **Age.** A sample is used if its stamp and that of the joint state differ by at most the timeout, either way.
/// - **Future.** A sample whose stamp is ahead of the newest joint state by more than the timeout is refused.
/// - **Restart.** A joint state with an earlier stamp than the one before starts another run: all samples are dropped and
///   the controller starts again with its settings. Equal stamps are the same state, sent twice.
/// - **Which joint state.** The newest; in lockstep the one with the stamp of the newest camera measurement, once the
///   other tips' measurements and the gyro have reached that stamp.
///
/// # Fallbacks
/// | input | if missing or stale |
/// | --- | --- |
/// | first tip's camera measurement | the joints are damped, `-K_V q̇`, unless the law works without it ([`JointPd`](super::JointPd) after its start) |
/// | second tip's camera measurement | the second tip is not controlled; the first is |
/// | gyro | the base's angular velocity is computed from the joint rates for zero angular momentum |
/// | goal's angular velocity | the goal's motion is estimated from the camera alone |
/// | law without efforts, or with efforts that are not finite ([`ControlError`](super::ControlError)) | the joints are damped |
/// | total efforts not finite | efforts are zero |
/// | delay of the efforts not known yet, or not stable with it, if it is to be compensated | efforts are zero |
///
/// Zero angular momentum is the fallback for the gyro because it follows the arm: a free-floating base turns mostly by
/// reaction to the joints, which the encoders measure now, whereas the last gyro sample describes a joint motion that
/// has ended. The fallback neglects the rotation due to the momentum itself, `H_B⁻¹ L`. Over a camera latency `T` the
/// predicted attitude errs by `T H_B⁻¹ L`: with latency compensation a small constant offset of the goal. The tip stays
/// under control, which would be lost with damping alone. Laws that hold the base's attitude no longer see it drift.
#[derive(Debug)]
pub struct ControlLoop {
    controller: Controller,
    config: ControlLoopConfig,
    future_limit: FutureLimit,
    joint_states: JointStates,
    tips: Vec<TipInput>,
    /// Measurements of the second and further tips for this step.
    more_tips: Vec<Option<TipMeasurement>>,
    gyro: Newest<Vector3<f64>>,
    goal_rate: Newest<GoalRate>,
    /// `None` if delays are not compensated.
    delay_compensation: Option<Box<DelayCompensation>>,
    efforts: DVector<f64>,
}

/// Camera measurements of one tip and its goal.
#[derive(Debug, Default)]
struct TipInput {
    poses: StampPairs<Stamp, Pose, Pose>,
    measurement: Newest<TipMeasurement>,
}

impl TipInput {
    fn clear(&mut self) {
        self.poses.clear();
        self.measurement.clear();
    }

    fn pair(&mut self) {
        while let Some((stamp, X_BE, X_BD)) = self.poses.pop() {
            let measurement = TipMeasurement::new(stamp.as_secs_f64(), X_BE, X_BD);
            self.measurement.offer(stamp, measurement);
        }
    }
}

impl ControlLoop {
    /// A loop around `controller`, before any input.
    pub fn new(controller: Controller, config: ControlLoopConfig) -> Self {
        let (joints, tips) = (controller.model().dof(), controller.tip_count());
        let mut control_loop = Self {
            future_limit: FutureLimit {
                newest: None,
                timeout: config.timeout,
            },
            joint_states: JointStates::new(joints),
            tips: (0..tips).map(|_| TipInput::default()).collect(),
            more_tips: vec![None; tips.saturating_sub(1)],
            gyro: Newest::default(),
            goal_rate: Newest::default(),
            efforts: DVector::zeros(joints),
            delay_compensation: (config.compensates_delay)
                .then(|| Box::new(DelayCompensation::new(controller.model()))),
            controller,
            config,
        };
        control_loop.predict_if_delays_are_compensated();
        control_loop
    }

    /// If delays are compensated, the law uses a predicted joint state. Tip and base must then be predicted for the
    /// same time, even if the configuration requests no prediction.
    fn predict_if_delays_are_compensated(&mut self) {
        let has_none = self.controller.config().prediction == Prediction::None;
        if self.config.compensates_delay && has_none {
            self.controller.set_prediction(Prediction::Latency);
        }
    }

    /// The controller.
    pub fn controller(&self) -> &Controller {
        &self.controller
    }

    /// Settings of the loop.
    pub fn config(&self) -> &ControlLoopConfig {
        &self.config
    }

    /// Changes law or gains: see [`Controller::set_config`].
    ///
    /// # Errors
    /// [`ConfigError`] if the settings do not fit the robot; nothing has then changed.
    pub fn set_controller_config(&mut self, config: ControllerConfig) -> Result<(), ConfigError> {
        self.controller.set_config(config)?;
        self.predict_if_delays_are_compensated();
        if let Some(compensation) = &mut self.delay_compensation {
            compensation.controller_changes();
        }
        Ok(())
    }

    /// Efforts of the last step \[N m or N\], one per joint. Always finite.
    pub fn efforts(&self) -> &DVector<f64> {
        &self.efforts
    }

    /// Adds a joint state: positions `q` \[rad or m\] and rates `qd` \[rad/s or m/s\] in the model's order. An earlier
    /// stamp than the last one starts another run.
    ///
    /// # Errors
    /// [`InputError`] if a vector has a wrong length or a value that is not finite; the joint state is then not added.
    pub fn add_joint_state(
        &mut self,
        stamp: Stamp,
        q: &[f64],
        qd: &[f64],
    ) -> Result<(), InputError> {
        let joints = self.efforts.len();
        for (what, values) in [("joint position", q), ("joint velocity", qd)] {
            if values.len() != joints {
                let got = values.len();
                return Err(InputError::WrongLength { what, got, joints });
            }
            finite(what, values)?;
        }
        if self.future_limit.newest.is_some_and(|last| stamp < last) {
            self.restart();
        }
        self.future_limit.newest = Some(stamp);
        for tip in &mut self.tips {
            tip.measurement.drop_ahead(&self.future_limit);
        }
        self.gyro.drop_ahead(&self.future_limit);
        self.goal_rate.drop_ahead(&self.future_limit);
        self.joint_states.push(stamp, q, qd);
        Ok(())
    }

    /// Adds a camera measurement of a tip: its pose in the base frame at the exposure `stamp`. Tip 0 is the first.
    ///
    /// # Errors
    /// [`InputError`] if the pose is refused.
    pub fn add_tip_pose(&mut self, tip: usize, stamp: Stamp, X_BE: Pose) -> Result<(), InputError> {
        let input = self.tip_input(tip, "tip pose", stamp, &X_BE)?;
        input.poses.push_first(stamp, X_BE);
        input.pair();
        Ok(())
    }

    /// Adds a camera measurement of a tip's goal: its pose in the base frame at the exposure `stamp`.
    ///
    /// # Errors
    /// [`InputError`] if the pose is refused.
    pub fn add_goal_pose(
        &mut self,
        tip: usize,
        stamp: Stamp,
        X_BD: Pose,
    ) -> Result<(), InputError> {
        let input = self.tip_input(tip, "goal pose", stamp, &X_BD)?;
        input.poses.push_second(stamp, X_BD);
        input.pair();
        Ok(())
    }

    /// Adds a gyro measurement: the angular velocity of the base in base axes \[rad/s\].
    ///
    /// # Errors
    /// [`InputError`] if the sample is refused.
    pub fn add_gyro(&mut self, stamp: Stamp, w_WB_B: Vector3<f64>) -> Result<(), InputError> {
        finite("angular_velocity", w_WB_B.as_slice())?;
        self.future_limit.check(stamp)?;
        self.gyro.offer(stamp, w_WB_B);
        Ok(())
    }

    /// Adds an estimate of the angular velocity of the first tip's goal, in the base axes of that time \[rad/s\].
    ///
    /// # Errors
    /// [`InputError`] if the sample is refused.
    pub fn add_goal_rate(&mut self, stamp: Stamp, w_WD_B: Vector3<f64>) -> Result<(), InputError> {
        finite("the goal's angular velocity", w_WD_B.as_slice())?;
        self.future_limit.check(stamp)?;
        let rate = GoalRate {
            time: stamp.as_secs_f64(),
            w_ID_B: w_WD_B,
        };
        self.goal_rate.offer(stamp, rate);
        Ok(())
    }

    /// Adds a measured delay of a command \[s\]: from the stamp of a joint state to the time from which the efforts computed from it
    /// acted. Ignored if delays are not compensated.
    ///
    /// # Errors
    /// [`InputError`] if the delay is negative or not finite.
    pub fn add_command_delay(&mut self, delay: f64) -> Result<(), InputError> {
        let what = "the delay of a command";
        finite(what, &[delay])?;
        if delay < 0.0 {
            return Err(InputError::Negative { what });
        }
        if let Some(compensation) = &mut self.delay_compensation {
            compensation.add_delay(delay);
        }
        Ok(())
    }

    /// Drops the queued joint states without answering them. Measurements are kept.
    pub fn skip(&mut self) {
        self.joint_states.clear();
    }

    /// Drops all inputs and restarts the controller with its settings, for another run.
    pub fn restart(&mut self) {
        self.joint_states.clear();
        self.tips.iter_mut().for_each(TipInput::clear);
        self.gyro.clear();
        self.goal_rate.clear();
        self.future_limit.newest = None;
        if let Some(compensation) = &mut self.delay_compensation {
            compensation.restart();
        }
        self.controller.restart();
    }

    /// Answers the joint state that is due, if there is one, and updates [`ControlLoop::efforts`]. In lockstep several
    /// may be due: call this until it returns `None`.
    pub fn step(&mut self) -> Option<LoopReport> {
        let state = self.next_joint_state()?;
        let report = self.answer(&state);
        self.joint_states.give_back(state);
        Some(report)
    }

    fn next_joint_state(&mut self) -> Option<JointSample> {
        if !self.config.lockstep {
            return self.joint_states.take_newest();
        }
        let (first, others) = self.tips.split_first()?;
        let frame = first.measurement.stamp()?;
        let mut needed = (others.iter().map(|tip| tip.measurement.stamp()))
            .chain(std::iter::once(self.gyro.stamp()));
        let complete = needed.all(|stamp| stamp.is_some_and(|stamp| stamp >= frame));
        if complete {
            self.joint_states.take_at(frame)
        } else {
            None
        }
    }

    fn answer(&mut self, state: &JointSample) -> LoopReport {
        let (now, timeout) = (state.stamp, self.config.timeout);
        let (first, others) = match self.tips.split_first() {
            Some((first, others)) => (first.measurement.at(now, timeout), others),
            None => ((InputStatus::Missing, None), &[][..]),
        };
        let mut second_tip = None;
        for (slot, tip) in self.more_tips.iter_mut().zip(others) {
            let (status, measurement) = tip.measurement.at(now, timeout);
            *slot = measurement.copied();
            second_tip.get_or_insert(status);
        }
        let gyro = self.gyro.at(now, timeout);
        let goal_rate = if self.config.lockstep {
            (InputStatus::Ignored, None)
        } else {
            self.goal_rate.at(now, timeout)
        };
        let mut compensation = self.delay_compensation.as_deref_mut();
        let delay = match &mut compensation {
            None => DelayStatus::NotCompensated,
            Some(compensation) => compensation.judge(now, &state.q, &mut self.controller),
        };
        let mut joints = (now.as_secs_f64(), &state.q, &state.qd);
        let mut w_IB_B = gyro.1;
        if let (DelayStatus::Compensated { delay }, Some(compensation)) = (delay, &mut compensation)
        {
            compensation.predict(now, (&state.q, &state.qd), gyro.1, delay);
            joints = (joints.0 + delay, compensation.q(), compensation.qd());
            w_IB_B = gyro.1.map(|_| compensation.w_IB_B());
        }
        let measurement = Measurement {
            more_tips: &self.more_tips,
            goal_rate: goal_rate.1,
            ..Measurement::new(joints.0, joints.1, joints.2)
        };
        let measurement = measurement.with_tip(first.1).with_gyro(w_IB_B);
        let control = self.controller.update(&measurement);
        self.efforts.copy_from(self.controller.efforts());
        let is_held = matches!(delay, DelayStatus::Measuring | DelayStatus::Refused(_));
        let is_finite = self.efforts.iter().all(|effort| effort.is_finite());
        let mode = if is_finite && !is_held {
            match &control {
                Ok(report) if report.active => ControlMode::Law,
                _ => ControlMode::DampingOnly,
            }
        } else {
            self.efforts.fill(0.0);
            ControlMode::ZeroEfforts
        };
        if let Some(compensation) = &mut self.delay_compensation {
            compensation.record(now, &self.efforts);
        }
        LoopReport {
            stamp: now,
            control,
            mode,
            tip: first.0,
            second_tip,
            gyro: gyro.0,
            goal_rate: goal_rate.0,
            delay,
        }
    }

    fn tip_input(
        &mut self,
        tip: usize,
        what: &'static str,
        stamp: Stamp,
        pose: &Pose,
    ) -> Result<&mut TipInput, InputError> {
        finite(what, pose.translation.vector.as_slice())?;
        finite(what, pose.rotation.matrix().as_slice())?;
        self.future_limit.check(stamp)?;
        let tips = self.tips.len();
        (self.tips.get_mut(tip)).ok_or(InputError::NoSuchTip { tip, tips })
    }
}

fn finite(what: &'static str, values: &[f64]) -> Result<(), InputError> {
    if values.iter().all(|value| value.is_finite()) {
        Ok(())
    } else {
        Err(InputError::NotFinite { what })
    }
}
