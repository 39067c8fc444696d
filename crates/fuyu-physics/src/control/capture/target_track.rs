//! Motion of the grasp frame: measured poses, and the forecast of its rotation.
//!
//! In I (see [`OwnMotion`](super::OwnMotion)) the centre of mass of a free target moves uniformly, so its grasp frame
//! G is at
//!
//! ```text
//! p(t) = c + v (t - t₀) + R_IG(t) r
//! ```
//!
//! `c`, `v` and `r` follow from measured poses by least squares; the estimator's images do not determine them. `R_IG`
//! follows from the estimator's [`RotationForecast`] of axes F, which are fixed to the target, and from the constant
//! rotation from F to G, averaged over the measured attitudes. Where the motion does not separate `c` and `r` (along
//! the axis of a simple spin), only their sum is known, and a weak prior divides it.

use std::collections::VecDeque;

use nalgebra::{
    Matrix3, Matrix3x6, Quaternion, SMatrix, SVector, Translation3, UnitQuaternion, Vector3,
    Vector4,
};

use super::frame_motion::FrameMotion;
use super::rotation_forecast::RotationForecast;
use crate::spatial::{Pose, Twist};

/// Prior standard deviations of centre of mass \[m\], its velocity \[m/s\] and the grasp frame's offset \[m\].
const PRIOR: [f64; 3] = [20.0, 0.5, 3.0];
/// Time over which the rotation from F to G is averaged \[s\].
const OFFSET_WINDOW: f64 = 10.0;
/// A jump of the forecast's axes larger than any error of the forecast \[rad\].
const NEW_AXES: f64 = 0.5;
/// Shortest and longest time over which forecasts are compared with later ones \[s\].
const JUDGED: (f64, f64) = (2.0, 12.0);
/// Least number of measured poses for a fit.
const LEAST_SAMPLES: usize = 20;

/// Noise of the measured poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackConfig {
    /// Standard deviation of each coordinate of a position \[m\].
    pub position_noise: f64,
    /// Standard deviation of each component of an attitude \[rad\].
    pub attitude_noise: f64,
    /// Longest time over which poses are used \[s\].
    pub window: f64,
}

impl Default for TrackConfig {
    fn default() -> Self {
        Self {
            position_noise: 7e-3,
            attitude_noise: 2e-3,
            window: 60.0,
        }
    }
}

/// Uncertainty of a prediction: standard deviations in the worst direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertainty {
    /// Standard deviation of the position \[m\].
    pub position: f64,
    /// Standard deviation of the attitude \[rad\].
    pub attitude: f64,
}

/// A measured pose of the grasp frame in I.
#[derive(Debug, Clone, Copy)]
struct Sample {
    time: f64,
    p: Vector3<f64>,
    R: UnitQuaternion<f64>,
}

/// `c`, `v` and `r` at the time of the newest sample, and their covariance.
#[derive(Debug, Clone)]
struct Fit {
    time: f64,
    x: SVector<f64, 9>,
    covariance: SMatrix<f64, 9, 9>,
}

impl Fit {
    fn part(&self, k: usize) -> Vector3<f64> {
        self.x.fixed_rows::<3>(3 * k).into()
    }
}

/// Motion of the grasp frame of a free target.
#[derive(Debug, Clone)]
pub struct TargetTrack {
    config: TrackConfig,
    samples: VecDeque<Sample>,
    /// Forecasts, newest last.
    forecasts: VecDeque<RotationForecast>,
    /// Rotations from F to G, one for each measurement.
    offsets: VecDeque<(f64, UnitQuaternion<f64>)>,
    /// Observed drift rates of forecasts \[rad/s\], each with its time.
    drifts: VecDeque<(f64, f64)>,
    fit: Option<Fit>,
}

impl TargetTrack {
    /// A track without measurements.
    pub fn new(config: TrackConfig) -> Self {
        Self {
            config,
            samples: VecDeque::new(),
            forecasts: VecDeque::new(),
            offsets: VecDeque::new(),
            drifts: VecDeque::new(),
            fit: None,
        }
    }

