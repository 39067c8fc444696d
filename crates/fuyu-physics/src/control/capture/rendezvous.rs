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
use super::target_track::FrameMotion;
use crate::control::commander::JointPoint;
use crate::control::damped_descent::shortened;
use crate::dynamics::{Input, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::{Pose, Twist, exp_so3};

/// Pieces of the way over which the base's rotation is integrated, by Magnus's method of fourth order.
const PIECES: usize = 48;
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
/// Least singular value of the tip's Jacobian at the arrival, lengths in m.
const SINGULAR: f64 = 0.05;

/// What a plan minimises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Objective {
    /// Rotation of the base on the way.
    #[default]
    BaseReaction,
    /// Time until the arrival.
    Time,
}

impl Objective {
    /// All by name.
    pub const NAMES: [(&'static str, Self); 2] =
        [("base_reaction", Self::BaseReaction), ("time", Self::Time)];
}

/// Where a plan begins: the motion of the robot in I.
#[derive(Debug, Clone)]
pub struct Start {
    /// The robot's state: attitude of the base, momentum; its positions and rates are not used.
    pub state: State,
    /// Position, rate and acceleration of each joint's reference.
    pub joints: Vec<JointPoint>,
}

/// Limits that a plan respects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimitsShare {
    /// Share of the joints' velocity limits that a plan uses.
    pub velocity: f64,
    /// Largest rate of a joint whose description gives no limit \[rad/s or m/s\].
    pub default_velocity: f64,
    /// Largest acceleration of a joint \[rad/s² or m/s²\].
    pub acceleration: f64,
    /// Share of the joints' effort limits that a plan uses.
    pub effort: f64,
}

impl Default for JointLimitsShare {
    fn default() -> Self {
        Self {
            velocity: 0.8,
            default_velocity: 0.3,
            acceleration: 0.2,
            effort: 0.7,
        }
    }
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The tip does not get there.
    #[error(
        "the tip does not reach the target at {arrival:.1} s: {position:.3} m and {angle:.3} rad are left at best"
    )]
    NotReached {
        /// Time of the arrival \[s\].
        arrival: f64,
        /// What is left \[m\].
        position: f64,
        /// What is left \[rad\].
        angle: f64,
    },
    /// The arm would be nearly singular at the arrival.
    #[error(
        "the arm is nearly singular where it meets the target at {arrival:.1} s (singular value {value:.3}, least {SINGULAR})"
    )]
    Singular {
        /// Time of the arrival \[s\].
        arrival: f64,
        /// Smallest singular value of the generalized Jacobian.
        value: f64,
    },
    /// A joint would exceed a limit.
    #[error("joint '{joint}' would exceed its limit of {what}: {value:.3}, limit {limit:.3}")]
    Joint {
        /// The joint.
        joint: String,
        /// Of what.
        what: &'static str,
        /// The value \[SI\].
        value: f64,
        /// The limit \[SI\].
        limit: f64,
    },
    /// The arm would come too close to something.
    #[error("the arm would come within {distance:.3} m of {what}")]
    Clearance {
        /// Of what.
        what: &'static str,
        /// The distance \[m\], negative inside.
        distance: f64,
    },
    /// The target's motion is not known until then.
    #[error("the target's motion is not known until {0:.1} s")]
    Unknown(f64),
}

/// A joint motion to the rendezvous.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Time of the start \[s\].
    pub start: f64,
    /// Time of the arrival \[s\].
    pub arrival: f64,
    /// Joint positions at the arrival.
    pub q: DVector<f64>,
    /// Mean square of the base's angular velocity on the way, its root \[rad/s\].
    pub base_rate: f64,
    /// Turn of the base from start to arrival \[rad\].
    pub base_turn: f64,
    /// The least distances on the way.
    pub distances: Distances,
    /// Attitude of the base in I at the arrival.
    pub R_IB: UnitQuaternion<f64>,
    /// Coefficients of each joint's polynomial in `s`, from 0 to 1.
    polynomials: Vec<[f64; 6]>,
    bumps: DVector<f64>,
}

impl Plan {
    /// Position, rate and acceleration of joint `j` at `time` \[s\]. Afterwards it goes on as at the arrival.
    pub fn at(&self, j: usize, time: f64) -> JointPoint {
        point(
            &self.polynomials[j],
            self.bumps[j],
            (time - self.start) / (self.arrival - self.start),
            self.arrival - self.start,
        )
    }
}

