//! Resolver: joint rates for a twist of the tip, with the least reaction on the base.

use nalgebra::{DMatrix, DVector, Matrix6xX, Vector3, Vector6};

use super::pose_path::PathFrame;
use crate::control::resolved_rate::Principal;
use crate::control::task_priority::{Rows, TaskPriority};
use crate::dynamics::{Momentum, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::{Pose, Twist};

/// Singular values, for Jacobian rows of unit length, below which a direction is damped: for the tip's motion, and for
/// the base's reaction. The latter is damped earlier, where reactionless joint motion would have to be fast.
const DAMPING: (f64, f64) = (0.02, 0.1);
/// Distance from a position limit at which a joint no longer moves towards it \[rad or m\].
const MARGIN: f64 = 0.01;

/// Which part of the tip's motion is prescribed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum KeptTip {
    /// Position and attitude.
    #[default]
    Pose,
    /// Position only: leaves three redundant degrees of freedom to an arm with six joints.
    Position,
}

/// Redundant joint motion, which the tip leaves free.
#[derive(Debug, Clone, Copy)]
pub struct FreeMotion<'a> {
    /// Desired joint rates, which are approached as far as the tasks allow.
    pub preferred: &'a DVector<f64>,
    /// Joint rates of the previous step.
    pub before: &'a DVector<f64>,
    /// The fraction of the base's angular velocity due to `before` that is kept in a task of least reaction, so that a
    /// motion that starts with more of it does not jump.
    pub faded: f64,
}

/// Resolves twists of the tip into joint rates: first the tip's motion; then, if requested, the least angular velocity
/// of the base; then the joint rates nearest to given ones.
///
/// The tasks are `J q̇ = v`, with the generalized Jacobian (Masutani 1995 eq. (4.34)) for motion in inertial space and
/// the fixed-base Jacobian for motion relative to the base, and `H_A q̇ = 0` with the angular rows of the base map, eq.
/// (4.23): joint motion in the null space of this coupling does not turn the base (the reaction null space; D. Nenchev,
/// K. Yoshida and M. Uchiyama, Reaction null-space based control of flexible structure mounted manipulator systems, CDC
/// 1996). Each task is solved by least squares in the null space of the previous ones ([`TaskPriority`], here in the
/// metric of joint rates); the reactionless motion is damped where it would be too fast. Momentum of the robot is taken
/// into account. Joints at a position limit take no part in motion that would lead them beyond it.
#[derive(Debug, Clone)]
pub struct TipResolver {
    tip: Frame,
    kept: KeptTip,
    least_reaction: bool,
    avoids_limits: bool,
    model: Model,
    workspace: Workspace,
    identity: DMatrix<f64>,
    priority: TaskPriority,
    /// Joint rates for the tip's motion alone.
    first: DVector<f64>,
    jacobian: Matrix6xX<f64>,
    base_map: Matrix6xX<f64>,
    rows: Rows,
    preferred: DVector<f64>,
    /// Wanted angular velocity of the base, in the first three elements \[rad/s\].
    base_rate: Vector6<f64>,
    zero: DVector<f64>,
    blocked: Vec<bool>,
}

impl TipResolver {
    /// A resolver for the frame `tip`. With `least_reaction`, joint motion that `kept` leaves free turns the base as
    /// little as possible.
    pub fn new(model: &Model, tip: &Frame, kept: KeptTip, least_reaction: bool) -> Self {
        let n = model.dof();
        Self {
            tip: tip.clone(),
            kept,
            least_reaction,
            avoids_limits: true,
            workspace: Workspace::new(model),
            identity: DMatrix::identity(n, n),
            priority: TaskPriority::new(n, 2),
            first: DVector::zeros(n),
            jacobian: Matrix6xX::zeros(n),
            base_map: Matrix6xX::zeros(n),
            rows: Rows::zeros(n),
            preferred: DVector::zeros(n),
            base_rate: Vector6::zeros(),
            zero: DVector::zeros(n),
            blocked: vec![false; n],
            model: model.clone(),
        }
    }

    /// The same resolver, but joints at a position limit still take part: the caller must slow them down.
    pub fn without_limits(mut self) -> Self {
        self.avoids_limits = false;
        self
    }

    /// The prescribed part of the tip's motion.
    pub fn kept(&self) -> KeptTip {
        self.kept
    }

    /// Pose of the tip in the base frame at joint positions `q`.
    pub fn X_BE(&mut self, q: &DVector<f64>) -> Pose {
        self.workspace.set_positions(q);
        self.workspace.X_BF(&self.tip)
    }

    /// Pose of `frame` in the base frame at joint positions `q`.
    pub fn X_BF(&mut self, q: &DVector<f64>, frame: &Frame) -> Pose {
        self.workspace.set_positions(q);
        self.workspace.X_BF(frame)
    }

    /// Twist of the tip's origin, base axes, for joint `rates` at positions `q`: relative to the base, or in inertial
    /// space with the momentum `momentum_B`.
    pub fn twist(
        &mut self,
        q: &DVector<f64>,
        rates: &DVector<f64>,
        frame: PathFrame,
        momentum_B: &Momentum,
    ) -> Twist {
        let drift = self.set(q, frame, momentum_B);
        let V = &self.jacobian * rates + drift;
        let part = |i: usize| Vector3::from(V.fixed_rows::<3>(i));
        Twist::new(part(3), part(0))
    }

