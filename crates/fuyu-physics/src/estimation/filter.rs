//! Recursive filter between batch solutions: an error-state Kalman filter of attitude, momentum and inertia.
//!
//! It starts from a batch [`Solution`] only, because its linearisation is not valid far from the truth. Its state
//! ([`MotionState`]) consists of the constants of torque-free motion (momentum in inertial axes, and inertia ratios),
//! the attitude, and the angular acceleration due to torques. The body's position in a frame is solved from that frame
//! and discarded, as in the batch solution, which also provides the structure.

use std::collections::HashMap;

use nalgebra::{Matrix3, SVector, UnitQuaternion, Vector2, Vector3};

use super::bundle::{Intrinsics, Solution};
use super::motion_state::{Disturbance, MotionState, STATES};
use super::{MotionEstimate, MotionModel};
use crate::vision::{FeatureFrame, Pinhole};

/// Least number of points of a frame that is used: its position adds three unknowns.
const MIN_POINTS: usize = 4;

/// Width of the inlier gate in standard deviations.
const INLIER_GATE: f64 = 5.0;

/// Unknowns of a frame's pose.
const POSE_UNKNOWNS: usize = 6;

/// A frame's residuals exceed the noise if their mean square exceeds its expectation by this many standard deviations.
/// The usual cause is errors of the points' positions, which are the same in the next frames; all such frames together
/// then count about as much as one.
const EXCESS_DEVIATIONS: f64 = 2.0;

/// The filter. Its updates must be in the order of time.
#[derive(Debug, Clone)]
pub struct Filter {
    state: MotionState,
    points: HashMap<u64, Vector3<f64>>,
    camera: Pinhole,
    radial: f64,
    noise: f64,
    disturbance: Disturbance,
    position: Vector3<f64>,
    model: MotionModel,
    rms: f64,
    /// Number of frames with residuals larger than the noise.
    excess_frames: u32,
}

/// Contribution of a frame to the filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Update {
    /// Number of points that were used; zero if too few fit.
    pub used: usize,
    /// Number of points of the structure that did not fit.
    pub rejected: usize,
    /// Number of points that are not in the structure.
    pub unknown: usize,
    /// Root mean square of the residual components after the update \[px\].
    pub rms: f64,
    /// Difference between measured and predicted attitude, normalised to unit covariance, in inertial axes. Zero if no
    /// point was used.
    pub innovation: Vector3<f64>,
}

impl Filter {
    /// A filter at the last frame of a batch solution. `momentum_walk` is the random walk of the momentum
    /// due to torques, relative to the momentum \[1/√s\]; 0 for none. `None` if the solution has no pose.
    pub fn new(solution: &Solution, momentum_walk: f64) -> Option<Self> {
        let last = solution.poses.last()?;
        let mut state = solution.state.clone();
        let noise = solution.motion.rms().max(1e-3);
        // Attitude error of the whole body due to errors of the structure, from the number of observations.
        let pixel = 2.0 / (solution.camera.fx + solution.camera.fy);
        let observations = (solution.poses.len() * solution.points.len()).max(1) as f64;
        let turn = 3.0 * noise * pixel / observations.sqrt();
        let conditional = state.others.as_mut().map(|others| &mut others.conditional);
        for covariance in std::iter::once(&mut state.covariance).chain(conditional) {
            for k in 0..3 {
                covariance[(k, k)] += turn * turn;
            }
        }
        let acceleration_walk = state.acceleration_walk;
        Some(Self {
            state,
            points: solution.points.iter().map(|p| (p.id, p.p_B)).collect(),
            camera: solution.camera,
            radial: solution.radial,
            noise,
            disturbance: Disturbance {
                momentum_walk,
                acceleration_walk,
            },
            position: last.t_C,
            model: solution.motion.model(),
            rms: solution.motion.rms(),
            excess_frames: 0,
        })
    }

    /// Time of the state \[s\].
    pub fn time(&self) -> f64 {
        self.state.motion.time
    }

