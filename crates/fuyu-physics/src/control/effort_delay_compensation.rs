//! Delay compensation: predicts the joint state for the time at which the resulting efforts act.
//!
//! Over a network, the efforts computed from the state at time `t` act at `t + d`. A law that uses the state at `t`
//! then damps with a delay, and the loop is unstable unless the gains are small ([`SampledDamping::limit_if_late`]). So
//! the state is predicted from `t` to `t + d` by the robot's equations of motion, with the efforts that have been sent
//! and act in that time (a state predictor: Manitius and Olbrot, Finite spectrum assignment problem for systems with
//! delays, IEEE Trans. Automatic Control 24 (1979) 541). The law then receives the state on which its efforts act.
//!
//! With an exact model the delay has no effect. With a relative error `ε` of the model's inertia, sampled damping at
//! the rate `λ` obeys `z^(m+1) - (1 - (1 + ε) λ T) z^m - ε λ T = 0` for a delay of `m` periods `T`. All roots lie
//! within the unit circle, for any `m`, if `|1 - (1 + ε) λ T| + |ε| λ T < 1` (Rouché), thus if `|ε| < 1/2` and `λ T < 2
//! / (1 + 2 |ε|)`.

#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use nalgebra::{DVector, Vector3};

use super::{Controller, SampledDamping, Stamp};
use crate::dynamics::{Input, IntegrationMethod, Integrator, Momentum, State, Workspace};
use crate::model::Model;
use crate::spatial::Twist;

/// Number of delays that are measured before any efforts are given.
const FIRST_DELAYS: usize = 10;
/// Number of most recent delays that are evaluated.
const WINDOW: usize = 31;
/// The longest delay that is compensated, in periods of the states.
const MAX_PERIODS: f64 = 50.0;
/// Number of stored commands: more than can have been sent but not act yet.
const REMEMBERED: usize = 64;
/// Relative error of the model's inertia for which the loop must be stable.
const MODEL_ERROR: f64 = 0.2;
/// Rate at which the compensated delay follows the measured one \[s per s\].
const SLEW: f64 = 0.1;
/// Longest step of the prediction \[s\].
const MAX_STEP: f64 = 0.005;

/// Status of the delay compensation in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DelayStatus {
    /// Delays are not compensated.
    NotCompensated,
    /// Too few delays have been measured: efforts are zero.
    Measuring,
    /// The law uses the predicted state.
    Compensated {
        /// The delay \[s\].
        delay: f64,
    },
    /// The control loop would not be stable: efforts are zero.
    Refused(DelayError),
}

/// Why a delay is not compensated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum DelayError {
    /// The delay is too long.
    #[error(
        "efforts act {delay:.3} s after the states that they answer; at most {limit:.3} s can be compensated"
    )]
    TooLong {
        /// The delay \[s\].
        delay: f64,
        /// The longest that is compensated \[s\].
        limit: f64,
    },
    /// The gains are too large for the remaining uncertainty of the delay.
    #[error(
        "efforts act {delay:.3} s after the states that they answer, with a spread of {spread:.3} s, and the law damps at \
         {rate:.0} 1/s; that is stable up to {limit:.0} 1/s"
    )]
    Unstable {
        /// The delay \[s\].
        delay: f64,
        /// Spread of the delay \[s\].
        spread: f64,
        /// Rate of the fastest damping \[1/s\].
        rate: f64,
        /// The largest stable rate \[1/s\].
        limit: f64,
    },
}

