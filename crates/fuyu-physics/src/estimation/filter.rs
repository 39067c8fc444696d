//! Updates between batch solutions: a recursive filter on the errors of attitude, momentum and inertia.
//!
//! It starts from a batch [`Solution`] and from nothing else: far from the truth its linearisation would hold nothing.
//! What a torque-free body keeps is the state: momentum (in inertial axes) and inertia ratios, and with them the
//! attitude; angular velocity follows. So nothing but the attitude is propagated. The body's position in a frame is
//! solved with the frame and forgotten, as in the batch; the structure is the batch's.

use std::collections::HashMap;

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::bundle::{FreeMotion, PARAMETERS, Solution, derivatives, shape_basis, shape_times};
use super::free_body::FreeRotation;
use super::{MotionEstimate, MotionModel};
use crate::spatial::exp_so3;
use crate::vision::{Pinhole, Sighting};

/// Errors: the turn of the body (3), shape of its inertia (5), momentum (3).
const STATES: usize = 3 + PARAMETERS;

/// The fewest points of a frame that are used: with its position three unknowns of a frame are new.
const MIN_POINTS: usize = 4;

/// Image points farther off than this many standard deviations are left out.
const GATE: f64 = 5.0;

type Covariance = SMatrix<f64, STATES, STATES>;

/// The filter. Feed it frames in the order of time.
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

/// What a frame contributed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Update {
    /// Points that were used; none if too few fit.
    pub used: usize,
    /// Points of the structure that did not fit.
    pub rejected: usize,
    /// Points that the structure does not have.
    pub unknown: usize,
    /// Root mean square of the residuals' components after the update \[px\].
    pub rms: f64,
}