fn point(c: &[f64; 6], bump: f64, s: f64, T: f64) -> JointPoint {
    let s = s.clamp(0.0, 1.0);
    let value = |c: &[f64]| c.iter().rev().fold(0.0, |sum, c| sum * s + c);
    let first: [f64; 5] = std::array::from_fn(|k| (k + 1) as f64 * c[k + 1]);
    let second: [f64; 4] = std::array::from_fn(|k| (k + 1) as f64 * first[k + 1]);
    let r = s * (1.0 - s);
    let (dr, ddr) = (1.0 - 2.0 * s, -2.0);
    let (b, db, ddb) = (
        r.powi(3),
        3.0 * r * r * dr,
        6.0 * r * dr * dr + 3.0 * r * r * ddr,
    );
    let bump = 64.0 * bump;
    JointPoint {
        position: value(c) + bump * b,
        rate: (value(&first) + bump * db) / T,
        acceleration: (value(&second) + bump * ddb) / (T * T),
    }
}

/// The polynomial with coefficients `c` at `s`, a part of `T` \[s\].
pub(super) fn quintic_at(c: &[f64; 6], s: f64, T: f64) -> JointPoint {
    point(c, 0.0, s, T)
}

/// Coefficients in `s` of the quintic between two points, `T` \[s\] apart.
pub(super) fn quintic(from: &JointPoint, to: &JointPoint, T: f64) -> [f64; 6] {
    let (v0, a0) = (from.rate * T, from.acceleration * T * T);
    let way = to.position - from.position - v0 - 0.5 * a0;
    let (rate, bend) = (to.rate * T - v0 - a0, to.acceleration * T * T - a0);
    [
        from.position,
        v0,
        0.5 * a0,
        10.0 * way - 4.0 * rate + 0.5 * bend,
        -15.0 * way + 7.0 * rate - bend,
        6.0 * way - 3.0 * rate + 0.5 * bend,
    ]
}

/// Joint motion at the arrival.
#[derive(Debug, Clone)]
struct End {
    q: DVector<f64>,
    qd: DVector<f64>,
    qdd: DVector<f64>,
}

/// A way with what it leads to.
struct Shot {
    polynomials: Vec<[f64; 6]>,
    R_IB: UnitQuaternion<f64>,
    error: Vector6<f64>,
    /// By how much rates and accelerations at the end of the way differ from those of `end`.
    rates_off: f64,
    end: End,
}

/// Plans rendezvous of one robot.
#[derive(Debug, Clone)]
pub struct RendezvousPlanner {
    model: Model,
    tip: Frame,
    clearance: Clearance,
    limits: JointLimitsShare,
    workspace: Workspace,
    jacobian: Matrix6xX<f64>,
    no_input: Input,
    free: DVector<f64>,
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
    fn duration(&self) -> f64 {
        self.arrival - self.start.state.time
    }
}

impl RendezvousPlanner {
    /// A planner for `tip` of a robot.
    pub fn new(
        model: &Model,
        tip: &Frame,
        clearance: Clearance,
        limits: JointLimitsShare,
    ) -> Self {
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

    /// Checks that the tip can go on to follow `goals`, frames at later times \[s\]: that the arm reaches them from one to the
    /// next, not faster than its limits and clear of singular postures. The base is where it is at the arrival.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn check_following(
        &mut self,
        plan: &Plan,
        goals: &[(f64, FrameMotion)],
    ) -> Result<(), PlanError> {
        let (mut q, mut time) = (plan.q.clone(), plan.arrival);
        for (at, goal) in goals {
            let before = q.clone();
            if !self.descend(&plan.R_IB, goal, &mut q) {
                let error = self.pose_error(&plan.R_IB, goal);
                return Err(PlanError::NotReached {
                    arrival: *at,
                    position: error.fixed_rows::<3>(0).norm(),
                    angle: error.fixed_rows::<3>(3).norm(),
                });
            }
            self.check_singular(&q, *at)?;
            for (j, joint) in self.model.joints().iter().enumerate() {
                let (value, limit) = ((q[j] - before[j]).abs() / (at - time), self.fastest(j));
                if value > limit {
                    return Err(PlanError::Joint {
                        joint: joint.name.clone(),
                        what: "rate",
                        value,
                        limit,
                    });
                }
            }
            time = *at;
        }
        Ok(())
    }

    fn check_singular(&mut self, q: &DVector<f64>, arrival: f64) -> Result<(), PlanError> {
        self.workspace.set_positions(q);
        self.workspace
            .generalized_jacobian(&self.tip, &mut self.jacobian);
        let value = self.jacobian.clone().singular_values().min();
        match self.jacobian.ncols() >= 6 && value < SINGULAR {
            true => Err(PlanError::Singular { arrival, value }),
            false => Ok(()),
        }
    }