    /// Attitude of the body axes in inertial axes at [`Filter::time`].
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        self.state.motion.R_WB
    }

    /// The state, with its covariance.
    pub fn state(&self) -> &MotionState {
        &self.state
    }

    /// Angular velocity in inertial axes \[rad/s\], and its covariance.
    pub fn angular_velocity(&self) -> (Vector3<f64>, Matrix3<f64>) {
        self.state.angular_velocity()
    }

    /// Standard deviation of the rotation over the next `span` seconds \[rad\], root sum square of the three axes.
    /// The error of the current attitude counts only through its effect on the future motion. The value is
    /// conservative, since the common error of the points counts as an error of the attitude.
    pub fn prediction_deviation(&self, span: f64) -> f64 {
        let then = self.state.motion.time + span;
        let spread = self.state.turn_covariances(&[then]);
        spread
            .iter()
            .map(Matrix3::trace)
            .sum::<f64>()
            .max(0.0)
            .sqrt()
    }

    /// The motion as an estimate, with the motion model of the batch solution and the residual of the last frame that
    /// was used. `None` if the body does not rotate.
    pub fn estimate(&self) -> Option<MotionEstimate> {
        let rotation = self.state.rotation()?;
        let covariance = rotation
            .parameters()
            .map(|p| self.state.parameter_covariance(&p.J()));
        Some(MotionEstimate::new(
            self.model, rotation, self.rms, covariance,
        ))
    }

    /// Propagates the state to `time` \[s\].
    pub fn predict(&mut self, time: f64) {
        self.state.predict(time, &self.disturbance);
    }

    /// Propagates the state to the frame's time and corrects it with the frame; `R_WC` is the camera's attitude.
    pub fn update(&mut self, frame: &FeatureFrame, R_WC: &UnitQuaternion<f64>) -> Update {
        self.predict(frame.time);
        let known = frame.features.iter().filter_map(|f| {
            let p = self.points.get(&f.id)?;
            let m = Vector2::new(f.u - self.camera.cx, f.v - self.camera.cy);
            Some((*p, m))
        });
        let mut correspondences: Vec<_> = known.collect();
        let unknown = frame.features.len() - correspondences.len();
        let all = correspondences.len();
        let predicted = self.state.clone();
        let mut error = SVector::<f64, STATES>::zeros();
        let mut update = Update {
            used: 0,
            rejected: all,
            unknown,
            rms: 0.0,
            innovation: Vector3::zeros(),
        };
        let mut has_excess = false;
        // The first two rounds also gate the points; every round linearises at the updated state.
        for round in 0..3 {
            let Some(measurement) =
                self.attitude_information(&mut correspondences, R_WC, round < 2)
            else {
                self.state = predicted;
                return Update {
                    used: 0,
                    rejected: all,
                    ..update
                };
            };
            update.used = correspondences.len();
            update.rejected = all - correspondences.len();
            update.rms = measurement.rms;
            if round == 0 {
                update.innovation = measurement.innovation(&predicted);
            }
            // P⁺ = P - P_θ Λ (1 + P_θθ Λ)⁻¹ P_θᵀ is also valid for a singular information matrix Λ.
            let P = predicted.covariance;
            let P_t = P.fixed_columns::<3>(0).into_owned();
            let inner = Matrix3::identity() + P.fixed_view::<3, 3>(0, 0) * measurement.information;
            let Some(inverse) = inner.try_inverse() else {
                break;
            };
            let gain = P_t * measurement.information * inverse;
            let reduced = P - gain * P_t.transpose();
            // The prior is centred at the prediction; `error` is the difference of the current state from the
            // prediction.
            let turn = error.fixed_rows::<3>(0).into_owned();
            let innovation = -measurement.gradient + measurement.information * turn;
            let next = reduced.fixed_columns::<3>(0) * innovation;
            let Some(moved) = predicted.moved(&next) else {
                // Points that lead to an impossible motion count as outliers.
                self.state = predicted;
                return Update {
                    used: 0,
                    rejected: all,
                    ..update
                };
            };
            error = next;
            has_excess = measurement.has_excess;
            self.rms = measurement.rms;
            self.state = MotionState {
                covariance: (reduced + reduced.transpose()) * 0.5,
                ..moved
            };
        }
        self.excess_frames += u32::from(has_excess);
        update
    }

    /// Solves for the position at the current attitude, removes points that do not fit (if `gated`), and returns the
    /// information on the attitude with the position marginalised out.
    fn attitude_information(
        &mut self,
        correspondences: &mut Vec<(Vector3<f64>, Vector2<f64>)>,
        R_WC: &UnitQuaternion<f64>,
        gated: bool,
    ) -> Option<AttitudeInformation> {
        let R = *(R_WC.inverse() * self.state.motion.R_WB)
            .to_rotation_matrix()
            .matrix();
        let focal = Vector2::new(self.camera.fx, self.camera.fy);
        let lens = Intrinsics {
            radial: self.radial,
            ..Intrinsics::default()
        }
        .lens(&focal);
        let spread = self
            .state
            .covariance
            .fixed_view::<3, 3>(0, 0)
            .trace()
            .max(0.0)
            .sqrt();
        let extent = correspondences
            .iter()
            .map(|(p, _)| p.norm())
            .fold(0.0, f64::max);
        let mut t_C = self.position;
        for round in 0..6 {
            if correspondences.len() < MIN_POINTS {
                return None;
            }
            let limit =
                INLIER_GATE * (self.noise + focal.max() * spread * extent / t_C.z.abs().max(0.1));
            // While the position is not known, robust weights reduce the effect of outliers.
            let width = limit * f64::from(32 >> round).max(1.0);
            let (mut H_tt, mut H_at) = (Matrix3::zeros(), Matrix3::zeros());
            let mut H_aa = Matrix3::zeros();
            let (mut g_t, mut g_a) = (Vector3::zeros(), Vector3::zeros());
            let mut squares = 0.0;
            let mut fits = Vec::with_capacity(correspondences.len());
            for (p, m) in correspondences.iter() {
                let x = R * p + t_C;
                if x.z < 1e-2 {
                    fits.push(false);
                    continue;
                }
                let projected = lens.expand(&x);
                let r = projected.pixel - m;
                fits.push(r.norm() < limit);
                squares += r.norm_squared();
                let robust_weight = if gated {
                    1.0 / (1.0 + r.norm_squared() / (width * width))
                } else {
                    1.0
                };
                let weight = robust_weight / (self.noise * self.noise);
                let by_t = projected.by_x;
                let by_a = -by_t * R * p.cross_matrix();
                H_tt += by_t.tr_mul(&by_t) * weight;
                H_at += by_a.tr_mul(&by_t) * weight;
                H_aa += by_a.tr_mul(&by_a) * weight;
                g_t += by_t.tr_mul(&r) * weight;
                g_a += by_a.tr_mul(&r) * weight;
            }
            let inverse = H_tt.try_inverse()?;
            let step = -inverse * g_t;
            let converged = step.norm() < 1e-9 || round == 5;
            if converged {
                if gated && fits.contains(&false) {
                    let mut fits = fits.iter();
                    correspondences.retain(|_| fits.next().is_some_and(|f| *f));
                    self.position = t_C;
                    return (correspondences.len() >= MIN_POINTS)
                        .then(|| self.attitude_information(correspondences, R_WC, false))
                        .flatten();
                }
                self.position = t_C;
                let count = 2 * correspondences.len();
                let information = H_aa - H_at * inverse * H_at.transpose();
                let gradient = g_a - H_at * inverse * g_t;
                let explained = information
                    .try_inverse()
                    .map_or(0.0, |inverse| gradient.dot(&(inverse * gradient)));
                let unexplained = squares / (self.noise * self.noise) - explained;
                let excess = excess_variance(unexplained, count - POSE_UNKNOWNS);
                let scale = 1.0 / (1.0 + excess * f64::from(self.excess_frames + 1));
                return Some(AttitudeInformation {
                    information: information * scale,
                    gradient: gradient * scale,
                    has_excess: excess > 0.0,
                    rms: (squares / count as f64).sqrt(),
                });
            }
            t_C += step;
        }
        None
    }
}

