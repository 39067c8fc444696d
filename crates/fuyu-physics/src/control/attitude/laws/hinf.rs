//! Rate feedback inside an H-infinity loop, one axis at a time.

use fuyu_lti::kida1993::double_loop::{DoubleLoop, Problem, covering_gain};
use fuyu_lti::{LtiError, StateSpace, TransferFunction};
use nalgebra::{DVector, Vector3};

use crate::control::attitude::error::{require, require_positive};
use crate::control::attitude::{
    AttitudeConfigError, AttitudeDeviation, AttitudeLaw, AttitudePlant,
};

/// Design of a [`DoubleLoopLaw`] (Kida 1993 section 4.4.1): mixed sensitivity for the rigid model `1/(J s² + D s)` of
/// each axis, with the weight `k s² / (s² + 2.8 w0 s + 4 w0²)` on the complementary sensitivity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DoubleLoopConfig {
    /// D, the inner rate feedback \[N m s/rad\].
    pub rate_gain: f64,
    /// w0, near the bandwidth wanted \[rad/s\].
    pub frequency: f64,
    /// k for each axis; `None` for 1.1 times the smallest value that covers the model error of all given plants, but at
    /// least 10.
    pub cover: Option<[f64; 3]>,
    /// Fraction of the largest possible gamma that the design uses, below 1.
    pub fraction: f64,
    /// Noise on angle and rate in units of `1` and `frequency`, which makes the problem regular.
    pub noise: f64,
}

impl DoubleLoopConfig {
    /// Settings with k from the plants, .9 of the largest gamma and a noise of .01.
    pub fn new(rate_gain: f64, frequency: f64) -> Self {
        Self {
            rate_gain,
            frequency,
            cover: None,
            fraction: 0.9,
            noise: 0.01,
        }
    }

    fn check(&self) -> Result<(), AttitudeConfigError> {
        require_positive("hinf.rate_gain [N m s/rad]", self.rate_gain)?;
        require_positive("hinf.frequency [rad/s]", self.frequency)?;
        require_positive("hinf.noise", self.noise)?;
        for (axis, k) in ["x", "y", "z"].iter().zip(self.cover.into_iter().flatten()) {
            require_positive(&format!("hinf.cover of the {axis} axis"), k)?;
        }
        let f = self.fraction;
        require("hinf.fraction", f, f > 0.0 && f < 1.0, "between 0 and 1")
    }

    fn weight(&self, k: f64) -> Result<TransferFunction, LtiError> {
        let w0 = self.frequency;
        TransferFunction::new(&[k, 0.0, 0.0], &[1.0, 2.8 * w0, 4.0 * w0 * w0])
    }

    fn problem(&self, inertia: f64, k: f64) -> Result<Problem, LtiError> {
        Ok(Problem {
            inertia,
            rate_gain: self.rate_gain,
            robustness: self.weight(k)?,
            frequency: self.frequency,
            noise: self.noise,
        })
    }
}

/// Smallest k: the loop's gain then also falls above w0 about axes that couple to no vibration.
const LEAST_COVER: f64 = 10.0;

/// The double loop: rate feedback D, and around it an H-infinity controller for each axis, sampled by Tustin's method.
#[derive(Debug, Clone)]
pub struct DoubleLoopLaw {
    axes: [Axis; 3],
    rate_gain: f64,
}

/// One axis.
#[derive(Debug, Clone)]
struct Axis {
    design: DoubleLoop,
    k: f64,
    sampled: StateSpace,
    x: DVector<f64>,
    next: DVector<f64>,
}

