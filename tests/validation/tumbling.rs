//! A tumbling body before a camera, as chapter 3 of Masutani 1995 simulates it, and what spoils its tracks. It shares no
//! code with the estimator: Euler's equations are integrated by Runge-Kutta in small steps.

use fuyu::estimation::{Feature, FeatureFrame, Tracks};
use fuyu::vision::Pinhole;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// A free rotation: principal moments over twice the energy, rates and attitude at time zero.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// `J` \[s²\].
    pub J: Vector3<f64>,
    /// `alpha` \[s²\].
    pub alpha: f64,
    /// Body rates at the start \[rad/s\].
    pub w_B: Vector3<f64>,
    /// Attitude at the start.
    pub R_WB: UnitQuaternion<f64>,
}

impl Motion {
    /// Isotropy `e`, symmetry `s` and relative momentum `s_alpha` of (3.2), (3.3), (3.9), with largest `|w|²`
    /// `beta`; momentum along `direction`, starting where `|w|²` is least.
    pub fn new(e: f64, s: f64, s_alpha: f64, beta: f64, direction: Vector3<f64>) -> Self {
        // (3.10)-(3.14) with I_x = 1.
        let (high, low) = (1.0, e);
        let middle = 0.5 * (1.0 + e + s * (1.0 - e));
        let twice_energy = beta * 2.0 * e / (1.0 + e - s_alpha * (1.0 - e));
        let alpha = (1.0 + e + s_alpha * (1.0 - e)) / 2.0 / twice_energy;
        let (high, middle, low) = (
            high / twice_energy,
            middle / twice_energy,
            low / twice_energy,
        );
        // z is the axis that the rate circles.
        let J = if alpha < middle {
            Vector3::new(high, middle, low)
        } else {
            Vector3::new(low, middle, high)
        };
        // w_x = 0; (2.7) and (2.8) for the other two.
        let gap = J.y - J.z;
        let y = if gap.abs() < 1e-12 {
            0.0
        } else {
            (alpha - J.z) / (J.y * gap)
        };
        let y = y.max(0.0);
        let z = ((1.0 - J.y * y) / J.z).max(0.0);
        let w_B = Vector3::new(0.0, y.sqrt(), z.sqrt());
        let L_B = J.component_mul(&w_B);
        let R_WB = UnitQuaternion::rotation_between(&L_B, &direction).unwrap_or_else(|| {
            UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI)
        });
        Self {
            J,
            alpha,
            w_B,
            R_WB,
        }
    }

    /// Attitudes at ascending times from 0 on.
    pub fn attitudes(&self, times: &[f64]) -> Vec<UnitQuaternion<f64>> {
        let (mut t, mut w, mut q) = (0.0, self.w_B, *self.R_WB.quaternion());
        let J = self.J;
        let rate = |w: &Vector3<f64>, q: &Quaternion<f64>| {
            let dw = J.component_mul(w).cross(w).component_div(&J);
            (dw, q * Quaternion::from_imag(*w) * 0.5)
        };
        let mut out = Vec::with_capacity(times.len());
        for &to in times {
            let steps = ((to - t) / 0.01).ceil().max(1.0);
            let h = (to - t) / steps;
            for _ in 0..steps as usize {
                let (a, qa) = rate(&w, &q);
                let (b, qb) = rate(&(w + a * (h / 2.0)), &(q + qa * (h / 2.0)));
                let (c, qc) = rate(&(w + b * (h / 2.0)), &(q + qb * (h / 2.0)));
                let (d, qd) = rate(&(w + c * h), &(q + qc * h));
                w += (a + b * 2.0 + c * 2.0 + d) * (h / 6.0);
                q += (qa + qb * 2.0 + qc * 2.0 + qd) * (h / 6.0);
                q /= q.norm();
            }
            t = to;
            out.push(UnitQuaternion::from_quaternion(q));
        }
        out
    }
}

/// What the camera sees.
#[derive(Debug, Clone)]
pub struct View {
    pub camera: Pinhole,
    pub points: usize,
    pub interval: f64,
    pub duration: f64,
    /// Distance of the body's centre over its radius.
    pub distance: f64,
    /// Share of image points that are anywhere.
    pub outliers: f64,
    /// Share of frames that are lost.
    pub dropped: f64,
    /// Frames from the first to the second time are lost \[s\].
    pub gap: Option<(f64, f64)>,
    /// Mean number of frames that a track lasts; then the point comes back under a new id.
    pub lifetime: Option<f64>,
    /// The far side is hidden.
    pub occlusion: bool,
    /// The centre's drift, in radii a second.
    pub drift: Vector3<f64>,
    /// The camera's angular velocity in its own axes \[rad/s\].
    pub camera_rate: Vector3<f64>,
    /// Gaussian noise before rounding \[px\].
    pub noise: f64,
    pub seed: u64,
}

