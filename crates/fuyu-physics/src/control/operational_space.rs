//! Control of one tip or several in operational space, with the inertia that they have on a free-floating robot.

use nalgebra::{DMatrix, DVector, Matrix6xX, UnitQuaternion, Vector3, Vector6};

use super::gains::check_positive;
use super::prediction::Predicted;
use super::{
    ControlReport, ControllerConfig, GainError, Law, LawError, Manipulator, Measurement, PoseError,
    Present, Saturation, TASK_DAMPING, TaskPriority,
};
use crate::dynamics::{Input, Momentum, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::Twist;

/// What of a tip's pose is to be held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TipTask {
    /// Position and attitude.
    #[default]
    Pose,
    /// Position alone.
    Position,
    /// Nothing: the arm is free to serve the base.
    Free,
}

impl TipTask {
    /// All by name.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("pose", Self::Pose),
        ("position", Self::Position),
        ("free", Self::Free),
    ];
}

/// How much it matters that the base does not turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BaseTask {
    /// It turns as it likes.
    #[default]
    Free,
    /// Joint motion that the tips leave free keeps the base from turning.
    AfterTips,
    /// The base does not turn; tips move in the reaction null space.
    BeforeTips,
}

impl BaseTask {
    /// All by name.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("free", Self::Free),
        ("after_tips", Self::AfterTips),
        ("before_tips", Self::BeforeTips),
    ];
}

/// Settings of [`OperationalSpace`].
#[derive(Debug, Clone, PartialEq)]
pub struct OperationalConfig {
    /// Natural frequency of the tips' deviations, and of the base's \[rad/s\].
    pub frequency: f64,
    /// Damping ratio of the same.
    pub damping_ratio: f64,
    /// Rate at which joint motion dies out that no task has use of \[1/s\]. Tasks drive such motion by
    /// centrifugal forces, so it must be larger than the joints are fast.
    pub null_space_damping: f64,
    /// Largest joint rate, whatever the tasks want \[rad/s or m/s\]: tasks that contradict each other otherwise drive
    /// self-motion without bounds.
    pub fastest: f64,
    /// Singular value below which a task's directions are damped, [`TaskPriority::damping`].
    pub task_damping: f64,
    /// What each tip is to do; a tip beyond the end holds its pose.
    pub tips: Vec<TipTask>,
    /// What the base is to do.
    pub base: BaseTask,
}

impl Default for OperationalConfig {
    fn default() -> Self {
        Self {
            frequency: 1.0,
            damping_ratio: 1.0,
            null_space_damping: 5.0,
            fastest: 1.0,
            task_damping: TASK_DAMPING,
            tips: Vec::new(),
            base: BaseTask::Free,
        }
    }
}

impl OperationalConfig {
    /// Refuses gains that do not make a stable motion.
    ///
    /// # Errors
    /// [`GainError`] names the gain.
    pub fn check(&self) -> Result<(), GainError> {
        check_positive("frequency", self.frequency)?;
        check_positive("damping_ratio", self.damping_ratio)?;
        check_positive("null_space_damping", self.null_space_damping)?;
        check_positive("fastest", self.fastest)?;
        check_positive("task_damping", self.task_damping)
    }
}

/// How fast a joint may approach its largest rate, and is brought back to it \[1/s\].
const BRAKE: f64 = 20.0;

/// Deviation of the base's attitude that acts in full \[rad\]: arms turn a base slowly.
const LARGEST_TURN: f64 = 0.02;

/// Resolved acceleration in operational space, for one arm or several and for redundant ones.
///
/// Efforts add `Ĵ Ĥ⁻¹ τ` to the acceleration `A_0` that a tip has when no effort acts (momentum, Coriolis terms,
/// springs: forward dynamics tells it). So that the deviation from a goal with twist `V_D` dies out as
///
/// ```text
/// ë + 2 ζ ω ė + ω² ē = 0
/// ```
///
/// (attitude: to first order, `e_o` being the sine of the angle about its axis) the tip is given
/// `A = A_D + 2 ζ ω (V_D - V_E) + ω² ē`, that is `Ĵ Ĥ⁻¹ τ = A - A_0`: resolved acceleration with the generalized Jacobian
/// (Y. Umetani and K. Yoshida, Resolved motion rate control of space manipulators with generalized Jacobian matrix,
/// IEEE Trans. Robotics and Automation 5, 1989), by efforts that are the least in the metric of the reduced inertia
/// ([`TaskPriority`]). The motion is exponentially stable where the rows of all tasks are independent; unlike the transpose law it
/// needs right masses, and takes efforts beyond all bounds near a singularity but for the damping.
///
/// The base turns by `α = α_0 + H_A Ĥ⁻¹ τ` with `H_A` of eq. (4.23), so to hold its attitude is a task as any other. Taken before
/// the tips' it leaves them the joint motion that does not turn the base, the reaction null space of D. Nenchev,
/// K. Yoshida and M. Uchiyama (CDC 1996). It takes three joints; angular momentum that the robot has must go
/// somewhere, so with it the arm moves on for ever.
#[derive(Debug, Clone)]
pub struct OperationalSpace {
    config: OperationalConfig,
    saturation: Saturation,
    state: State,
    still: Input,
    /// Joint accelerations of the motion without efforts.
    free: DVector<f64>,
    /// What the first task adds to that, and what all of them add.
    first: DVector<f64>,
    tasks: DVector<f64>,
    acceleration: DVector<f64>,
    jacobian: Matrix6xX<f64>,
    priority: TaskPriority,
    /// The same tasks as seen by joint rates, all of which count alike.
    rates: TaskPriority,
    one: DMatrix<f64>,
    idle: DVector<f64>,
    /// Attitude of the base in I that is to be held.
    held: Option<UnitQuaternion<f64>>,
}