    /// Ratio of the largest singular value of the Jacobian to its smallest at positions `q`; angular rows are scaled by
    /// 1 m. Infinite in a singular position. With fewer than six joints, only the tip's motion within their reach
    /// counts.
    pub fn condition(&mut self, q: &DVector<f64>, frame: PathFrame) -> f64 {
        self.set(q, frame, &Momentum::default());
        if self.kept == KeptTip::Position {
            self.jacobian.fixed_rows_mut::<3>(3).fill(0.0);
        }
        let tasks = match self.kept {
            KeptTip::Pose => 6,
            KeptTip::Position => 3,
        };
        let principal = Principal::of(&self.jacobian);
        let least = principal.weakest(tasks.min(self.model.dof()));
        principal.weakest(1) / least
    }

    /// Sets the Jacobian at positions `q`; returns the twist of the tip (linear part first) for joints at rest.
    fn set(&mut self, q: &DVector<f64>, frame: PathFrame, momentum_B: &Momentum) -> Vector6<f64> {
        let workspace = &mut self.workspace;
        workspace.set_positions(q);
        match frame {
            PathFrame::Base => {
                workspace.fixed_base_jacobian(&self.tip, &mut self.jacobian);
                Vector6::zeros()
            }
            PathFrame::World => {
                workspace.generalized_jacobian(&self.tip, &mut self.jacobian);
                let V_WB_B = workspace.base_twist(momentum_B, &self.zero);
                let p = workspace.X_BF(&self.tip).translation.vector;
                let (v, w) = (V_WB_B.linear + V_WB_B.angular.cross(&p), V_WB_B.angular);
                Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
            }
        }
    }

    /// Writes joint rates \[rad/s or m/s\] at positions `q` for the twist `V_B` of the tip's origin (base axes; in
    /// inertial space or relative to the base), for a robot with the momentum `momentum_B`.
    pub fn rates(
        &mut self,
        q: &DVector<f64>,
        frame: PathFrame,
        momentum_B: &Momentum,
        V_B: &Twist,
        free: FreeMotion<'_>,
        rates: &mut DVector<f64>,
    ) {
        let drift = self.set(q, frame, momentum_B);
        if self.least_reaction {
            self.workspace.base_map(&mut self.base_map);
            let w_B = self.base_map.fixed_rows::<3>(3) * free.before * free.faded;
            self.base_rate.fixed_rows_mut::<3>(0).copy_from(&w_B);
        }
        let (v, w) = (&V_B.linear, &V_B.angular);
        let mut wanted = Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z) - drift;
        if self.kept == KeptTip::Position {
            self.jacobian.fixed_rows_mut::<3>(3).fill(0.0);
            wanted.fixed_rows_mut::<3>(3).fill(0.0);
        }
        self.blocked.fill(false);
        // Every pass except the last blocks a joint.
        for _ in 0..=q.len() {
            self.solve(&wanted, free.preferred, rates);
            if !self.avoids_limits || !self.block(q, rates) {
                return;
            }
        }
    }

    fn solve(&mut self, wanted: &Vector6<f64>, preferred: &DVector<f64>, rates: &mut DVector<f64>) {
        self.priority.begin(&self.identity);
        self.rows.copy_from(&self.jacobian);
        self.clear_blocked();
        self.priority.damping = DAMPING.0;
        self.priority.add(&self.rows, wanted);
        self.priority.accelerations(&mut self.first);
        if self.least_reaction {
            self.rows.fill(0.0);
            (self.rows.fixed_rows_mut::<3>(0)).copy_from(&self.base_map.fixed_rows::<3>(3));
            self.clear_blocked();
            self.priority.damping = DAMPING.1;
            self.priority.add(&self.rows, &self.base_rate);
        }
        self.preferred.copy_from(preferred);
        for (rate, blocked) in self.preferred.iter_mut().zip(&self.blocked) {
            if *blocked {
                *rate = 0.0;
            }
        }
        self.priority.add_in_null_space(&self.preferred);
        self.priority.accelerations(rates);
        self.limit_free_motion(rates);
    }

    /// Scales redundant motion so that no joint exceeds its rate limit.
    fn limit_free_motion(&self, rates: &mut DVector<f64>) {
        let mut part: f64 = 1.0;
        for (j, joint) in self.model.joints().iter().enumerate() {
            let (first, limit) = (self.first[j], joint.limits.velocity);
            let free = rates[j] - first;
            if rates[j].abs() > limit && free != 0.0 {
                part = part.min((limit.copysign(free) - first) / free);
            }
        }
        let part = part.max(0.0);
        for (rate, first) in rates.iter_mut().zip(&self.first) {
            *rate = first + part * (*rate - first);
        }
    }

    fn clear_blocked(&mut self) {
        for (mut column, blocked) in self.rows.column_iter_mut().zip(&self.blocked) {
            if *blocked {
                column.fill(0.0);
            }
        }
    }

    /// Blocks the joints at a limit that `rates` would lead beyond it. Returns whether an additional joint was blocked.
    fn block(&mut self, q: &DVector<f64>, rates: &DVector<f64>) -> bool {
        let mut is_changed = false;
        for (j, joint) in self.model.joints().iter().enumerate() {
            let limits = &joint.limits;
            let margin = MARGIN.min(0.1 * (limits.upper - limits.lower));
            let outwards = q[j] > limits.upper - margin && rates[j] > 0.0
                || q[j] < limits.lower + margin && rates[j] < 0.0;
            if outwards && !self.blocked[j] {
                self.blocked[j] = true;
                is_changed = true;
            }
        }
        is_changed
    }
}