impl View {
    /// Chapter 3: 8 mm lens, 10 mm image, a sphere of 900 mm diameter 900 mm away, 360 s at 0.6 s.
    pub fn chapter_3(resolution: u32) -> Self {
        Self {
            camera: Pinhole::square(resolution, 1.25),
            points: 20,
            interval: 0.6,
            duration: 360.0,
            distance: 2.0,
            outliers: 0.0,
            dropped: 0.0,
            gap: None,
            lifetime: None,
            occlusion: false,
            drift: Vector3::zeros(),
            camera_rate: Vector3::zeros(),
            noise: 0.0,
            seed: 1,
        }
    }

    /// Points on the unit sphere.
    pub fn sphere(&self) -> Vec<Vector3<f64>> {
        let mut rng = StdRng::seed_from_u64(self.seed);
        let mut points = Vec::new();
        while points.len() < self.points {
            let p = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
            if p.norm() < 1.0 && p.norm() > 1e-3 {
                points.push(p.normalize());
            }
        }
        points
    }

    /// The tracks of a body with `points` that moves by `motion`.
    pub fn tracks(&self, motion: &Motion, points: &[Vector3<f64>]) -> Tracks {
        let mut rng = StdRng::seed_from_u64(self.seed.wrapping_mul(77) + 5);
        let count = (self.duration / self.interval).round() as usize;
        let times: Vec<f64> = (0..=count).map(|i| self.interval * i as f64).collect();
        let attitudes = motion.attitudes(&times);
        let mut ids: Vec<u64> = (0..points.len() as u64).collect();
        let mut next = points.len() as u64;
        let mut sightings = Vec::new();
        for (&time, R_WB) in times.iter().zip(&attitudes) {
            let mut features = Vec::new();
            let R_WC = UnitQuaternion::from_scaled_axis(self.camera_rate * time);
            // The camera turns about the body, so that it stays in view.
            let c_C = Vector3::new(0.0, 0.0, self.distance) + self.drift * time;
            for (k, p) in points.iter().enumerate() {
                let direction = R_WC.inverse() * (R_WB * p);
                let x = direction + c_C;
                if self.occlusion && direction.dot(&x) > 0.0 {
                    continue;
                }
                if let Some(lifetime) = self.lifetime
                    && rng.random_range(0.0..1.0) < 1.0 / lifetime
                {
                    ids[k] = next;
                    next += 1;
                }
                let Some([u, v]) = self.camera.project(&x) else {
                    continue;
                };
                let mut gauss = || {
                    let sum: f64 = (0..12).map(|_| rng.random_range(-0.5..0.5)).sum();
                    sum * self.noise
                };
                let (mut u, mut v) = ((u + gauss()).round(), (v + gauss()).round());
                if rng.random_range(0.0..1.0) < self.outliers {
                    u = rng.random_range(0.0..2.0 * self.camera.cx);
                    v = rng.random_range(0.0..2.0 * self.camera.cy);
                }
                features.push(Feature { id: ids[k], u, v });
            }
            let lost = rng.random_range(0.0..1.0) < self.dropped
                || self.gap.is_some_and(|(from, to)| time > from && time < to);
            if !lost {
                sightings.push(FeatureFrame::new(time, features));
            }
        }
        Tracks::new(sightings).unwrap()
    }
}

/// Prediction errors over 30 s from `from` on \[deg\]: Θ (3.23), of the attitude; and Φ (3.25), of the axis of
/// `J_z`.
pub fn prediction_errors(
    motion: &Motion,
    from: f64,
    predicted: impl Fn(f64) -> UnitQuaternion<f64>,
) -> (f64, f64) {
    let times: Vec<f64> = (0..=100).map(|i| from + 0.3 * f64::from(i)).collect();
    let truth = motion.attitudes(&times);
    let start = predicted(from);
    let axis = truth[0] * Vector3::z();
    let (mut theta, mut phi) = (0.0f64, 0.0f64);
    for (t, R) in times.iter().zip(&truth) {
        let turned = R * truth[0].inverse();
        let ours = predicted(*t) * start.inverse();
        theta = theta.max((ours * turned.inverse()).angle());
        phi = phi.max((ours * axis).angle(&(turned * axis)));
    }
    (theta.to_degrees(), phi.to_degrees())
}