/// Predicts joint states by the measured delay of the efforts. A step allocates no memory, except the first one with a
/// delay and those after a change of settings.
#[derive(Debug)]
pub(super) struct DelayCompensation {
    integrator: Integrator,
    workspace: Workspace,
    state: State,
    w_IB_B: Vector3<f64>,
    /// Largest efforts of the actuators \[N m or N\].
    limits: DVector<f64>,
    /// Efforts that currently act in the prediction.
    acting: DVector<f64>,
    /// Efforts with the stamp of the state from which they were computed, oldest first.
    sent: VecDeque<(Stamp, DVector<f64>)>,
    unused: Vec<DVector<f64>>,
    /// The most recent delays \[s\], oldest first.
    delays: VecDeque<f64>,
    sorted: Vec<f64>,
    /// The compensated delay \[s\]; `None` before the first.
    delay: Option<f64>,
    /// Time between two states \[s\]; zero before it is known.
    period: f64,
    /// Stamp of the last state.
    last: Option<Stamp>,
    /// Rate of the controller's fastest damping \[1/s\]; `None` before it is computed.
    rate: Option<f64>,
}

impl DelayCompensation {
    /// For a robot whose links and joints move freely, without measured delays.
    pub fn new(model: &Model) -> Self {
        let joints = model.dof();
        let limits = model.joints().iter().map(|joint| joint.limits.effort);
        Self {
            integrator: Integrator::new(model, IntegrationMethod::Rk4),
            workspace: Workspace::new(model),
            state: State::at_rest(model),
            w_IB_B: Vector3::zeros(),
            limits: DVector::from_iterator(joints, limits),
            acting: DVector::zeros(joints),
            sent: VecDeque::with_capacity(REMEMBERED),
            unused: vec![DVector::zeros(joints); REMEMBERED],
            delays: VecDeque::with_capacity(WINDOW),
            sorted: Vec::with_capacity(WINDOW),
            delay: None,
            period: 0.0,
            last: None,
            rate: None,
        }
    }

    /// Discards the run, including its measured delays.
    pub fn restart(&mut self) {
        self.unused.extend(self.sent.drain(..).map(|(_, e)| e));
        self.delays.clear();
        self.delay = None;
        self.last = None;
        self.rate = None;
    }

    /// Must be called after a change of the controller's settings.
    pub fn controller_changes(&mut self) {
        self.rate = None;
    }

    /// Adds a measured delay \[s\], from a state to the time at which the efforts computed from it acted.
    pub fn add_delay(&mut self, delay: f64) {
        if self.delays.len() == WINDOW {
            self.delays.pop_front();
        }
        self.delays.push_back(delay);
    }

    /// Determines how to compensate the delay of the efforts computed from the state of `stamp` with the joint
    /// positions `q`.
    pub fn judge(
        &mut self,
        stamp: Stamp,
        q: &DVector<f64>,
        controller: &mut Controller,
    ) -> DelayStatus {
        let since = self.last.replace(stamp);
        let passed = since.map_or(0.0, |last| stamp.seconds_since(last));
        // Skipped states lengthen the interval.
        if passed > 0.0 && (self.period == 0.0 || passed < self.period) {
            self.period = passed;
        }
        if self.delays.len() < FIRST_DELAYS || self.period == 0.0 {
            return DelayStatus::Measuring;
        }
        let (median, spread) = self.delay_and_spread();
        // The time of the predicted states must not jump.
        let most = SLEW * passed.max(0.0);
        let delay = match self.delay {
            Some(delay) => delay + (median - delay).clamp(-most, most),
            None => median,
        };
        self.delay = Some(delay);
        let limit = MAX_PERIODS * self.period;
        if delay > limit {
            return DelayStatus::Refused(DelayError::TooLong { delay, limit });
        }
        let known = self.rate;
        let rate = known.unwrap_or_else(|| controller.damping_rate(q).unwrap_or(0.0));
        self.rate = Some(rate);
        let limit = largest_damping(spread / self.period) / self.period;
        if rate > limit {
            return DelayStatus::Refused(DelayError::Unstable {
                delay,
                spread,
                rate,
                limit,
            });
        }
        DelayStatus::Compensated { delay }
    }

    /// Median of the delays, and the width of the interval that contains their middle four fifths \[s\].
    fn delay_and_spread(&mut self) -> (f64, f64) {
        let Self { delays, sorted, .. } = self;
        sorted.clear();
        sorted.extend(delays.iter());
        sorted.sort_unstable_by(f64::total_cmp);
        let at = |tenths: usize| sorted[tenths * (sorted.len() - 1) / 10];
        (at(5), at(9) - at(1))
    }

