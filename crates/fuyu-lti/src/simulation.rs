//! Responses in time. Continuous systems are held exactly over each step; nothing is integrated numerically.

use nalgebra::DVector;

use crate::matrix::shaped;
use crate::{LtiError, StateSpace};

impl StateSpace {
    /// Outputs of a discrete system, from zero state, for inputs `u(k)`: one vector per sample, `samples` of them.
    ///
    /// For a continuous system take [`StateSpace::zero_order_hold`] first, which is exact for inputs that are constant over each step.
    pub fn simulate(
        &self,
        samples: usize,
        mut input: impl FnMut(usize) -> DVector<f64>,
    ) -> Result<Vec<DVector<f64>>, LtiError> {
        if self.sampling_time.is_none() {
            return Err(LtiError::TimeDomain {
                what: "a simulation",
                expected: "a discrete system; take the zero-order hold of this one".into(),
            });
        }
        let mut x = DVector::zeros(self.order());
        let mut out = Vec::with_capacity(samples);
        for k in 0..samples {
            let u = input(k);
            shaped(
                "the input",
                &crate::Matrix::from_column_slice(u.len(), 1, u.as_slice()),
                self.inputs(),
                1,
            )?;
            out.push(&self.c * &x + &self.d * &u);
            x = &self.a * x + &self.b * u;
        }
        Ok(out)
    }

    /// Outputs of a discrete system for a unit step at one input, counted from 0.
    pub fn step_response(
        &self,
        input: usize,
        samples: usize,
    ) -> Result<Vec<DVector<f64>>, LtiError> {
        let one = self.select(&(0..self.outputs()).collect::<Vec<_>>(), &[input])?;
        one.simulate(samples, |_| DVector::from_element(1, 1.0))
    }

    /// Outputs of a continuous system at multiples of `step` for an impulse at one input: `C exp(A t) B`. D must be zero.
    pub fn impulse_response(
        &self,
        input: usize,
        step: f64,
        samples: usize,
    ) -> Result<Vec<DVector<f64>>, LtiError> {
        let one = self.select(&(0..self.outputs()).collect::<Vec<_>>(), &[input])?;
        one.require_no_feedthrough("a system with an impulse response")?;
        let phi = one.zero_order_hold(step)?.a;
        let mut x: DVector<f64> = one.b.column(0).into_owned();
        let mut out = Vec::with_capacity(samples);
        for _ in 0..samples {
            out.push(&one.c * &x);
            x = &phi * x;
        }
        Ok(out)
    }
}

/// A continuous plant under a sampled controller, with torque limits and a delay of whole samples.
///
/// At each sample: the controller gets `r - y` (one per measurement), its command is limited to `+-limit`, and acts `delay_samples` later
/// for one sampling time. The controller is not informed of the limit.
#[derive(Debug, Clone)]
pub struct SampledLoop {
    plant: StateSpace,
    controller: StateSpace,
    /// Largest command of each input, in its unit; infinite for none.
    pub limit: f64,
    /// How many samples a command waits.
    pub delay_samples: usize,
}

/// Samples of a [`SampledLoop`].
#[derive(Debug, Clone, Default)]
pub struct SampledRun {
    /// Times in s.
    pub time: Vec<f64>,
    /// Plant outputs at these times.
    pub output: Vec<DVector<f64>>,
    /// Commands that are applied from these times on, after the limit.
    pub command: Vec<DVector<f64>>,
    /// Number of samples at which some command was limited.
    pub saturated: usize,
}

impl SampledLoop {
    /// Plant and controller are continuous and sampled with zero-order hold every `step` s; a discrete controller is taken as it is. The plant must be strictly proper.
    pub fn new(plant: &StateSpace, controller: &StateSpace, step: f64) -> Result<Self, LtiError> {
        shaped(
            "D of the controller",
            &controller.d,
            plant.inputs(),
            plant.outputs(),
        )?;
        plant.require_no_feedthrough("the plant")?;
        let controller = match controller.sampling_time {
            Some(h) if h == step => controller.clone(),
            Some(_) => {
                return Err(LtiError::TimeDomain {
                    what: "a sampled loop",
                    expected: format!("a controller sampled every {step} s"),
                });
            }
            None => controller.zero_order_hold(step)?,
        };
        Ok(Self {
            plant: plant.zero_order_hold(step)?,
            controller,
            limit: f64::INFINITY,
            delay_samples: 0,
        })
    }

    /// Runs from rest with the reference `r(t)` of each output and the disturbance `w(t)` added to each input, held over each step.
    pub fn run(
        &self,
        samples: usize,
        mut reference: impl FnMut(f64) -> DVector<f64>,
        mut disturbance: impl FnMut(f64) -> DVector<f64>,
    ) -> Result<SampledRun, LtiError> {
        if self.limit.is_nan() || self.limit < 0.0 {
            return Err(LtiError::Range {
                what: "the limit of the command".into(),
                value: self.limit,
                expected: "zero or more",
            });
        }
        let h = self.plant.sampling_time.unwrap_or(1.0);
        let m = self.plant.inputs();
        let (mut x, mut k) = (
            DVector::zeros(self.plant.order()),
            DVector::zeros(self.controller.order()),
        );
        let mut waiting =
            std::collections::VecDeque::from(vec![DVector::zeros(m); self.delay_samples]);
        let mut run = SampledRun::default();
        for i in 0..samples {
            let t = i as f64 * h;
            let y = &self.plant.c * &x;
            let error = reference(t) - &y;
            let wanted = &self.controller.c * &k + &self.controller.d * &error;
            k = &self.controller.a * k + &self.controller.b * error;
            let allowed = wanted.map(|u| u.clamp(-self.limit, self.limit));
            run.saturated += usize::from(allowed != wanted);
            waiting.push_back(allowed);
            let applied = waiting.pop_front().expect("one was pushed");
            x = &self.plant.a * x + &self.plant.b * (&applied + disturbance(t));
            run.time.push(t);
            run.output.push(y);
            run.command.push(applied);
        }
        Ok(run)
    }
}

/// Overshoot and settling of a sampled step response towards `target`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepFigures {
    /// Largest excess over the target, in percent of it.
    pub overshoot_percent: f64,
    /// Time in s after which the response stays within the band.
    pub settling: f64,
    /// Time in s at which it first reaches 90 % of the target; infinite if never.
    pub rise: f64,
}

/// Figures of a response sampled every `step` s, with a band of `band` (.05 for 5 %) of the target.
pub fn step_figures(response: &[f64], step: f64, target: f64, band: f64) -> StepFigures {
    let relative = |y: &f64| y / target;
    let highest = response
        .iter()
        .map(relative)
        .fold(f64::NEG_INFINITY, f64::max);
    let last_outside = response
        .iter()
        .rposition(|y| (relative(y) - 1.0).abs() > band);
    let rise = response.iter().position(|y| relative(y) >= 0.9);
    StepFigures {
        overshoot_percent: 100.0 * (highest - 1.0).max(0.0),
        settling: last_outside.map_or(0.0, |i| {
            if i + 1 == response.len() {
                f64::INFINITY
            } else {
                (i + 1) as f64 * step
            }
        }),
        rise: rise.map_or(f64::INFINITY, |i| i as f64 * step),
    }
}
