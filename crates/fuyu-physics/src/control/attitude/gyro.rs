//! Errors of a rate gyro: white noise on the rate, and a bias that wanders.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::AttitudeConfigError;
use super::error::require_not_negative;

/// Error model of a rate gyro (R. L. Farrenkopf, "Analytic steady-state accuracy solutions for two common spacecraft
/// attitude estimators", J. Guidance and Control 1, 1978): `w_measured = w + b + n_v`, `b' = n_u`, with white noises
/// `n_v` and `n_u`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GyroErrors {
    /// Angle random walk: square root of the spectral density of `n_v` \[rad/s^½\]. A standard deviation σ of samples
    /// every T seconds is `σ √T`.
    pub angle_random_walk: f64,
    /// Rate random walk: square root of the spectral density of `n_u` \[rad/s^³⁄²\]. It represents the bias instability
    /// of data sheets.
    pub rate_random_walk: f64,
    /// Standard deviation of each component of the bias at the start \[rad/s\].
    pub initial_bias: f64,
}

impl GyroErrors {
    /// Refuses values that are negative or not finite.
    ///
    /// # Errors
    /// [`AttitudeConfigError::Value`] names the value.
    pub fn check(&self) -> Result<(), AttitudeConfigError> {
        require_not_negative("angle_random_walk [rad/s^(1/2)]", self.angle_random_walk)?;
        require_not_negative("rate_random_walk [rad/s^(3/2)]", self.rate_random_walk)?;
        require_not_negative("initial_bias [rad/s]", self.initial_bias)
    }
}

/// A gyro with these errors.
#[derive(Debug)]
pub struct SimulatedGyro {
    errors: GyroErrors,
    bias: Vector3<f64>,
    random: StdRng,
}

impl SimulatedGyro {
    /// A gyro whose errors depend on `seed` and on the samples taken.
    pub fn new(errors: GyroErrors, seed: u64) -> Self {
        let mut random = StdRng::seed_from_u64(seed);
        Self {
            bias: normal(&mut random) * errors.initial_bias,
            errors,
            random,
        }
    }

    /// The true bias \[rad/s\].
    pub fn bias(&self) -> &Vector3<f64> {
        &self.bias
    }

    /// Sets the true bias \[rad/s\].
    pub fn set_bias(&mut self, bias: Vector3<f64>) {
        self.bias = bias;
    }

    /// The measured rate for a base that turns with `w_WB_B` \[rad/s\], `interval` \[s\] after the previous sample.
    ///
    /// # Panics
    /// If `interval` is not positive.
    pub fn sample(&mut self, w_WB_B: &Vector3<f64>, interval: f64) -> Vector3<f64> {
        assert!(interval > 0.0, "interval must be positive, not {interval}");
        let wander = normal(&mut self.random) * (self.errors.rate_random_walk * interval.sqrt());
        let noise = normal(&mut self.random) * (self.errors.angle_random_walk / interval.sqrt());
        self.bias += wander;
        w_WB_B + self.bias + noise
    }
}

fn normal(random: &mut StdRng) -> Vector3<f64> {
    let mut one = || random.sample::<f64, _>(StandardNormal);
    Vector3::new(one(), one(), one())
}

#[cfg(test)]
mod tests {
    use super::*;

    // The integrated noise grows with the square root of time, for any sampling interval; so does the bias.
    #[test]
    fn noise_integrates_to_the_random_walks() {
        let errors = GyroErrors {
            angle_random_walk: 2e-4,
            rate_random_walk: 3e-5,
            initial_bias: 0.0,
        };
        for interval in [0.01, 0.1] {
            let (mut angle, mut bias) = (0.0, 0.0);
            let runs = 400;
            for seed in 0..runs {
                let noise = GyroErrors {
                    rate_random_walk: 0.0,
                    ..errors
                };
                let (mut gyro, mut wander) = (
                    SimulatedGyro::new(noise, seed),
                    SimulatedGyro::new(errors, seed),
                );
                let mut sum = Vector3::zeros();
                for _ in 0..(4.0 / interval) as usize {
                    sum += gyro.sample(&Vector3::zeros(), interval) * interval;
                    wander.sample(&Vector3::zeros(), interval);
                }
                angle += sum.norm_squared();
                bias += wander.bias().norm_squared();
            }
            let rms = |sum: f64| (sum / (3.0 * runs as f64)).sqrt();
            // 4 s; the standard deviation of these estimates is 2 %.
            assert!((rms(angle) / (2e-4 * 2.0) - 1.0).abs() < 0.08);
            assert!((rms(bias) / (3e-5 * 2.0) - 1.0).abs() < 0.08);
        }
    }

    #[test]
    fn negative_errors_are_refused_by_name() {
        let errors = GyroErrors {
            rate_random_walk: -1.0,
            ..GyroErrors::default()
        };
        let text = errors.check().unwrap_err().to_string();
        assert_eq!(
            text,
            "rate_random_walk [rad/s^(3/2)] is -1; it must be zero or positive, and finite"
        );
    }
}