impl OperationalSpace {
    /// The law for an arm, or for several.
    pub fn new(config: &ControllerConfig, arm: &Manipulator) -> Self {
        let n = arm.model.dof();
        let priority = TaskPriority::new(n, arm.tips().count() + 1);
        Self {
            config: config.operational.clone(),
            saturation: config.gains.saturation,
            state: State::at_rest(&arm.model),
            still: Input::zero(&arm.model),
            free: DVector::zeros(n),
            first: DVector::zeros(n),
            tasks: DVector::zeros(n),
            acceleration: DVector::zeros(n),
            jacobian: Matrix6xX::zeros(n),
            rates: priority.clone(),
            priority,
            one: DMatrix::identity(n, n),
            idle: DVector::zeros(n),
            held: None,
        }
    }

    /// What the `k`th tip is to do.
    fn task(&self, k: usize) -> TipTask {
        self.config.tips.get(k).copied().unwrap_or_default()
    }

    /// Sets up the free motion, beside which efforts act.
    fn prepare(&mut self, arm: &mut Manipulator, seen: &Measurement<'_>, now: &Present<'_>) {
        let Manipulator {
            model, workspace, ..
        } = arm;
        let turning = Twist::new(*now.w_IB_B, Vector3::zeros());
        self.state.q.copy_from(seen.q);
        self.state.qd.copy_from(seen.qd);
        self.state.momentum_W = Momentum {
            linear: Vector3::zeros(),
            angular: workspace.momentum_of(&turning, seen.qd).angular,
        };
        workspace.set_motion(&self.state);
        workspace.accelerations(model, &self.state, &self.still, &mut self.free);
        workspace.set_accelerations(&self.free);
        self.priority.damping = self.config.task_damping;
        self.rates.damping = self.config.task_damping;
        self.priority.begin(workspace.reduced_inertia());
        self.rates.begin(&self.one);
    }
    /// A tip is to follow its goal; one without is braked.
    fn steer(
        &mut self,
        workspace: &Workspace,
        tip: &Frame,
        task: TipTask,
        goal: Option<&Predicted>,
    ) {
        if task == TipTask::Free {
            return;
        }
        let (V, A_0) = (workspace.V_WF_B(tip), workspace.A_WF_B(tip));
        let OperationalConfig {
            frequency,
            damping_ratio,
            ..
        } = &self.config;
        let brake = 2.0 * damping_ratio * frequency;
        let mut A = (Twist::ZERO - V) * brake;
        if let Some(goal) = goal {
            let error = PoseError::between(&goal.X_BE, &goal.X_BD);
            let pull = Twist::new(
                self.saturation.orientation_error(&error).0,
                self.saturation.position_error(&error).0,
            );
            A += goal.A_ID_B + goal.V_ID_B * brake + pull * frequency.powi(2);
        }
        let Twist { linear, angular } = A - A_0;
        let mut wanted = Vector6::zeros();
        wanted.fixed_rows_mut::<3>(0).copy_from(&linear);
        workspace.generalized_jacobian(tip, &mut self.jacobian);
        if task == TipTask::Pose {
            wanted.fixed_rows_mut::<3>(3).copy_from(&angular);
        } else {
            self.jacobian.fixed_rows_mut::<3>(3).fill(0.0);
        }
        self.priority.add(&self.jacobian, &wanted);
        self.rates.add(&self.jacobian, &Vector6::zeros());
    }