    /// Discards all measurements: I was redefined, or the target is no longer free.
    pub fn clear(&mut self) {
        *self = Self::new(self.config);
    }

    /// Time of the newest measured pose \[s\].
    pub fn newest(&self) -> Option<f64> {
        self.samples.back().map(|s| s.time)
    }

    /// Number of measured poses in use.
    pub fn samples(&self) -> usize {
        self.samples.len()
    }

    /// Time span of these poses \[s\].
    pub fn span(&self) -> f64 {
        let (first, last) = (self.samples.front(), self.samples.back());
        first.zip(last).map_or(0.0, |(a, b)| b.time - a.time)
    }

    /// Adds the pose of the grasp frame in I that was measured at `time` \[s\]. Poses before the newest one are ignored.
    pub fn add_pose(&mut self, time: f64, X_IG: &Pose) {
        if self.newest().is_some_and(|newest| time <= newest) {
            return;
        }
        let sample = Sample {
            time,
            p: X_IG.translation.vector,
            R: UnitQuaternion::from_rotation_matrix(&X_IG.rotation),
        };
        self.samples.push_back(sample);
        while (self.samples.front()).is_some_and(|s| s.time < time - self.config.window) {
            self.samples.pop_front();
        }
        let covering = (self.forecasts.iter().rev()).find(|f| f.covers(time));
        if let Some(forecast) = covering {
            let (R_IF, ..) = forecast.at(time);
            self.offsets.push_back((time, R_IF.inverse() * sample.R));
        }
        while (self.offsets.front()).is_some_and(|(t, _)| *t < time - OFFSET_WINDOW) {
            self.offsets.pop_front();
        }
        self.fit = self.fitted();
    }

    /// Adds a forecast of the rotation. One that is shorter than three attitudes is ignored.
    pub fn add_forecast(&mut self, forecast: RotationForecast) {
        if forecast.attitudes.len() < 3 {
            return;
        }
        let start = forecast.start;
        let (R_IF, ..) = forecast.at(start);
        if let Some(last) = self.forecasts.back() {
            let jump = last.at(start).0.angle_to(&R_IF);
            if !last.covers(start) || jump > NEW_AXES {
                self.forecasts.clear();
                self.offsets.clear();
                self.drifts.clear();
            }
        }
        for earlier in &self.forecasts {
            let after = start - earlier.start;
            if (JUDGED.0..=JUDGED.1).contains(&after) && earlier.covers(start) {
                let error = earlier.at(start).0.angle_to(&R_IF);
                self.drifts.push_back((start, error / after));
            }
        }
        while (self.drifts.front()).is_some_and(|(t, _)| *t < start - JUDGED.1) {
            self.drifts.pop_front();
        }
        // A forecast that does not start later than earlier ones replaces them.
        while (self.forecasts.back()).is_some_and(|f| f.start >= start) {
            self.forecasts.pop_back();
        }
        self.forecasts.push_back(forecast);
        while (self.forecasts.front()).is_some_and(|f| f.start < start - JUDGED.1) {
            self.forecasts.pop_front();
        }
    }