    /// Predicts the state of `stamp` (positions `q`, rates `qd`, and the angular velocity of the base, if measured) by
    /// `delay` \[s\].
    pub fn predict(
        &mut self,
        stamp: Stamp,
        (q, qd): (&DVector<f64>, &DVector<f64>),
        w_IB_B: Option<&Vector3<f64>>,
        delay: f64,
    ) {
        let Self {
            state, workspace, ..
        } = self;
        state.q.copy_from(q);
        state.qd.copy_from(qd);
        state.R_WB = Default::default();
        state.p_WC = Vector3::zeros();
        state.momentum_W = Momentum::default();
        if let Some(angular) = w_IB_B {
            workspace.set_positions(q);
            let (angular, linear) = (*angular, Vector3::zeros());
            // Angular momentum about the centre of mass is independent of the velocity of the centre of mass.
            let momentum = workspace.momentum_of(&Twist { angular, linear }, qd);
            state.momentum_W.angular = momentum.angular;
        }
        // Efforts act from the delay after their state on, until the next ones act.
        self.acting.fill(0.0);
        let mut time = 0.0;
        for i in 0..self.sent.len() {
            let acts = self.sent[i].0.seconds_since(stamp) + delay;
            if acts >= delay {
                break;
            }
            self.advance(acts - time);
            time = acts.max(time);
            self.acting.copy_from(&self.sent[i].1);
        }
        self.advance(delay - time);
        self.w_IB_B = match w_IB_B {
            Some(measured) if delay <= 0.0 => *measured,
            _ => self.workspace.V_WB_B().angular,
        };
    }

    /// Steps the state under the acting efforts.
    fn advance(&mut self, duration: f64) {
        if duration <= 0.0 {
            return;
        }
        let steps = (duration / MAX_STEP).ceil();
        let Self {
            acting,
            limits,
            integrator,
            state,
            workspace,
            ..
        } = self;
        let mut hold = |_: f64, _: &State, input: &mut Input| {
            for ((held, effort), limit) in input.efforts.iter_mut().zip(&*acting).zip(&*limits) {
                *held = effort.clamp(-limit, *limit);
            }
        };
        integrator.steps(
            state,
            workspace,
            duration / steps,
            steps as usize,
            &mut hold,
        );
    }

    /// Predicted joint positions.
    pub fn q(&self) -> &DVector<f64> {
        &self.state.q
    }

    /// Predicted joint rates.
    pub fn qd(&self) -> &DVector<f64> {
        &self.state.qd
    }

    /// Predicted angular velocity of the base, base axes \[rad/s\].
    pub fn w_IB_B(&self) -> &Vector3<f64> {
        &self.w_IB_B
    }

    /// Stores the efforts computed from the state of `stamp`.
    pub fn record(&mut self, stamp: Stamp, efforts: &DVector<f64>) {
        // The same state was sent and answered twice.
        while self.sent.back().is_some_and(|(last, _)| *last >= stamp) {
            self.unused.extend(self.sent.pop_back().map(|(_, e)| e));
        }
        let slot = self.unused.pop();
        let slot = slot.or_else(|| self.sent.pop_front().map(|(_, e)| e));
        if let Some(mut slot) = slot {
            slot.copy_from(efforts);
            self.sent.push_back((stamp, slot));
        }
    }
}

/// Largest stable product of damping rate and period if delays vary by `spread` periods: the variation is treated as an
/// uncompensated delay of that length.
fn largest_damping(spread: f64) -> f64 {
    let with_model_error = SampledDamping::UNSTABLE / (1.0 + 2.0 * MODEL_ERROR);
    let late = match spread <= 1.0 {
        true => SampledDamping::UNSTABLE_IF_LATE / spread.max(0.0),
        false => SampledDamping::limit_if_late(spread.ceil() as u32),
    };
    with_model_error.min(late)
}