/// Variance of a frame's points beyond the noise of the batch solution, in units of the noise variance. `chi_squared`
/// is the normalised sum of squared residuals that remain with a free pose, with `freedom` degrees of freedom. Zero
/// unless the excess is significant.
fn excess_variance(chi_squared: f64, freedom: usize) -> f64 {
    let freedom = freedom as f64;
    let excess = chi_squared / freedom - 1.0;
    let is_significant = excess > EXCESS_DEVIATIONS * (2.0 / freedom).sqrt();
    if is_significant { excess } else { 0.0 }
}

/// Information of a frame on the attitude, and gradient of the frame's cost by a rotation in body axes.
struct AttitudeInformation {
    information: Matrix3<f64>,
    gradient: Vector3<f64>,
    has_excess: bool,
    rms: f64,
}

impl AttitudeInformation {
    /// Difference between measured and `predicted` attitude, normalised to unit covariance, in inertial axes.
    fn innovation(&self, predicted: &MotionState) -> Vector3<f64> {
        let P = predicted.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let whitened = || {
            let inverse = self.information.try_inverse()?;
            let factor = (P + inverse).cholesky()?;
            factor
                .l()
                .solve_lower_triangular(&(-inverse * self.gradient))
        };
        whitened().map_or_else(Vector3::zeros, |z| predicted.motion.R_WB * z)
    }
}
