//! Rendezvous: joint motions of a free-floating robot that bring its tip to a moving frame at zero relative twist.
//!
//! Joints follow quintic polynomials from their present position, rate and acceleration to those at the arrival, plus
//! bumps `a_j 64 s³ (1 - s)³` that change the way but neither end. The base turns as momentum demands (Masutani 1995 eq.
//! (4.23) with the momentum term), so where it is at the arrival depends on the whole way; end positions are found by
//! shooting: Newton's method on the tip's pose at the arrival. Rates and accelerations at the end follow from twist and
//! acceleration of the goal by the generalized Jacobian there. Bumps are chosen to turn the base least, by Gauss and
//! Newton's method, and to keep clear.

use nalgebra::{DMatrix, DVector, Matrix6xX, Translation3, UnitQuaternion, Vector3, Vector6};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::clearance::{Clearance, Distances};
use super::plan::{JointLimitsShare, Plan, PlanError, Start, point, quintic, rank};
use super::target_track::FrameMotion;
use crate::control::commander::JointPoint;
use crate::control::damped_descent::shortened;
use crate::dynamics::{Input, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::{Pose, Twist, exp_so3};

/// Pieces of the way over which the base's rotation is integrated, by Magnus's method of fourth order.
pub(super) const PIECES: usize = 48;
/// Largest deviation of the tip from its goal at the arrival, of position \[m\] and rotation vector \[rad\].
const TOLERANCE: f64 = 1e-9;
const ITERATIONS: usize = 25;
/// Longest step of the joints in an iteration \[rad or m\].
const LONGEST_STEP: f64 = 0.4;
/// Postures from which the search starts besides the present one.
const POSTURES: usize = 24;
/// Weight of a violated clearance \[1/m\] against the base's angular velocity \[rad/s\].
const CLEARANCE_WEIGHT: f64 = 1.0;
/// Iterations of the search for a posture.
const DESCENT: usize = 150;
const SHAPING_ITERATIONS: usize = 4;
/// Largest bump \[rad or m\].
const LARGEST_BUMP: f64 = 0.8;
/// Weight of a bump \[1/(rad s)\]: a joint moves for the base's sake only where that helps.
const BUMP_WEIGHT: f64 = 1e-4;

/// Joint motion at the arrival.
#[derive(Debug, Clone)]
pub(super) struct End {
    pub q: DVector<f64>,
    pub qd: DVector<f64>,
    pub qdd: DVector<f64>,
}

/// A way with what it leads to.
pub(super) struct Shot {
    pub polynomials: Vec<[f64; 6]>,
    pub R_IB: UnitQuaternion<f64>,
    pub error: Vector6<f64>,
    /// By how much rates and accelerations at the end of the way differ from those of `end`.
    pub rates_off: f64,
    pub end: End,
}

/// Plans rendezvous of one robot.
#[derive(Debug, Clone)]
pub struct RendezvousPlanner {
    pub(super) model: Model,
    pub(super) tip: Frame,
    pub(super) clearance: Clearance,
    pub(super) limits: JointLimitsShare,
    pub(super) workspace: Workspace,
    pub(super) jacobian: Matrix6xX<f64>,
    pub(super) no_input: Input,
    pub(super) free: DVector<f64>,
}

/// The rendezvous that is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Rendezvous<'a> {
    /// The start.
    pub start: &'a Start,
    /// Time of the arrival \[s\].
    pub arrival: f64,
    /// Motion of the frame with which the tip's is to coincide then, in I.
    pub goal: &'a FrameMotion,
    /// The target's centre of mass in I at the start and at the arrival; it moves uniformly.
    pub center: Option<(Vector3<f64>, Vector3<f64>)>,
}

impl Rendezvous<'_> {
    pub(super) fn duration(&self) -> f64 {
        self.arrival - self.start.state.time
    }
}

impl RendezvousPlanner {
    /// A planner for `tip` of a robot.
    pub fn new(model: &Model, tip: &Frame, clearance: Clearance, limits: JointLimitsShare) -> Self {
        Self {
            model: model.clone(),
            tip: tip.clone(),
            clearance,
            limits,
            workspace: Workspace::new(model),
            jacobian: Matrix6xX::zeros(model.dof()),
            no_input: Input::zero(model),
            free: DVector::zeros(model.dof()),
        }
    }