    /// Keeps every joint's rate within the largest one `f`: of the acceleration that motion and tasks come to it gets what lies
    /// within `-BRAKE (f + q̇)` and `BRAKE (f - q̇)`. The tasks after the first are shortened until all joints keep to that,
    /// so that the first one is served; only what is still too much is cut joint by joint.
    fn limit(&mut self, workspace: &mut Workspace, rates: &DVector<f64>, pull: &mut DVector<f64>) {
        let fastest = self.config.fastest;
        let bounds = |rate: f64| (-BRAKE * (fastest + rate), BRAKE * (fastest - rate));
        self.priority.accelerations(&mut self.idle);
        let Self {
            free,
            first,
            tasks,
            idle: all,
            ..
        } = self;
        let mut share = 1.0f64;
        for (j, rate) in rates.iter().enumerate() {
            let (least, most) = bounds(*rate);
            let later = tasks[j] - first[j];
            let rest = free[j] + all[j] - later;
            let bound = if later > 0.0 { most } else { least };
            if later != 0.0 && (rest + later < least || rest + later > most) {
                share = share.min(((bound - rest) / later).max(0.0));
            }
        }
        let mut cut = false;
        for (j, rate) in rates.iter().enumerate() {
            let (least, most) = bounds(*rate);
            let wanted = free[j] + all[j];
            let shortened = wanted - (1.0 - share) * (tasks[j] - first[j]);
            all[j] = shortened.max(least).min(most) - wanted;
            cut |= all[j] != 0.0;
        }
        if cut {
            pull.gemv(1.0, workspace.reduced_inertia(), all, 1.0);
        }
    }

    /// The base is to keep its attitude.
    fn hold_base(&mut self, model: &Model, workspace: &Workspace, robot: &Present<'_>) {
        let held = *self.held.get_or_insert(*robot.R_IB);
        let base = &model.frames()[0];
        let (w, A_0) = (robot.w_IB_B, workspace.A_WF_B(base));
        let off = (robot.R_IB.inverse() * held)
            .scaled_axis()
            .cap_magnitude(LARGEST_TURN);
        let OperationalConfig {
            frequency,
            damping_ratio,
            ..
        } = self.config;
        let alpha = off * frequency.powi(2) - w * (2.0 * damping_ratio * frequency) - A_0.angular;
        workspace.base_map(model, &mut self.jacobian);
        self.jacobian.fixed_rows_mut::<3>(0).fill(0.0);
        let mut wanted = Vector6::zeros();
        wanted.fixed_rows_mut::<3>(3).copy_from(&alpha);
        self.priority.add(&self.jacobian, &wanted);
        self.rates.add(&self.jacobian, &Vector6::zeros());
    }
}

impl Law for OperationalSpace {
    fn configure(&mut self, config: &ControllerConfig) {
        if config.operational.base != self.config.base {
            // The attitude to hold is the one of now.
            self.held = None;
        }
        self.config.clone_from(&config.operational);
        self.saturation = config.gains.saturation;
    }

    fn joint_damping(&self) -> f64 {
        0.0
    }

    fn seeks_the_goal(&self) -> bool {
        false
    }

    fn efforts(
        &mut self,
        arm: &mut Manipulator,
        seen: &Measurement<'_>,
        pull: &mut DVector<f64>,
    ) -> Result<ControlReport, LawError> {
        let mut report = ControlReport::on(seen);
        let Some(now) = &seen.present else {
            return Ok(report);
        };
        if report.saturate(&self.saturation).is_none() {
            return Ok(report);
        }
        self.prepare(arm, seen, now);
        if self.config.base == BaseTask::BeforeTips {
            self.hold_base(&arm.model, &arm.workspace, now);
            self.priority.accelerations(&mut self.first);
        }
        for (k, (tip, goal)) in arm.tips().zip(now.goals).enumerate() {
            self.steer(&arm.workspace, tip, self.task(k), goal.as_ref());
            if k == 0 && self.config.base != BaseTask::BeforeTips {
                self.priority.accelerations(&mut self.first);
            }
        }
        if self.config.base == BaseTask::AfterTips {
            self.hold_base(&arm.model, &arm.workspace, now);
        }
        self.priority.accelerations(&mut self.tasks);
        // Joint motion that moves none of these dies out. It is told by rates, all of which count alike: in the metric
        // of the inertia light wrists would do what heavy shoulders should.
        self.idle.copy_from(seen.qd);
        self.rates.take_off(&mut self.idle);
        let inertia = arm.workspace.reduced_inertia();
        let rate = -self.config.null_space_damping;
        self.acceleration.gemv(rate, inertia, &self.idle, 0.0);
        self.priority.add_in_null_space(&self.acceleration);
        self.priority.efforts(pull);
        self.limit(&mut arm.workspace, seen.qd, pull);
        Ok(report)
    }
}
