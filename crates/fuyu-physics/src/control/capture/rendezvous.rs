//! Rendezvous: joint motions of a free-floating robot that bring its tip to a moving frame at zero relative twist.
//!
//! Joints follow quintic polynomials from their present position, rate and acceleration to those at the arrival, plus
//! bumps `a_j 64 s³ (1 - s)³`, which change the path but not its ends. The base turns by the conservation of momentum
//! (Masutani 1995 eq. (4.23) with the momentum term), so its pose at the arrival depends on the whole path. The joint
//! positions at the arrival are found by shooting: Newton's method on the tip's pose. The joint rates and accelerations
//! there follow from twist and acceleration of the goal by the generalized Jacobian. The bumps are chosen by the
//! Gauss-Newton method so that the base turns least and clearances are kept.

use nalgebra::{DVector, Matrix6xX, Vector3};

use super::clearance::Clearance;
use super::frame_motion::FrameMotion;
use super::plan::{
    JointLimitsShare, Objective, Plan, PlanError, Reserve, Start, quintic, quintic_at, rank,
};
use super::shooting::End;
use crate::control::commander::JointPoint;
use crate::dynamics::{Input, Workspace};
use crate::model::{Frame, Model};

/// Plans rendezvous of one robot.
#[derive(Debug, Clone)]
pub struct RendezvousPlanner {
    pub(super) model: Model,
    pub(super) tip: Frame,
    pub(super) clearance: Clearance,
    pub(super) limits: JointLimitsShare,
    pub(super) objective: Objective,
    /// Approach axis: a unit vector in the tip's frame.
    pub(super) approach_axis: Vector3<f64>,
    pub(super) workspace: Workspace,
    pub(super) jacobian: Matrix6xX<f64>,
    pub(super) no_input: Input,
    pub(super) free: DVector<f64>,
}

/// The requested rendezvous.
#[derive(Debug, Clone, Copy)]
pub struct Rendezvous<'a> {
    /// The start.
    pub start: &'a Start,
    /// Time of the arrival \[s\].
    pub arrival: f64,
    /// Motion at the arrival, in I, of the frame with which the tip's frame is to coincide.
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
            objective: Objective::BaseReaction,
            approach_axis: Vector3::x(),
            workspace: Workspace::new(model),
            jacobian: Matrix6xX::zeros(model.dof()),
            no_input: Input::zero(model),
            free: DVector::zeros(model.dof()),
        }
    }

    /// The same planner with another objective, and the tip's direction of motion after the arrival, in the tip's frame
    /// (default `x`).
    #[must_use]
    pub fn with_objective(mut self, objective: Objective, approach_axis: &Vector3<f64>) -> Self {
        self.objective = objective;
        self.approach_axis = approach_axis.normalize();
        self
    }

    /// The motion that reaches the rendezvous and is best by the objective, among motions to several postures at the
    /// arrival; each turns the base as little as its posture allows.
    ///
    /// # Errors
    /// [`PlanError`] of the path that came closest to a feasible plan.
    pub fn plan(&mut self, task: &Rendezvous) -> Result<Plan, PlanError> {
        let straight = DVector::zeros(self.model.dof());
        let mut best: Option<Plan> = None;
        let mut failure: Option<PlanError> = None;
        for end in self.postures(task) {
            let found = self.shoot(task, end, &straight);
            let shaped = found.and_then(|shot| self.shaped(task, shot));
            match shaped {
                Ok(plan) => {
                    let cost = plan.cost(self.objective);
                    if best.as_ref().is_none_or(|b| cost < b.cost(self.objective)) {
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
        best.ok_or_else(|| failure.unwrap_or(PlanError::NoPosture(task.arrival)))
    }

    /// Plans again while an earlier plan is followed. At half of the remaining time the joints have the positions of
    /// the earlier plan; the search for the joint positions at the arrival starts at those of the earlier plan.
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
        // A bump is 1 at the middle of the path.
        let T = task.duration();
        let middle = task.arrival - 0.5 * T;
        let bumps = DVector::from_fn(n, |j, _| {
            let last = earlier.at(j, earlier.arrival);
            let straight = quintic_at(&quintic(&task.start.joints[j], &last, T), 0.5, T);
            earlier.at(j, middle).position - straight.position
        });
        let shot = self.shoot(task, end, &bumps)?;
        self.checked(task, shot, bumps, Reserve::NONE)
    }
}