    /// The motion that reaches the rendezvous and turns the base least, from several postures at the arrival.
    ///
    /// # Errors
    /// [`PlanError`]: that of the way which came closest to a plan.
    pub fn plan(&mut self, task: &Rendezvous) -> Result<Plan, PlanError> {
        let straight = DVector::zeros(self.model.dof());
        let mut best: Option<Plan> = None;
        let mut failure: Option<PlanError> = None;
        for end in self.postures(task) {
            let found = self.shoot(task, end, &straight);
            let shaped = found.and_then(|shot| self.shaped(task, shot));
            match shaped {
                Ok(plan) => {
                    if best.as_ref().is_none_or(|b| plan.base_rate < b.base_rate) {
                        best = Some(plan);
                    }
                }
                Err(e) => {
                    let is_nearer = failure.as_ref().is_none_or(|f| rank(&e) > rank(f));
                    if is_nearer {
                        failure = Some(e);
                    }
                }
            }
        }
        best.ok_or_else(|| {
            failure.unwrap_or(PlanError::NotReached {
                arrival: task.arrival,
                position: f64::INFINITY,
                angle: f64::INFINITY,
            })
        })
    }

    /// The same with the end and shape of an earlier plan as start of the search.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn replan(&mut self, task: &Rendezvous, earlier: &Plan) -> Result<Plan, PlanError> {
        let n = self.model.dof();
        let of = |value: fn(&JointPoint) -> f64| {
            DVector::from_fn(n, |j, _| value(&earlier.at(j, earlier.arrival)))
        };
        let end = End {
            q: earlier.q.clone(),
            qd: of(|p| p.rate),
            qdd: of(|p| p.acceleration),
        };
        // The bumps fade with the way that is left.
        let left = task.duration() / (earlier.arrival - earlier.start).max(1e-9);
        let bumps = &earlier.bumps * left.clamp(0.0, 1.0).powi(3);
        let shot = self.shoot(task, end, &bumps)?;
        self.checked(task, shot, bumps)
    }

    /// The first of `arrivals` \[s\] for which there is a plan.
    ///
    /// # Errors
    /// [`PlanError`] of the last one.
    pub fn earliest<'a>(
        &mut self,
        tasks: impl Iterator<Item = Rendezvous<'a>>,
    ) -> Result<Plan, PlanError> {
        let mut failure = PlanError::Unknown(f64::INFINITY);
        for task in tasks {
            match self.plan(&task) {
                Ok(plan) => return Ok(plan),
                Err(e) => failure = e,
            }
        }
        Err(failure)
    }

    /// Postures of the arm at the arrival, with the base where it is at the start: the starts of the shooting.
    fn postures(&mut self, task: &Rendezvous) -> Vec<End> {
        let n = self.model.dof();
        let now = DVector::from_fn(n, |j, _| task.start.joints[j].position);
        let mut random = StdRng::seed_from_u64(1);
        let mut found: Vec<DVector<f64>> = Vec::new();
        for attempt in 0..=POSTURES {
            let mut q = now.clone();
            if attempt > 0 {
                for (j, joint) in self.model.joints().iter().enumerate() {
                    let around = if attempt % 2 == 0 { 1.0 } else { 2.5 };
                    let lower = joint.limits.lower.max(now[j] - around);
                    let upper = joint.limits.upper.min(now[j] + around);
                    q[j] = lower + (upper - lower) * random.random_range(0.0..1.0);
                }
            }
            if self.descend(&task.start.state.R_WB, task.goal, &mut q) {
                self.unwind(&now, &mut q);
                let is_new = |other: &DVector<f64>| (other - &q).amax() > 0.05;
                if found.iter().all(is_new) {
                    found.push(q);
                }
            }
        }
        let nearest = |q: &DVector<f64>| (q - &now).norm();
        found.sort_by(|a, b| nearest(a).total_cmp(&nearest(b)));
        found.truncate(4);
        let end = |q| End {
            q,
            qd: DVector::zeros(n),
            qdd: DVector::zeros(n),
        };
        found.into_iter().map(end).collect()
    }

    /// Joints without limits take the shorter way.
    fn unwind(&self, now: &DVector<f64>, q: &mut DVector<f64>) {
        use std::f64::consts::TAU;
        for (j, joint) in self.model.joints().iter().enumerate() {
            let limits = &joint.limits;
            let is_free = limits.lower.is_infinite() && limits.upper.is_infinite();
            if is_free && joint.kind.is_rotational() {
                q[j] -= TAU * ((q[j] - now[j]) / TAU).round();
            }
        }
    }

    /// Damped least squares on the tip's pose, from joint positions `q`.
    pub(super) fn descend(
        &mut self,
        R_IB: &UnitQuaternion<f64>,
        goal: &FrameMotion,
        q: &mut DVector<f64>,
    ) -> bool {
        for _ in 0..DESCENT {
            self.workspace.set_positions(q);
            let error = self.pose_error(R_IB, goal);
            let size = error.norm();
            if size < 1e-3 {
                return true;
            }
            // On a nearly straight way; strongly damped far from the goal.
            let error = error * (LONGEST_STEP / size).min(1.0);
            let Some(step) = self.resolved(R_IB, &error, 0.1 * size.min(1.0)) else {
                return false;
            };
            *q += shortened(step, LONGEST_STEP);
            for (j, joint) in self.model.joints().iter().enumerate() {
                q[j] = q[j].clamp(joint.limits.lower, joint.limits.upper);
            }
        }
        false
    }

    /// Position error and rotation vector from the tip to the goal, axes of I, at the positions of the workspace.
    pub(super) fn pose_error(
        &self,
        R_IB: &UnitQuaternion<f64>,
        goal: &FrameMotion,
    ) -> Vector6<f64> {
        let X_IE = self.X_IE(R_IB);
        let p = goal.X.translation.vector - X_IE.translation.vector;
        let turn = UnitQuaternion::from(goal.X.rotation * X_IE.rotation.inverse()).scaled_axis();
        Vector6::new(p.x, p.y, p.z, turn.x, turn.y, turn.z)
    }

    fn X_IB(&self, R_IB: &UnitQuaternion<f64>) -> Pose {
        let R = R_IB.to_rotation_matrix();
        Pose::from_parts(Translation3::from(-(R * self.workspace.p_BC())), R)
    }

    fn X_IE(&self, R_IB: &UnitQuaternion<f64>) -> Pose {
        self.X_IB(R_IB) * self.workspace.X_BF(&self.tip)
    }

    /// Joint rates for a twist of the tip (linear first, axes of I) at zero momentum, by damped least squares.
    fn resolved(
        &mut self,
        R_IB: &UnitQuaternion<f64>,
        twist_I: &Vector6<f64>,
        damping: f64,
    ) -> Option<DVector<f64>> {
        self.workspace
            .generalized_jacobian(&self.tip, &mut self.jacobian);
        let [linear, angular] = [0, 3]
            .map(|k| R_IB.inverse_transform_vector(&Vector3::from(twist_I.fixed_rows::<3>(k))));
        let twist = DVector::from_iterator(6, linear.iter().chain(angular.iter()).copied());
        let J = DMatrix::from_fn(6, self.jacobian.ncols(), |r, c| self.jacobian[(r, c)]);
        let normal = &J * J.transpose() + DMatrix::identity(6, 6) * (damping * damping);
        Some(J.tr_mul(&normal.cholesky()?.solve(&twist)))
    }

    /// State of the robot in I at positions, rates and attitude of the base.
    pub(super) fn state(&self, task: &Rendezvous, R_IB: UnitQuaternion<f64>, end: &End) -> State {
        let mut state = task.start.state.clone();
        state.R_WB = R_IB;
        state.q.copy_from(&end.q);
        state.qd.copy_from(&end.qd);
        state.p_WC = Vector3::zeros();
        state.momentum_W.linear = Vector3::zeros();
        state
    }

    /// Rates and accelerations with which the tip has the goal's twist and acceleration, at the positions of `end`.
    fn match_motion(
        &mut self,
        task: &Rendezvous,
        R_IB: UnitQuaternion<f64>,
        end: &mut End,
    ) -> Option<()> {
        let stacked = |twist: &Twist| {
            let (l, a) = (twist.linear, twist.angular);
            Vector6::new(l.x, l.y, l.z, a.x, a.y, a.z)
        };
        let in_I = |twist_B: Twist| Twist::new(R_IB * twist_B.angular, R_IB * twist_B.linear);
        end.qd.fill(0.0);
        let at_rest = self.state(task, R_IB, end);
        self.workspace.set_positions(&end.q);
        self.workspace.set_motion(&at_rest);
        let drift = in_I(self.workspace.V_WF_B(&self.tip));
        let wanted = stacked(&task.goal.V) - stacked(&drift);
        end.qd = self.resolved(&R_IB, &wanted, 1e-6)?;
        let moving = self.state(task, R_IB, end);
        self.workspace.set_motion(&moving);
        // The accelerations with joints that do not accelerate.
        (self.workspace).accelerations(&moving, &self.no_input, &mut self.free);
        self.workspace
            .set_accelerations(&DVector::zeros(self.free.len()));
        let bias = in_I(self.workspace.A_WF_B(&self.tip));
        let wanted = stacked(&task.goal.A) - stacked(&bias);
        end.qdd = self.resolved(&R_IB, &wanted, 1e-6)?;
        Some(())
    }

    /// The way to `end`.
    fn polynomials(&self, task: &Rendezvous, end: &End) -> Vec<[f64; 6]> {
        let joints = task.start.joints.iter().enumerate();
        let to = |j: usize| JointPoint {
            position: end.q[j],
            rate: end.qd[j],
            acceleration: end.qdd[j],
        };
        joints
            .map(|(j, from)| quintic(from, &to(j), task.duration()))
            .collect()
    }

    /// Angular velocity of the base on the way at `s`, base axes, with its attitude there.
    fn base_rate(
        &mut self,
        task: &Rendezvous,
        (polynomials, bumps): (&[[f64; 6]], &DVector<f64>),
        R_IB: &UnitQuaternion<f64>,
        s: f64,
    ) -> Vector3<f64> {
        let (n, T) = (polynomials.len(), task.duration());
        let (mut q, mut qd) = (DVector::zeros(n), DVector::zeros(n));
        for j in 0..n {
            let at = point(&polynomials[j], bumps[j], s, T);
            (q[j], qd[j]) = (at.position, at.rate);
        }
        self.workspace.set_positions(&q);
        let momentum = &task.start.state.momentum_W;
        let momentum_B = crate::dynamics::Momentum {
            linear: Vector3::zeros(),
            angular: R_IB.inverse_transform_vector(&momentum.angular),
        };
        self.workspace.base_twist(&momentum_B, &qd).angular
    }

    /// Attitude of the base after a piece of the way.
    pub(super) fn turned(
        &mut self,
        task: &Rendezvous,
        way: (&[[f64; 6]], &DVector<f64>),
        R_IB: &UnitQuaternion<f64>,
        piece: usize,
    ) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let h = task.duration() / PIECES as f64;
        let at = |c: f64| (piece as f64 + c) / PIECES as f64;
        let gauss = 3.0_f64.sqrt() / 6.0;
        // The momentum in base axes needs the attitude within the piece, for which one evaluation suffices: momentum is a
        // small part of the base's motion, and the piece is short.
        let begin = self.base_rate(task, way, R_IB, at(0.0));
        let within = |c: f64| R_IB * exp_so3(&(begin * (c * h)));
        let a = self.base_rate(task, way, &within(0.5 - gauss), at(0.5 - gauss));
        let b = self.base_rate(task, way, &within(0.5 + gauss), at(0.5 + gauss));
        let turn = (a + b) * (0.5 * h) + a.cross(&b) * (3.0_f64.sqrt() / 12.0 * h * h);
        (R_IB * exp_so3(&turn), (a + b) * 0.5)
    }

    /// Follows the way to `end`; the result has rates and accelerations that match the goal where it leads.
    fn follow(&mut self, task: &Rendezvous, mut end: End, bumps: &DVector<f64>) -> Option<Shot> {
        let polynomials = self.polynomials(task, &end);
        let mut R_IB = task.start.state.R_WB;
        for piece in 0..PIECES {
            R_IB = self.turned(task, (&polynomials, bumps), &R_IB, piece).0;
        }
        self.workspace.set_positions(&end.q);
        let error = self.pose_error(&R_IB, task.goal);
        let used = end.clone();
        self.match_motion(task, R_IB, &mut end)?;
        let off = (&end.qd - used.qd).amax() + (&end.qdd - used.qdd).amax();
        Some(Shot {
            polynomials,
            R_IB,
            error,
            rates_off: off,
            end,
        })
    }

    /// Newton's method on the end of the way.
    fn shoot(
        &mut self,
        task: &Rendezvous,
        end: End,
        bumps: &DVector<f64>,
    ) -> Result<Shot, PlanError> {
        let not_reached = |error: &Vector6<f64>| PlanError::NotReached {
            arrival: task.arrival,
            position: error.fixed_rows::<3>(0).norm(),
            angle: error.fixed_rows::<3>(3).norm(),
        };
        let far = Vector6::repeat(f64::INFINITY);
        let mut end = end;
        let mut best = far;
        for _ in 0..ITERATIONS {
            let shot = self.follow(task, end.clone(), bumps);
            let shot = shot.ok_or_else(|| not_reached(&best))?;
            if !shot.error.iter().all(|x| x.is_finite()) {
                return Err(not_reached(&best));
            }
            if shot.error.norm() < best.norm() {
                best = shot.error;
            }
            if shot.error.norm() + shot.rates_off < TOLERANCE {
                return Ok(shot);
            }
            // The tip follows the joints at the end with the generalized Jacobian there, and the rest of the way turns the
            // base little, so that the iteration contracts.
            self.workspace.set_positions(&shot.end.q);
            let step = self.resolved(&shot.R_IB, &shot.error, 1e-4);
            let step = step.ok_or_else(|| not_reached(&best))?;
            end = shot.end;
            end.q += shortened(step, LONGEST_STEP);
        }
        Err(not_reached(&best))
    }

    /// Chooses the bumps, and checks the result.
    fn shaped(&mut self, task: &Rendezvous, shot: Shot) -> Result<Plan, PlanError> {
        let n = self.model.dof();
        let mut bumps = DVector::zeros(n);
        let mut shot = shot;
        let mut residual = self.residual(task, &shot, &bumps);
        for _ in 0..SHAPING_ITERATIONS {
            const STEP: f64 = 1e-3;
            let mut slope = DMatrix::zeros(residual.len(), n);
            for j in 0..n {
                let mut moved = bumps.clone();
                moved[j] += STEP;
                let other = self.shoot(task, shot.end.clone(), &moved)?;
                let column = (self.residual(task, &other, &moved) - &residual) / STEP;
                slope.set_column(j, &column);
            }
            let normal = slope.tr_mul(&slope) + DMatrix::identity(n, n) * 1e-12;
            let Some(factor) = normal.cholesky() else {
                break;
            };
            let step = -factor.solve(&slope.tr_mul(&residual));
            let mut gained = false;
            for share in [1.0, 0.5, 0.2] {
                let moved =
                    (&bumps + &step * share).map(|b: f64| b.clamp(-LARGEST_BUMP, LARGEST_BUMP));
                let Ok(other) = self.shoot(task, shot.end.clone(), &moved) else {
                    continue;
                };
                let after = self.residual(task, &other, &moved);
                if after.norm_squared() < 0.999 * residual.norm_squared() {
                    (bumps, shot, residual, gained) = (moved, other, after, true);
                    break;
                }
            }
            if !gained {
                break;
            }
        }
        self.checked(task, shot, bumps)
    }

    /// What the bumps make small: the base's angular velocity, clearances that are violated, and the bumps.
    fn residual(&mut self, task: &Rendezvous, shot: &Shot, bumps: &DVector<f64>) -> DVector<f64> {
        let mut rows = Vec::with_capacity(5 * PIECES + bumps.len());
        let scale = 1.0 / (PIECES as f64).sqrt();
        let mut R_IB = task.start.state.R_WB;
        for piece in 0..PIECES {
            let (after, rate) = self.turned(task, (&shot.polynomials, bumps), &R_IB, piece);
            rows.extend((rate * scale).iter());
            R_IB = after;
            let distances = self.distances(task, shot, bumps, &R_IB, piece + 1);
            let margin = self.clearance.config().margin;
            // With a reserve, so that the minimum keeps the margin itself.
            let own = (margin + 0.05 - distances.own).max(0.0);
            let of_target = (0.05 - distances.keep_out).max(0.0);
            rows.push(CLEARANCE_WEIGHT * scale * own);
            rows.push(CLEARANCE_WEIGHT * scale * of_target);
        }
        rows.extend(bumps.iter().map(|b| BUMP_WEIGHT * b));
        DVector::from_vec(rows)
    }

    /// Distances after a piece of the way.
    pub(super) fn distances(
        &mut self,
        task: &Rendezvous,
        shot: &Shot,
        bumps: &DVector<f64>,
        R_IB: &UnitQuaternion<f64>,
        piece: usize,
    ) -> Distances {
        let s = piece as f64 / PIECES as f64;
        let T = task.duration();
        let at = |j: usize| point(&shot.polynomials[j], bumps[j], s, T).position;
        let q = DVector::from_fn(bumps.len(), |j, _| at(j));
        self.workspace.set_positions(&q);
        let center = task.center.map(|(from, to)| from.lerp(&to, s));
        let X_IB = self.X_IB(R_IB);
        (self.clearance).distances(&self.workspace, &X_IB, center.as_ref())
    }
}
