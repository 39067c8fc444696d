//! Linear-quadratic regulator for the rigid robot.

use fuyu_lti::{LtiError, Matrix, StateSpace};
use nalgebra::{Matrix3, Matrix3x6, Vector3};

use crate::control::attitude::error::require_positive;
use crate::control::attitude::{AttitudeConfigError, AttitudeDeviation, AttitudeLaw};

/// Weights of an [`Lqr`] by Bryson's rule: deviations of this size cost as much as a torque of that size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LqrWeights {
    /// Deviation of each angle \[rad\].
    pub angle: f64,
    /// Deviation of each rate \[rad/s\].
    pub rate: f64,
    /// Torque about each axis \[N m\].
    pub torque: f64,
}

/// Optimal feedback `τ = -K [angle; rate]` for the locked rigid robot, sampled with zero-order hold. The design ignores
/// vibrations; [`AttitudePlant::sampled_radius`](crate::control::attitude::AttitudePlant::sampled_radius) shows whether
/// the law makes them unstable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lqr {
    gain: Matrix3x6<f64>,
}

impl Lqr {
    /// The law for a robot with this inertia (see
    /// [`AttitudePlant::inertia`](crate::control::attitude::AttitudePlant::inertia)) and torques held for `period`
    /// \[s\].
    ///
    /// # Errors
    /// [`AttitudeConfigError`] for weights or a period that are not positive, or a Riccati equation without solution.
    pub fn new(
        inertia: &Matrix3<f64>,
        weights: &LqrWeights,
        period: f64,
    ) -> Result<Self, AttitudeConfigError> {
        for (name, value) in [
            ("lqr.angle [rad]", weights.angle),
            ("lqr.rate [rad/s]", weights.rate),
            ("lqr.torque [N m]", weights.torque),
            ("period [s]", period),
        ] {
            require_positive(name, value)?;
        }
        // Units in which state and torque are near 1: the solver accepts only small relative residuals.
        let unit = inertia.trace() / 3.0;
        let rate_unit = weights.angle / period;
        let torque_unit = unit * weights.angle / (period * period);
        let design = || {
            let scaled = (inertia / unit).try_inverse().ok_or(LtiError::Singular {
                what: "the inertia".into(),
            })?;
            let (mut a, mut b) = (Matrix::zeros(6, 6), Matrix::zeros(6, 3));
            a.view_mut((0, 3), (3, 3))
                .copy_from(&Matrix::identity(3, 3));
            b.view_mut((3, 0), (3, 3)).copy_from(&scaled);
            let c = Matrix::identity(6, 6);
            let plant = StateSpace::new(a, b, c, Matrix::zeros(6, 3))?.zero_order_hold(1.0)?;
            let rate_cost = (rate_unit / weights.rate).powi(2);
            let q = Matrix::from_fn(6, 6, |i, j| match (i == j, i < 3) {
                (false, _) => 0.0,
                (true, true) => 1.0,
                (true, false) => rate_cost,
            });
            let r = Matrix::identity(3, 3) * (torque_unit / weights.torque).powi(2);
            fuyu_lti::lqr(&plant, &q, &r)
        };
        let solution = design().map_err(AttitudeConfigError::design("lqr of the attitude"))?;
        let gain = Matrix3x6::from_fn(|i, j| {
            let unit = if j < 3 { weights.angle } else { rate_unit };
            solution.gain[(i, j)] * torque_unit / unit
        });
        Ok(Self { gain })
    }

    /// K, for angle \[N m/rad\] and rate \[N m s/rad\].
    pub fn gain(&self) -> &Matrix3x6<f64> {
        &self.gain
    }
}

impl AttitudeLaw for Lqr {
    fn torque(&mut self, deviation: &AttitudeDeviation) -> Vector3<f64> {
        -(self.gain.fixed_columns::<3>(0) * deviation.angle
            + self.gain.fixed_columns::<3>(3) * deviation.rate)
    }

    fn linear(&self) -> Result<StateSpace, LtiError> {
        Ok(StateSpace::gain(Matrix::from_fn(3, 6, |i, j| {
            self.gain[(i, j)]
        })))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // In continuous time, which short periods approach: K = [sqrt(q1/r), sqrt(q2/r + 2 J sqrt(q1/r))] for J θ'' = u
    // (minimise q1 θ² + q2 θ'² + r u²; the Riccati equation of the double integrator by hand).
    #[test]
    fn short_periods_give_the_gain_of_the_double_integrator() {
        let inertia = Matrix3::from_diagonal(&Vector3::new(2600.0, 4600.0, 6100.0));
        let weights = LqrWeights {
            angle: 0.01,
            rate: 0.002,
            torque: 2.0,
        };
        let law = Lqr::new(&inertia, &weights, 1e-3).unwrap();
        for i in 0..3 {
            let p = weights.torque / weights.angle;
            let d = ((weights.torque / weights.rate).powi(2) + 2.0 * inertia[(i, i)] * p).sqrt();
            assert!(
                (law.gain()[(i, i)] / p - 1.0).abs() < 1e-3,
                "{}",
                law.gain()
            );
            assert!(
                (law.gain()[(i, 3 + i)] / d - 1.0).abs() < 1e-3,
                "{}",
                law.gain()
            );
        }
        // Uncoupled axes remain uncoupled.
        let mut others = *law.gain();
        for i in 0..3 {
            others[(i, i)] = 0.0;
            others[(i, 3 + i)] = 0.0;
        }
        assert!(others.amax() < 1e-6, "{others}");
    }

    // The sampled cost of the closed loop, summed over samples: no small change of the gain lowers it.
    #[test]
    fn no_other_gain_costs_less() {
        let inertia = Matrix3::new(
            2600.0, 150.0, -40.0, 150.0, 4600.0, 210.0, -40.0, 210.0, 6100.0,
        );
        let weights = LqrWeights {
            angle: 0.01,
            rate: 0.002,
            torque: 2.0,
        };
        let h = 1.0;
        let law = Lqr::new(&inertia, &weights, h).unwrap();
        let inverse = inertia.try_inverse().unwrap();
        let cost = |gain: &Matrix3x6<f64>| {
            let mut law = Lqr { gain: *gain };
            let mut total = 0.0;
            for start in 0..6 {
                let (mut angle, mut rate) = (Vector3::zeros(), Vector3::zeros());
                if start < 3 {
                    angle[start] = 0.01;
                } else {
                    rate[start - 3] = 0.002;
                }
                for _ in 0..400 {
                    let torque = law.torque(&AttitudeDeviation { angle, rate });
                    total += (angle / weights.angle).norm_squared()
                        + (rate / weights.rate).norm_squared()
                        + (torque / weights.torque).norm_squared();
                    let acceleration = inverse * torque;
                    angle += rate * h + acceleration * (0.5 * h * h);
                    rate += acceleration * h;
                }
            }
            total
        };
        let best = cost(law.gain());
        for i in 0..3 {
            for j in 0..6 {
                for change in [0.02, -0.02] {
                    let mut other = *law.gain();
                    other[(i, j)] += change * law.gain().row(i).columns(3 * (j / 3), 3).amax();
                    assert!(cost(&other) > best, "{i} {j} {change}");
                }
            }
        }
    }

    #[test]
    fn wrong_weights_are_refused_by_name() {
        let weights = LqrWeights {
            angle: 0.01,
            rate: 0.0,
            torque: 2.0,
        };
        let text = Lqr::new(&Matrix3::identity(), &weights, 0.1)
            .unwrap_err()
            .to_string();
        assert_eq!(
            text,
            "lqr.rate [rad/s] is 0; it must be positive and finite"
        );
    }
}