    /// Largest rate of joint `j` in a plan.
    fn fastest(&self, j: usize) -> f64 {
        let limit = self.model.joints()[j].limits.velocity;
        match limit.is_finite() {
            true => limit * self.limits.velocity,
            false => self.limits.default_velocity,
        }
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
    fn descend(
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
    fn pose_error(&self, R_IB: &UnitQuaternion<f64>, goal: &FrameMotion) -> Vector6<f64> {
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
        let [linear, angular] = [0, 3].map(|k| {
            R_IB.inverse_transform_vector(&Vector3::from(twist_I.fixed_rows::<3>(k)))
        });
        let twist = DVector::from_iterator(6, linear.iter().chain(angular.iter()).copied());
        let J = DMatrix::from_fn(6, self.jacobian.ncols(), |r, c| self.jacobian[(r, c)]);
        let normal = &J * J.transpose() + DMatrix::identity(6, 6) * (damping * damping);
        Some(J.tr_mul(&normal.cholesky()?.solve(&twist)))
    }

    /// State of the robot in I at positions, rates and attitude of the base.
    fn state(&self, task: &Rendezvous, R_IB: UnitQuaternion<f64>, end: &End) -> State {
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
    fn turned(
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
                let moved = (&bumps + &step * share)
                    .map(|b: f64| b.clamp(-LARGEST_BUMP, LARGEST_BUMP));
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
    fn distances(
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

    /// The plan, if it respects the limits.
    fn checked(
        &mut self,
        task: &Rendezvous,
        shot: Shot,
        bumps: DVector<f64>,
    ) -> Result<Plan, PlanError> {
        let T = task.duration();
        self.check_singular(&shot.end.q, task.arrival)?;
        let mut distances = Distances {
            keep_out: f64::INFINITY,
            own: f64::INFINITY,
        };
        let mut R_IB = task.start.state.R_WB;
        let mut squares = 0.0;
        for piece in 0..PIECES {
            let (after, rate) = self.turned(task, (&shot.polynomials, &bumps), &R_IB, piece);
            R_IB = after;
            squares += rate.norm_squared() / PIECES as f64;
            let here = self.distances(task, &shot, &bumps, &R_IB, piece + 1);
            distances = distances.least(here);
            self.check_joints(task, &shot, &bumps, &R_IB, piece + 1)?;
        }
        let closest = [
            ("the keep-out sphere of the target", distances.keep_out),
            ("another part of the robot", distances.own - self.clearance.config().margin),
        ];
        if let Some((what, distance)) = closest.into_iter().find(|(_, d)| *d < 0.0) {
            return Err(PlanError::Clearance { what, distance });
        }
        let start = task.start.state.time;
        Ok(Plan {
            start,
            arrival: start + T,
            q: shot.end.q,
            base_rate: squares.sqrt(),
            base_turn: task.start.state.R_WB.angle_to(&R_IB),
            distances,
            R_IB,
            polynomials: shot.polynomials,
            bumps,
        })
    }

    /// Checks positions, rates, accelerations and efforts of the joints after a piece of the way.
    fn check_joints(
        &mut self,
        task: &Rendezvous,
        shot: &Shot,
        bumps: &DVector<f64>,
        R_IB: &UnitQuaternion<f64>,
        piece: usize,
    ) -> Result<(), PlanError> {
        let (s, T) = (piece as f64 / PIECES as f64, task.duration());
        let n = self.model.dof();
        let points: Vec<JointPoint> = (0..n)
            .map(|j| point(&shot.polynomials[j], bumps[j], s, T))
            .collect();
        let of = |value: fn(&JointPoint) -> f64| DVector::from_iterator(n, points.iter().map(value));
        let here = End {
            q: of(|p| p.position),
            qd: of(|p| p.rate),
            qdd: of(|p| p.acceleration),
        };
        let state = self.state(task, *R_IB, &here);
        self.workspace.set_positions(&state.q);
        self.workspace.set_motion(&state);
        (self.workspace).accelerations(&state, &self.no_input, &mut self.free);
        let added = &here.qdd - &self.free;
        let efforts = self.workspace.reduced_inertia() * added;
        for (j, joint) in self.model.joints().iter().enumerate() {
            let limits = &joint.limits;
            let exceeds = |what, value: f64, limit: f64| {
                (value > limit).then(|| PlanError::Joint {
                    joint: joint.name.clone(),
                    what,
                    value,
                    limit,
                })
            };
            let fastest = self.fastest(j);
            let violated = exceeds("position", here.q[j], limits.upper)
                .or(exceeds("position", -here.q[j], -limits.lower))
                .or(exceeds("rate", here.qd[j].abs(), fastest))
                .or(exceeds(
                    "acceleration",
                    here.qdd[j].abs(),
                    self.limits.acceleration,
                ))
                .or(exceeds(
                    "effort",
                    efforts[j].abs(),
                    limits.effort * self.limits.effort,
                ));
            if let Some(error) = violated {
                return Err(error);
            }
        }
        Ok(())
    }
}

/// How near to a plan a failure is.
fn rank(error: &PlanError) -> u8 {
    match error {
        PlanError::Unknown(_) => 0,
        PlanError::NotReached { .. } => 1,
        PlanError::Singular { .. } => 2,
        PlanError::Clearance { .. } => 3,
        PlanError::Joint { .. } => 4,
    }
}