    /// The least-squares fit of the samples.
    fn fitted(&self) -> Option<Fit> {
        if self.samples.len() < LEAST_SAMPLES {
            return None;
        }
        let time = self.samples.back()?.time;
        let mean = self.samples.iter().map(|s| s.p).sum::<Vector3<f64>>();
        let mean = mean / self.samples.len() as f64;
        let mut normal = SMatrix::<f64, 9, 9>::zeros();
        let mut rhs = SVector::<f64, 9>::zeros();
        let mut squares = 0.0;
        for s in &self.samples {
            let A = rows(s.time - time, &s.R);
            let p = s.p - mean;
            normal += A.tr_mul(&A);
            rhs += A.tr_mul(&p);
            squares += p.norm_squared();
        }
        let noise = self.config.position_noise;
        let solve = |sigma: f64| {
            let mut information = normal / (sigma * sigma);
            for (k, prior) in PRIOR.iter().enumerate() {
                for i in 0..3 {
                    information[(3 * k + i, 3 * k + i)] += 1.0 / (prior * prior);
                }
            }
            let covariance = information.cholesky()?.inverse();
            Some((covariance * rhs / (sigma * sigma), covariance))
        };
        let (x, _) = solve(noise)?;
        // The residuals show noise that the settings do not contain, including that of the attitudes times r.
        let left = squares - 2.0 * x.dot(&rhs) + x.dot(&(normal * x));
        let count = 3.0 * self.samples.len() as f64 - 9.0;
        let sigma = (left.max(0.0) / count).sqrt().max(noise);
        let (mut x, covariance) = solve(sigma)?;
        let mut c = x.fixed_rows_mut::<3>(0);
        c += mean;
        x.iter().all(|x| x.is_finite()).then_some(Fit {
            time,
            x,
            covariance,
        })
    }

    /// Rotation from F to G: the mean of quaternions (F. L. Markley, Y. Cheng, J. Crassidis and Y. Oshman, Averaging
    /// quaternions, J. Guidance, Control, and Dynamics 30, 2007).
    fn R_FG(&self) -> Option<UnitQuaternion<f64>> {
        let (_, first) = self.offsets.front()?;
        // The quaternions are close to each other, so their sum with equal signs is the mean to second order.
        let sum: Vector4<f64> = (self.offsets.iter())
            .map(|(_, q)| q.coords * q.coords.dot(&first.coords).signum())
            .sum();
        Some(UnitQuaternion::new_normalize(Quaternion::from(sum)))
    }

    /// Predicted motion of the grasp frame in I at `time` \[s\]; `None` until poses and forecasts suffice, and beyond
    /// the end of the forecast.
    pub fn at(&self, time: f64) -> Option<FrameMotion> {
        let (fit, R_FG) = (self.fit.as_ref()?, self.R_FG()?);
        let forecast = self.forecasts.iter().rev().find(|f| f.covers(time))?;
        let (R_IF, w, alpha) = forecast.at(time);
        let R_IG = R_IF * R_FG;
        let [c, v, r] = [fit.part(0), fit.part(1), fit.part(2)];
        let arm = R_IG * r;
        let p = c + v * (time - fit.time) + arm;
        Some(FrameMotion {
            X: Pose::from_parts(Translation3::from(p), R_IG.to_rotation_matrix()),
            V: Twist::new(w, v + w.cross(&arm)),
            A: Twist::new(alpha, alpha.cross(&arm) + w.cross(&w.cross(&arm))),
        })
    }

    /// Predicted position of the target's centre of mass in I at `time` \[s\].
    pub fn center(&self, time: f64) -> Option<Vector3<f64>> {
        let fit = self.fit.as_ref()?;
        Some(fit.part(0) + fit.part(1) * (time - fit.time))
    }

    /// The centre of mass in the grasp frame \[m\].
    pub fn center_in_grasp_frame(&self) -> Option<Vector3<f64>> {
        self.fit.as_ref().map(|fit| -fit.part(2))
    }

    /// Uncertainty of the prediction for `time` \[s\] of a point at `p_GK` in the grasp frame \[m\]; `None` while it is
    /// unknown. The attitude's part is the largest drift rate of the last forecasts times the prediction time, with the
    /// error of the averaged rotation from F to G; the position's part is the covariance of the fit, with the effect of
    /// the attitude.
    pub fn uncertainty(&self, time: f64, p_GK: &Vector3<f64>) -> Option<Uncertainty> {
        let fit = self.fit.as_ref()?;
        let forecast = self.forecasts.back()?;
        if !forecast.covers(time) || self.drifts.len() < 3 || self.offsets.len() < 5 {
            return None;
        }
        let drift = self.drifts.iter().map(|(_, d)| *d).fold(0.0, f64::max);
        let offset = self.config.attitude_noise / (self.offsets.len() as f64).sqrt();
        let attitude = (drift * (time - forecast.start).max(0.0)).hypot(offset);
        let R_IG = forecast.at(time).0 * self.R_FG()?;
        let A = rows(time - fit.time, &R_IG);
        let P: Matrix3<f64> = A * fit.covariance * A.transpose();
        let largest = P.symmetric_eigenvalues().max().max(0.0).sqrt();
        let by_turning = attitude * (fit.part(2) + p_GK).norm();
        Some(Uncertainty {
            position: largest.hypot(by_turning),
            attitude,
        })
    }
}