impl Filter {
    /// A filter at the last pose of a batch solution. `disturbance` is what torques do to the momentum: its random
    /// walk over the momentum, \[1/√s\]; 0 for none. `None` if the solution has no pose.
    pub fn new(solution: &Solution, disturbance: f64) -> Option<Self> {
        let last = solution.poses.last()?;
        let (R_WB, S) = *solution
            .free
            .attitudes_and_sensitivities(&[last.time])
            .first()?;
        // The attitude's error is that of the parameters, carried to the last frame.
        let mut carry = SMatrix::<f64, STATES, PARAMETERS>::zeros();
        carry.fixed_rows_mut::<3>(0).copy_from(&S);
        carry.fixed_rows_mut::<PARAMETERS>(3).fill_with_identity();
        let mut covariance = carry * solution.covariance * carry.transpose();
        let noise = solution.motion.rms().max(1e-3);
        // The points are known as well as their many sightings say; together that is a turn of the whole body.
        let pixel = 2.0 / (solution.camera.fx + solution.camera.fy);
        let sightings = (solution.poses.len() * solution.points.len()).max(1) as f64;
        let turn = 3.0 * noise * pixel / sightings.sqrt();
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

    /// Body axes in inertial axes, at [`Filter::time`].
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

    /// How certain the next `span` seconds are: standard deviation of the turn from now to then \[rad\], all axes
    /// together. What is not known of the present attitude does not count, except for what it makes of the future. It is
    /// on the safe side, since the points' common error counts as one of the attitude.
    pub fn foresight(&self, span: f64) -> f64 {
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

    /// The motion as an estimate, with the model that the batch found and the residual of the last frame that was
    /// used. `None` if the state is no rotation.
    pub fn estimate(&self) -> Option<MotionEstimate> {
        let w = self.motion.w_WB_B(&self.motion.R_WB);
        let rotation =
            FreeRotation::new(&self.motion.inertia, self.motion.R_WB, &w, self.motion.time).ok()?;
        let covariance = rotation.parameters().map(|p| {
            let slopes = derivatives(&self.motion, &p.J());
            // Energy and momentum, seen in the body, change with the attitude, too: by a rotation of the
            // inertia the other way.
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

    /// How a turn of the body at the state's time changes the inertia as seen in the axes before the turn.
    fn shape_by_turn(&self) -> SMatrix<f64, 5, 3> {
        let I = self.motion.inertia;
        let basis = shape_basis();
        SMatrix::from_fn(|k, j| {
            let turn = Vector3::ith(j, 1.0).cross_matrix();
            basis[k].dot(&(turn * I - I * turn))
        })
    }

    /// Carries the state to `time` \[s\].
    pub fn predict(&mut self, time: f64) {
        let Some(&(R_WB, S)) = self.motion.attitudes_and_sensitivities(&[time]).first() else {
            return;
        };
        // A body that starts turned by θ moves like one with its inertia turned by θ, then turned.
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

    /// Carries the state to the frame's time and corrects it by what the frame shows; `R_WC` is the camera's attitude.
    pub fn update(&mut self, frame: &Sighting, R_WC: &UnitQuaternion<f64>) -> Update {
        self.predict(frame.time);
        let known = frame.features.iter().filter_map(|f| {
            let p = self.points.get(&f.id)?;
            let m = Vector2::new(f.u - self.camera.cx, f.v - self.camera.cy);
            Some((*p, m))
        });
        let mut marks: Vec<_> = known.collect();
        let unknown = frame.features.len() - marks.len();
        let all = marks.len();
        let predicted = (self.motion, self.covariance);
        let mut error = SVector::<f64, STATES>::zeros();
        let mut update = Update {
            used: 0,
            rejected: all,
            unknown,
            rms: 0.0,
        };
        // The first round finds the position and what does not fit, the others linearise anew.
        for round in 0..3 {
            let Some(view) = self.look(&mut marks, R_WC, round < 2) else {
                (self.motion, self.covariance) = predicted;
                return Update {
                    used: 0,
                    rejected: all,
                    ..update
                };
            };
            update.used = marks.len();
            update.rejected = all - marks.len();
            update.rms = view.rms;
            // P⁺ = P - P_θ Λ (1 + P_θθ Λ)⁻¹ P_θᵀ holds for an information Λ that sees only part of the turn, too.
            let P = predicted.1;
            let P_t = P.fixed_columns::<3>(0).into_owned();
            let inner = Matrix3::identity() + P.fixed_view::<3, 3>(0, 0) * view.information;
            let Some(inverse) = inner.try_inverse() else {
                break;
            };
            let gain = P_t * view.information * inverse;
            let reduced = P - gain * P_t.transpose();
            // The prior pulls back to the prediction, from which `error` leads to the present state.
            let turn = error.fixed_rows::<3>(0).into_owned();
            let innovation = -view.gradient + view.information * turn;
            let next = reduced.fixed_columns::<3>(0) * innovation;
            let step = SVector::<f64, PARAMETERS>::from(next.fixed_rows::<PARAMETERS>(3));
            let start = FreeMotion {
                R_WB: predicted.0.R_WB * exp_so3(&next.fixed_rows::<3>(0).into_owned()),
                ..predicted.0
            };
            let Some(moved) = start.moved(&step) else {
                // Points that ask for what no body does fit no more than points that are far off.
                (self.motion, self.covariance) = predicted;
                return Update {
                    used: 0,
                    rejected: all,
                    ..update
                };
            };
            error = next;
            self.rms = view.rms;
            self.motion = moved;
            self.covariance = (reduced + reduced.transpose()) * 0.5;
        }
        update
    }

    /// Solves for the position at the present attitude, drops marks that do not fit, and returns what remains known
    /// about the attitude.
    fn look(
        &mut self,
        marks: &mut Vec<(Vector3<f64>, Vector2<f64>)>,
        R_WC: &UnitQuaternion<f64>,
        gated: bool,
    ) -> Option<View> {
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
        let extent = marks.iter().map(|(p, _)| p.norm()).fold(0.0, f64::max);
        let mut t_C = self.position;
        for round in 0..6 {
            if marks.len() < MIN_POINTS {
                return None;
            }
            let limit = GATE * (self.noise + focal.max() * spread * extent / t_C.z.abs().max(0.1));
            // While the position is not known, what fits is told by the others: a soft loss.
            let width = limit * f64::from(32 >> round).max(1.0);
            let (mut H_tt, mut H_at) = (Matrix3::zeros(), Matrix3::zeros());
            let mut H_aa = Matrix3::zeros();
            let (mut g_t, mut g_a) = (Vector3::zeros(), Vector3::zeros());
            let mut squares = 0.0;
            let mut fits = Vec::with_capacity(marks.len());
            for (p, m) in marks.iter() {
                let x = R * p + t_C;
                if x.z < 1e-2 {
                    fits.push(false);
                    continue;
                }
                let (u, v) = (focal.x * x.x / x.z, focal.y * x.y / x.z);
                let r = Vector2::new(u, v) - m;
                fits.push(r.norm() < limit);
                squares += r.norm_squared();
                let loss = if gated {
                    1.0 / (1.0 + r.norm_squared() / (width * width))
                } else {
                    1.0
                };
                let weight = loss / (self.noise * self.noise);
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
            let settled = step.norm() < 1e-9 || round == 5;
            if settled {
                if gated && fits.contains(&false) {
                    let mut fits = fits.iter();
                    marks.retain(|_| fits.next().is_some_and(|f| *f));
                    self.position = t_C;
                    return (marks.len() >= MIN_POINTS)
                        .then(|| self.look(marks, R_WC, false))
                        .flatten();
                }
                self.position = t_C;
                return Some(View {
                    information: H_aa - H_at * inverse * H_at.transpose(),
                    gradient: g_a - H_at * inverse * g_t,
                    rms: (squares / (2 * marks.len()) as f64).sqrt(),
                });
            }
            t_C += step;
        }
        None
    }
}

/// What a frame tells about the attitude: information and gradient of its cost by a turn in body axes.
struct View {
    information: Matrix3<f64>,
    gradient: Vector3<f64>,
    rms: f64,
}
