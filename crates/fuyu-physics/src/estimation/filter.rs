//! Recursive filter between batch solutions: an error-state Kalman filter of attitude, momentum and inertia.
//!
//! It starts from a batch [`Solution`] only, because its linearisation is not valid far from the truth. Its state are the
//! constants of torque-free motion, momentum (inertial axes) and inertia ratios, and the attitude; they determine the
//! angular velocity. Only the attitude changes with time. The body's position in a frame is solved from that frame and
//! discarded, as in the batch; the structure is that of the batch.

use std::collections::HashMap;

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::bundle::{FreeMotion, PARAMETERS, Solution, derivatives, shape_basis, shape_times};
use super::free_body::FreeRotation;
use super::{MotionEstimate, MotionModel};
use crate::spatial::exp_so3;
use crate::vision::{FeatureFrame, Pinhole};

/// Number of error states: rotation of the body (3), shape of its inertia (5), momentum (3).
const STATES: usize = 3 + PARAMETERS;

/// Least number of points of a frame that is used: its position adds three unknowns.
const MIN_POINTS: usize = 4;

/// Width of the inlier gate in standard deviations.
const INLIER_GATE: f64 = 5.0;

type Covariance = SMatrix<f64, STATES, STATES>;

/// The filter. Its updates must be in the order of time.
#[derive(Debug, Clone)]
pub struct Filter {
    motion: FreeMotion,
    covariance: Covariance,
    points: HashMap<u64, Vector3<f64>>,
    camera: Pinhole,
    noise: f64,
    disturbance: f64,
    position: Vector3<f64>,
    model: MotionModel,
    rms: f64,
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
}

impl Filter {
    /// A filter at the last pose of a batch solution. `disturbance` is the random walk of the momentum
    /// due to torques, relative to the momentum \[1/√s\]; 0 for none. `None` if the solution has no pose.
    pub fn new(solution: &Solution, disturbance: f64) -> Option<Self> {
        let last = solution.poses.last()?;
        let (R_WB, S) = *solution
            .free
            .attitudes_and_sensitivities(&[last.time])
            .first()?;
        // The attitude's error follows from that of the parameters, propagated to the last frame.
        let mut transition = SMatrix::<f64, STATES, PARAMETERS>::zeros();
        transition.fixed_rows_mut::<3>(0).copy_from(&S);
        transition
            .fixed_rows_mut::<PARAMETERS>(3)
            .fill_with_identity();
        let mut covariance = transition * solution.covariance * transition.transpose();
        let noise = solution.motion.rms().max(1e-3);
        // Error of the structure, from the number of its observations, as a rotation of the whole body.
        let pixel = 2.0 / (solution.camera.fx + solution.camera.fy);
        let observations = (solution.poses.len() * solution.points.len()).max(1) as f64;
        let turn = 3.0 * noise * pixel / observations.sqrt();
        for k in 0..3 {
            covariance[(k, k)] += turn * turn;
        }
        Some(Self {
            motion: FreeMotion {
                time: last.time,
                R_WB,
                ..solution.free
            },
            covariance,
            points: solution.points.iter().map(|p| (p.id, p.p_B)).collect(),
            camera: solution.camera,
            noise,
            disturbance,
            position: last.t_C,
            model: solution.motion.model(),
            rms: solution.motion.rms(),
        })
    }

    /// Time of the state \[s\].
    pub fn time(&self) -> f64 {
        self.motion.time
    }