/// Derivatives of the grasp frame's position with respect to `c`, `v` and `r`.
fn rows(after: f64, R: &UnitQuaternion<f64>) -> SMatrix<f64, 3, 9> {
    let mut A = SMatrix::<f64, 3, 9>::zeros();
    let mut of_center = Matrix3x6::zeros();
    of_center.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
    (of_center.fixed_view_mut::<3, 3>(0, 3)).copy_from(&(Matrix3::identity() * after));
    A.fixed_view_mut::<3, 6>(0, 0).copy_from(&of_center);
    (A.fixed_view_mut::<3, 3>(0, 6)).copy_from(R.to_rotation_matrix().matrix());
    A
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::capture::fixtures::{tumbling, within};
    use crate::spatial::exp_so3;

    // Poses of a point of a free body, with noise: the prediction 15 s ahead agrees with the truth within three of the
    // track's standard deviations, which are not much too large.
    #[test]
    fn a_point_of_a_free_body_is_predicted_with_its_uncertainty() {
        use rand::{SeedableRng, rngs::StdRng};
        use rand_distr::{Distribution, StandardNormal};
        let body = tumbling();
        let config = TrackConfig::default();
        let mut random = StdRng::seed_from_u64(3);
        let mut noise = |sd: f64| {
            let v: [f64; 3] = std::array::from_fn(|_| StandardNormal.sample(&mut random));
            Vector3::from(v) * sd
        };
        let (c, v, r) = (
            Vector3::new(1.0, 5.0, 0.3),
            Vector3::new(0.01, -0.02, 0.004),
            Vector3::new(0.2, -0.9, 0.1),
        );
        let R_FG = UnitQuaternion::from_euler_angles(0.4, -0.3, 1.0);
        let truth = |t: f64| {
            let R = body.attitude(t) * R_FG;
            (c + v * t + R * r, R)
        };
        let mut z = 0.0_f64;
        for _ in 0..20 {
            let mut track = TargetTrack::new(config);
            for k in 0..=250 {
                let t = 0.1 * f64::from(k);
                if k % 10 == 0 {
                    let attitudes = (0..150).map(|i| body.attitude(t + 0.2 * f64::from(i)));
                    track.add_forecast(RotationForecast {
                        start: t,
                        period: 0.2,
                        attitudes: attitudes.collect(),
                    });
                }
                let (p, R) = truth(t);
                let R = exp_so3(&noise(config.attitude_noise)) * R;
                let p = p + noise(config.position_noise);
                let X = Pose::from_parts(Translation3::from(p), R.to_rotation_matrix());
                track.add_pose(t, &X);
            }
            let at = 40.0;
            let found = track.at(at).unwrap();
            let sd = track.uncertainty(at, &Vector3::zeros()).unwrap();
            let (p, R) = truth(at);
            let off = (found.X.translation.vector - p).norm();
            assert!(off < 3.5 * sd.position, "{off} {sd:?}");
            assert!(UnitQuaternion::from(found.X.rotation).angle_to(&R) < 2e-3);
            assert!((track.center_in_grasp_frame().unwrap() + r).norm() < 0.15);
            z += (off / sd.position).powi(2) / 20.0;
            // The twist is the derivative of the pose.
            let (before, after) = (track.at(at - 0.01).unwrap(), track.at(at + 0.01).unwrap());
            let slope = (after.X.translation.vector - before.X.translation.vector) / 0.02;
            within(&found.V.linear, &slope, 1e-4);
        }
        assert!((0.2..3.0).contains(&z), "{z}");
    }
}
