//! Excitation: joint motions for the identification of the held body's inertia.

use std::f64::consts::TAU;

use crate::control::commander::JointPoint;

/// Sines of different frequencies for the joints, which begin and end at rest.
///
/// Joint `j` moves by `A_j sin(2π k_j t / T) w(t)`, with a whole number `k_j` of periods and `w = sin²(π t / T)`, so that
/// position, rate and acceleration are zero at both ends. The frequencies of no two joints are the same, so that the
/// columns of the regressor are not parallel; the last joint has the lowest, since it may move furthest.
#[derive(Debug, Clone, PartialEq)]
pub struct Excitation {
    start: f64,
    duration: f64,
    positions: Vec<f64>,
    amplitudes: Vec<f64>,
}

/// Periods of the slowest joint.
const SLOWEST: usize = 1;

impl Excitation {
    /// Excitation from joint `positions` at `start` \[s\], for `duration` \[s\], with an amplitude for each joint \[rad
    /// or m\]; joints with zero amplitude rest.
    pub fn new(start: f64, duration: f64, positions: &[f64], amplitudes: &[f64]) -> Self {
        Self {
            start,
            duration,
            positions: positions.to_vec(),
            amplitudes: amplitudes.to_vec(),
        }
    }

    /// Start of the excitation \[s\].
    pub fn start(&self) -> f64 {
        self.start
    }

    /// Duration of the excitation \[s\].
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Upper bound of the rate of joint `j`, only slightly above its largest rate \[rad/s or m/s\].
    pub(super) fn largest_rate(&self, j: usize) -> f64 {
        let k = self.periods(j);
        let w = TAU / self.duration;
        self.amplitudes[j].abs() * w * (k + 1.0)
    }

    /// Periods of joint `j`.
    fn periods(&self, j: usize) -> f64 {
        let moving = self.amplitudes[j + 1..].iter();
        (SLOWEST + moving.filter(|a| **a != 0.0).count()) as f64
    }

    /// End of the excitation \[s\].
    pub fn end(&self) -> f64 {
        self.start + self.duration
    }

    /// Motion of joint `j` at `time` \[s\].
    pub fn at(&self, j: usize, time: f64) -> JointPoint {
        let t = (time - self.start).clamp(0.0, self.duration);
        let k = self.periods(j);
        let A = self.amplitudes[j];
        // sin(a) sin²(b) = sin(a)/2 - (sin(a + 2b) + sin(a - 2b)) / 4, and 2b has one period.
        let parts = [(k, 0.5), (k + 1.0, -0.25), (k - 1.0, -0.25)];
        let mut point = JointPoint {
            position: self.positions[j],
            ..JointPoint::default()
        };
        for (periods, share) in parts {
            let w = TAU * periods / self.duration;
            let (sin, cos) = (w * t).sin_cos();
            point.position += A * share * sin;
            point.rate += A * share * w * cos;
            point.acceleration -= A * share * w * w * sin;
        }
        point
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_rest_at_both_ends_and_rates_are_derivatives() {
        let excitation = Excitation::new(3.0, 20.0, &[0.1, 0.2, 0.3], &[0.4, 0.0, 0.5]);
        for j in 0..3 {
            for t in [3.0, 23.0] {
                let end = excitation.at(j, t);
                assert!((end.position - 0.1 * (j + 1) as f64).abs() < 1e-12);
                assert!(end.rate.abs() < 1e-12 && end.acceleration.abs() < 1e-12);
            }
            let (a, h) = (11.3, 1e-5);
            let (before, now, after) = (
                excitation.at(j, a - h),
                excitation.at(j, a),
                excitation.at(j, a + h),
            );
            let rate = (after.position - before.position) / (2.0 * h);
            let acceleration = (after.rate - before.rate) / (2.0 * h);
            assert!((now.rate - rate).abs() < 1e-8);
            assert!((now.acceleration - acceleration).abs() < 1e-8);
        }
        assert_eq!(excitation.at(1, 9.0).position, 0.2);
    }
}
