//! The invariable plane, in which the angular velocity vectors end, and the angle about its normal.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, UnitVector3, Vector3};
use rustfft::num_complex::Complex;

use super::{MasutaniError, Rate};
use crate::estimation::free_body::frame;

/// Largest number of rounds of unwrapping to a line; it converges in two or three.
const ROUNDS: usize = 10;

/// The plane `n · w = 1/√alpha`: Masutani 1995 eqs. (2.26), (2.27).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InvariablePlane {
    /// Its normal, the direction of the angular momentum in camera axes.
    pub normal: UnitVector3<f64>,
    /// `alpha = L² / 4E²` \[s²\].
    pub alpha: f64,
    /// Scatter of the angular velocities across the plane, `sigma_n` \[rad/s\], (2.63). The print omits that
    /// its normal has unit length: the distance is `n · w - 1/√alpha`.
    pub scatter: f64,
}

impl InvariablePlane {
    /// The plane that fits best, by linear least squares.
    ///
    /// # Errors
    /// [`MasutaniError::NoPlane`] if the angular velocities span at most a plane through zero.
    pub fn fit(rates: &[Rate]) -> Result<Self, MasutaniError> {
        let mut normal = Matrix3::zeros();
        let mut sum = Vector3::zeros();
        for (_, w) in rates {
            normal += w * w.transpose();
            sum += w;
        }
        // A constant angular velocity makes the system singular; the pseudo-inverse gives the plane perpendicular to
        // it.
        let size = normal.trace();
        let inverse = normal
            .pseudo_inverse(1e-14 * size)
            .map_err(|_| MasutaniError::NoPlane)?;
        let n = inverse * sum;
        let alpha = n.norm_squared();
        if !(alpha.is_finite() && alpha > 0.0) {
            return Err(MasutaniError::NoPlane);
        }
        let normal = UnitVector3::new_normalize(n);
        let distance = alpha.sqrt().recip();
        let squares: f64 = rates
            .iter()
            .map(|(_, w)| (normal.dot(w) - distance).powi(2))
            .sum();
        Ok(Self {
            normal,
            alpha,
            scatter: (squares / (rates.len() as f64 - 3.0)).sqrt(),
        })
    }
}

/// Regression line of the angle about the plane's normal: `chi = rate · t + phase`, eq. (2.40).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanPrecession {
    /// `A` of (2.40) \[rad/s\].
    pub rate: f64,
    /// `B`: the angle at the first sample's time \[rad\].
    pub phase: f64,
    /// Axes x (where the angle is zero), y, z = normal, as columns.
    axes: Matrix3<f64>,
}

impl MeanPrecession {
    /// Fits the angle of the herpolhode by linear least squares. Each angle is unwrapped to the one nearest to the sample
    /// before.
    pub fn fit(rates: &[Rate], plane: &InvariablePlane) -> Self {
        let mut last = None;
        Self::through(rates, plane, |_, angle| {
            let angle = last.map_or(angle, |before| nearest(angle, before));
            last = Some(angle);
            angle
        })
    }

    /// [`MeanPrecession::fit`] for a circular herpolhode, as in the axisymmetric model. If its radius is not larger
    /// than the noise, unwrapping to the previous sample slips by whole revolutions and changes the mean rate. So each
    /// angle is unwrapped to a line: initially the line of the rate with the strongest correlation.
    pub fn unwrapped_to_line(rates: &[Rate], plane: &InvariablePlane) -> Self {
        let mut line = Self::rough(rates, plane);
        for _ in 0..ROUNDS {
            let Self { rate, phase, .. } = line;
            let next = Self::through(rates, plane, |t, angle| nearest(angle, rate * t + phase));
            if next == line {
                break;
            }
            line = next;
        }
        line
    }

    /// Regression line of the angles, each unwrapped by `unwrap` (time since the start \[s\], angle \[rad\]).
    fn through(
        rates: &[Rate],
        plane: &InvariablePlane,
        mut unwrap: impl FnMut(f64, f64) -> f64,
    ) -> Self {
        let axes = axes(plane);
        let start = rates[0].0;
        let (mut n, mut st, mut sc, mut stt, mut stc) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (t, w) in rates {
            let (x, y) = (axes.column(0).dot(w), axes.column(1).dot(w));
            let t = t - start;
            let angle = unwrap(t, y.atan2(x));
            n += 1.0;
            st += t;
            sc += angle;
            stt += t * t;
            stc += t * angle;
        }
        let rate = (n * stc - st * sc) / (n * stt - st * st);
        Self {
            rate,
            phase: (sc - rate * st) / n,
            axes,
        }
    }