    /// Attitude of the body axes in inertial axes at [`Filter::time`].
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        self.motion.R_WB
    }

    /// Angular velocity in inertial axes \[rad/s\], and its covariance.
    pub fn angular_velocity(&self) -> (Vector3<f64>, Matrix3<f64>) {
        let R = *self.motion.R_WB.to_rotation_matrix().matrix();
        let w = self.motion.w_WB_B(&self.motion.R_WB);
        let Some(inverse) = self.motion.inertia.try_inverse() else {
            return (R * w, Matrix3::zeros());
        };
        let h = R.tr_mul(&self.motion.momentum);
        let mut slope = SMatrix::<f64, 3, STATES>::zeros();
        let by_turn = R * (inverse * h.cross_matrix() - w.cross_matrix());
        slope.fixed_columns_mut::<3>(0).copy_from(&by_turn);
        slope
            .fixed_columns_mut::<5>(3)
            .copy_from(&(-R * inverse * shape_times(&w)));
        slope
            .fixed_columns_mut::<3>(8)
            .copy_from(&(R * inverse * R.transpose()));
        (R * w, slope * self.covariance * slope.transpose())
    }

    /// Standard deviation of the rotation over the next `span` seconds \[rad\], root sum square of the three axes. The
    /// error of the current attitude counts only through its effect on the future motion. The value is conservative, since
    /// the common error of the points counts as an error of the attitude.
    pub fn prediction_deviation(&self, span: f64) -> f64 {
        let then = self.motion.time + span;
        let Some(&(_, S)) = self.motion.attitudes_and_sensitivities(&[then]).first() else {
            return f64::INFINITY;
        };
        let mut turn = SMatrix::<f64, 3, STATES>::zeros();
        let by_turn = S.fixed_columns::<5>(0) * self.shape_by_turn();
        turn.fixed_columns_mut::<3>(0).copy_from(&by_turn);
        turn.fixed_columns_mut::<PARAMETERS>(3).copy_from(&S);
        (turn * self.covariance * turn.transpose())
            .trace()
            .max(0.0)
            .sqrt()
    }

    /// The motion as an estimate, with the model of the batch and the residual of the last frame that was used. `None` if
    /// the state is not a rotation.
    pub fn estimate(&self) -> Option<MotionEstimate> {
        let w = self.motion.w_WB_B(&self.motion.R_WB);
        let rotation =
            FreeRotation::new(&self.motion.inertia, self.motion.R_WB, &w, self.motion.time).ok()?;
        let covariance = rotation.parameters().map(|p| {
            let slopes = derivatives(&self.motion, &p.J());
            // Energy depends on the attitude as well: a rotation of the body acts like the inverse rotation of the
            // inertia.
            let by_turn = slopes.fixed_columns::<5>(0) * self.shape_by_turn();
            let mut all = SMatrix::<f64, 4, STATES>::zeros();
            all.fixed_columns_mut::<3>(0).copy_from(&by_turn);
            all.fixed_columns_mut::<PARAMETERS>(3).copy_from(&slopes);
            all * self.covariance * all.transpose()
        });
        Some(MotionEstimate::new(
            self.model, rotation, self.rms, covariance,
        ))
    }

    /// Derivative of the inertia's shape by a rotation of the body at the state's time, in the axes before the rotation.
    fn shape_by_turn(&self) -> SMatrix<f64, 5, 3> {
        let I = self.motion.inertia;
        let basis = shape_basis();
        SMatrix::from_fn(|k, j| {
            let turn = Vector3::ith(j, 1.0).cross_matrix();
            basis[k].dot(&(turn * I - I * turn))
        })
    }

    /// Propagates the state to `time` \[s\].
    pub fn predict(&mut self, time: f64) {
        let Some(&(R_WB, S)) = self.motion.attitudes_and_sensitivities(&[time]).first() else {
            return;
        };
        // A body that starts rotated by θ moves like one with its inertia rotated by θ, then rotated.
        let mut transition = Covariance::identity();
        let by_turn = Matrix3::identity() + S.fixed_columns::<5>(0) * self.shape_by_turn();
        transition.fixed_view_mut::<3, 3>(0, 0).copy_from(&by_turn);
        transition
            .fixed_view_mut::<3, PARAMETERS>(0, 3)
            .copy_from(&S);
        self.covariance = transition * self.covariance * transition.transpose();
        let walk = self.disturbance * self.motion.momentum.norm();
        for k in 8..STATES {
            self.covariance[(k, k)] += walk * walk * (time - self.motion.time).abs();
        }
        self.motion.time = time;
        self.motion.R_WB = R_WB;
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
        let predicted = (self.motion, self.covariance);
        let mut error = SVector::<f64, STATES>::zeros();
        let mut update = Update {
            used: 0,
            rejected: all,
            unknown,
            rms: 0.0,
        };
        // Two rounds gate the points, and every round linearises again at the updated state.
        for round in 0..3 {
            let Some(measurement) =
                self.attitude_information(&mut correspondences, R_WC, round < 2)
            else {
                (self.motion, self.covariance) = predicted;
                return Update {
                    used: 0,
                    rejected: all,
                    ..update
                };
            };
            update.used = correspondences.len();
            update.rejected = all - correspondences.len();
            update.rms = measurement.rms;
            // P⁺ = P - P_θ Λ (1 + P_θθ Λ)⁻¹ P_θᵀ is also valid for a singular information matrix Λ.
            let P = predicted.1;
            let P_t = P.fixed_columns::<3>(0).into_owned();
            let inner = Matrix3::identity() + P.fixed_view::<3, 3>(0, 0) * measurement.information;
            let Some(inverse) = inner.try_inverse() else {
                break;
            };
            let gain = P_t * measurement.information * inverse;
            let reduced = P - gain * P_t.transpose();
            // The prior is at the prediction; `error` is the difference of the current state from it.
            let turn = error.fixed_rows::<3>(0).into_owned();
            let innovation = -measurement.gradient + measurement.information * turn;
            let next = reduced.fixed_columns::<3>(0) * innovation;
            let step = SVector::<f64, PARAMETERS>::from(next.fixed_rows::<PARAMETERS>(3));
            let start = FreeMotion {
                R_WB: predicted.0.R_WB * exp_so3(&next.fixed_rows::<3>(0).into_owned()),
                ..predicted.0
            };
            let Some(moved) = start.moved(&step) else {
                // Points that lead to an impossible motion count as outliers.
                (self.motion, self.covariance) = predicted;
                return Update {
                    used: 0,
                    rejected: all,
                    ..update
                };
            };
            error = next;
            self.rms = measurement.rms;
            self.motion = moved;
            self.covariance = (reduced + reduced.transpose()) * 0.5;
        }
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
        let R = *(R_WC.inverse() * self.motion.R_WB)
            .to_rotation_matrix()
            .matrix();
        let focal = Vector2::new(self.camera.fx, self.camera.fy);
        let spread = self
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
                let (u, v) = (focal.x * x.x / x.z, focal.y * x.y / x.z);
                let r = Vector2::new(u, v) - m;
                fits.push(r.norm() < limit);
                squares += r.norm_squared();
                let robust_weight = if gated {
                    1.0 / (1.0 + r.norm_squared() / (width * width))
                } else {
                    1.0
                };
                let weight = robust_weight / (self.noise * self.noise);
                #[rustfmt::skip]
                let by_t = SMatrix::<f64, 2, 3>::new(
                    focal.x / x.z, 0.0, -u / x.z,
                    0.0, focal.y / x.z, -v / x.z,
                );
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
                return Some(AttitudeInformation {
                    information: H_aa - H_at * inverse * H_at.transpose(),
                    gradient: g_a - H_at * inverse * g_t,
                    rms: (squares / (2 * correspondences.len()) as f64).sqrt(),
                });
            }
            t_C += step;
        }
        None
    }
}

/// Information of a frame on the attitude, and gradient of its cost, by a rotation in body axes.
struct AttitudeInformation {
    information: Matrix3<f64>,
    gradient: Vector3<f64>,
    rms: f64,
}