impl DoubleLoopLaw {
    /// The law for torques held for `period` \[s\]. The inertia is that of the first of `plants`; the weight covers the
    /// error of all plants, so give the plants of all expected postures.
    ///
    /// # Errors
    /// [`AttitudeConfigError`] for a setting out of its range, and if no controller exists.
    ///
    /// # Panics
    /// If there is no plant.
    pub fn new(
        plants: &[AttitudePlant],
        config: &DoubleLoopConfig,
        period: f64,
    ) -> Result<Self, AttitudeConfigError> {
        config.check()?;
        require_positive("period [s]", period)?;
        let inertia = plants[0].axis_inertia();
        let mut axes = Vec::with_capacity(3);
        for (i, name) in ["x", "y", "z"].into_iter().enumerate() {
            let what = format!("hinf about the {name} axis");
            let axis = Axis::new(plants, i, inertia[i], config, period)
                .map_err(AttitudeConfigError::design(&what))?;
            axes.push(axis);
        }
        let [x, y, z]: [Axis; 3] = axes
            .try_into()
            .unwrap_or_else(|_| unreachable!("three axes"));
        Ok(Self {
            axes: [x, y, z],
            rate_gain: config.rate_gain,
        })
    }

    /// The design about axis `i`.
    ///
    /// # Panics
    /// If `i` is not 0, 1 or 2.
    pub fn design(&self, i: usize) -> &DoubleLoop {
        &self.axes[i].design
    }

    /// k of the weight about each axis.
    pub fn cover(&self) -> [f64; 3] {
        [0, 1, 2].map(|i| self.axes[i].k)
    }
}

impl Axis {
    fn new(
        plants: &[AttitudePlant],
        axis: usize,
        inertia: f64,
        config: &DoubleLoopConfig,
        period: f64,
    ) -> Result<Self, LtiError> {
        let k = match config.cover {
            Some(k) => k[axis],
            None => {
                let mut structures = Vec::with_capacity(plants.len());
                for plant in plants {
                    structures.push(plant.axis(axis)?);
                }
                let problem = config.problem(inertia, 1.0)?;
                let grid = structures[0].displacement_system()?.frequency_grid(
                    5e-3 * config.frequency,
                    500.0 * config.frequency,
                    300,
                )?;
                let weight = config.weight(1.0)?;
                1.1 * covering_gain(&structures, 0, &problem, &weight, &grid)?
            }
        };
        let k = k.max(LEAST_COVER);
        let design = config.problem(inertia, k)?.solve(config.fraction)?;
        let sampled = design.outer.tustin(period)?;
        Ok(Self {
            x: DVector::zeros(sampled.order()),
            next: DVector::zeros(sampled.order()),
            sampled,
            design,
            k,
        })
    }

    /// Output of the outer loop, and one step of its state.
    fn step(&mut self, angle: f64, rate: f64) -> f64 {
        let StateSpace { a, b, c, d, .. } = &self.sampled;
        let of_state: f64 = c.row(0).iter().zip(&self.x).map(|(c, x)| c * x).sum();
        let output = of_state + d[(0, 0)] * angle + d[(0, 1)] * rate;
        self.next.gemv(1.0, a, &self.x, 0.0);
        self.next.axpy(angle, &b.column(0), 1.0);
        self.next.axpy(rate, &b.column(1), 1.0);
        std::mem::swap(&mut self.x, &mut self.next);
        output
    }
}

impl AttitudeLaw for DoubleLoopLaw {
    fn torque(&mut self, deviation: &AttitudeDeviation) -> Vector3<f64> {
        let mut torque = Vector3::zeros();
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let (angle, rate) = (deviation.angle[i], deviation.rate[i]);
            torque[i] = -(axis.step(angle, rate) + self.rate_gain * rate);
        }
        torque
    }

    fn reset(&mut self) {
        for axis in &mut self.axes {
            axis.x.fill(0.0);
        }
    }

    fn linear(&self) -> Result<StateSpace, LtiError> {
        let [x, y, z] = &self.axes;
        let all = x
            .design
            .controller
            .append(&y.design.controller)?
            .append(&z.design.controller)?;
        // Its inputs are angle and rate of x, of y, of z.
        all.select(&[0, 1, 2], &[0, 2, 4, 1, 3, 5])
    }
}