    /// Initial line by correlation: of the rates between 0 and 2/√alpha, which contain those of all axisymmetric bodies,
    /// the one that agrees best with all samples, to a quarter revolution over the whole time.
    fn rough(rates: &[Rate], plane: &InvariablePlane) -> Self {
        let axes = axes(plane);
        let (start, end) = (rates[0].0, rates[rates.len() - 1].0);
        let step = 0.25 * TAU / (end - start);
        let count = (2.0 / (plane.alpha.sqrt() * step)) as usize;
        let end_of = |w: &Vector3<f64>| Complex::new(axes.column(0).dot(w), axes.column(1).dot(w));
        // Each sample in the plane, rotated back by the current rate, and its rotation from one rate to the next.
        let back = |t: f64| Complex::from_polar(1.0, -step * (t - start));
        let mut ends: Vec<_> = rates.iter().map(|(t, w)| (end_of(w), back(*t))).collect();
        let mut best = (0.0, 0.0, 0.0);
        for k in 0..=count {
            let sum: Complex<f64> = ends.iter().map(|(end, _)| end).sum();
            if sum.norm_sqr() > best.0 {
                best = (sum.norm_sqr(), step * k as f64, sum.arg());
            }
            for (end, back) in &mut ends {
                *end *= *back;
            }
        }
        Self {
            rate: best.1,
            phase: best.2,
            axes,
        }
    }

    /// The direction in the plane at `angle` \[rad\].
    pub fn direction(&self, angle: f64) -> Vector3<f64> {
        self.axes.column(0) * angle.cos() + self.axes.column(1) * angle.sin()
    }
}

/// Axes x, y, z = normal, as columns.
fn axes(plane: &InvariablePlane) -> Matrix3<f64> {
    frame(&plane.normal, None).to_rotation_matrix().into_inner()
}

/// The angle plus the number of whole revolutions that brings it nearest to `goal`.
fn nearest(angle: f64, goal: f64) -> f64 {
    angle + TAU * ((goal - angle) / TAU).round()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    /// Angular velocities on a circle about z with this radius \[rad/s\], with noise.
    fn circling(radius: f64, noise: f64) -> Vec<Rate> {
        let mut rng = StdRng::seed_from_u64(3);
        let mut gauss = || (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>() * noise;
        let rate = |i: u32| {
            let t = 0.6 * f64::from(i);
            let (sin, cos) = (RATE * t + PHASE).sin_cos();
            let noise = Vector3::new(gauss(), gauss(), 0.0);
            (t, Vector3::new(radius * cos, radius * sin, 0.9) + noise)
        };
        (0..600).map(rate).collect()
    }

    const RATE: f64 = 0.83;
    const PHASE: f64 = 0.4;

    #[test]
    fn a_small_circle_in_noise_keeps_its_rate() {
        let plane = InvariablePlane {
            normal: Vector3::z_axis(),
            alpha: 1.0 / 0.81,
            scatter: 0.0,
        };
        let start = Vector3::new(PHASE.cos(), PHASE.sin(), 0.0);
        let clean = circling(0.02, 0.0);
        for found in [
            MeanPrecession::fit(&clean, &plane),
            MeanPrecession::unwrapped_to_line(&clean, &plane),
        ] {
            assert!((found.rate - RATE).abs() < 1e-12, "{found:?}");
            assert!(
                found.direction(found.phase).angle(&start) < 1e-9,
                "{found:?}"
            );
        }
        let noisy = circling(0.02, 0.015);
        // An angle slips: the rate is wrong by at least a revolution in 360 s.
        let slipped = MeanPrecession::fit(&noisy, &plane).rate - RATE;
        assert!(slipped.abs() > TAU / 360.0, "{slipped}");
        let kept = MeanPrecession::unwrapped_to_line(&noisy, &plane);
        assert!((kept.rate - RATE).abs() < 2e-3, "{kept:?}");
        assert!(kept.direction(kept.phase).angle(&start) < 0.4, "{kept:?}");
    }
}
