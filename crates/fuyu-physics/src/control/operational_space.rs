//! Control of one or several tips in operational space, with the tips' inertia on a free-floating robot.

use nalgebra::{DMatrix, DVector, Matrix6xX, UnitQuaternion, Vector3, Vector6};

use super::gains::{ConfigError, check_positive};
use super::prediction::TipPrediction;
use super::task_priority::{TASK_DAMPING, TaskPriority};
use super::{Law, LawConfig, LawError, LawInput, LawStatus, Manipulator, PoseError, Saturation};
use crate::dynamics::{Input, Momentum, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::Twist;

/// Which part of a tip's pose is controlled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TipTask {
    /// Position and attitude.
    #[default]
    Pose,
    /// Position only.
    Position,
    /// No control of the tip: the arm is free to control the base.
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

/// Control of the base's attitude, and its priority.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BaseTask {
    /// The attitude is not controlled.
    #[default]
    Free,
    /// Redundant joint motion, which the tips leave free, holds the attitude.
    AfterTips,
    /// The attitude is held; tips move in the reaction null space.
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
pub struct OperationalSpaceConfig {
    /// Natural frequency of the tips' and the base's deviations \[rad/s\].
    pub frequency: f64,
    /// Damping ratio of these deviations.
    pub damping_ratio: f64,
    /// Rate at which joint motion that no task uses decays \[1/s\]. Tasks drive such motion by centrifugal forces, so
    /// it must be larger than the joint rates.
    pub null_space_damping: f64,
    /// Largest joint rate \[rad/s or m/s\]: conflicting tasks would otherwise drive self-motion without bounds.
    pub max_joint_rate: f64,
    /// Singular value below which a direction of a task is damped, [`TaskPriority::damping`].
    pub task_damping: f64,
    /// Task of each tip; a tip beyond the end of the list has [`TipTask::Pose`].
    pub tips: Vec<TipTask>,
    /// Task of the base.
    pub base: BaseTask,
}

impl Default for OperationalSpaceConfig {
    fn default() -> Self {
        Self {
            frequency: 1.0,
            damping_ratio: 1.0,
            null_space_damping: 5.0,
            max_joint_rate: 1.0,
            task_damping: TASK_DAMPING,
            tips: Vec::new(),
            base: BaseTask::Free,
        }
    }
}

impl OperationalSpaceConfig {
    /// Refuses settings that are not positive and finite.
    ///
    /// # Errors
    /// [`ConfigError`] names the setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        check_positive("operational_space.frequency", self.frequency)?;
        check_positive("operational_space.damping_ratio", self.damping_ratio)?;
        check_positive(
            "operational_space.null_space_damping",
            self.null_space_damping,
        )?;
        check_positive("operational_space.max_joint_rate", self.max_joint_rate)?;
        check_positive("operational_space.task_damping", self.task_damping)
    }

    /// Task of the `k`th tip.
    fn tip_task(&self, k: usize) -> TipTask {
        self.tips.get(k).copied().unwrap_or_default()
    }

    /// Damping of the tip, `2 ζ ω` \[1/s\].
    pub fn damping(&self) -> f64 {
        2.0 * self.damping_ratio * self.frequency
    }
}

/// Rate at which a joint approaches its largest rate, and returns to it \[1/s\].
const RATE_LIMIT_GAIN: f64 = 20.0;

/// Largest deviation of the base's attitude without saturation \[rad\]: arms rotate a base slowly.
const MAX_BASE_ERROR: f64 = 0.02;

/// Resolved acceleration in operational space, for one arm or several and for redundant ones.
///
/// Efforts add `Ĵ Ĥ⁻¹ τ` to the acceleration `A_0` that a tip has without efforts (momentum, Coriolis terms,
/// springs: from forward dynamics). So that the deviation from a goal with twist `V_D` decays as
///
/// ```text
/// ë + 2 ζ ω ė + ω² ē = 0
/// ```
///
/// (attitude: to first order, `e_o` being the sine of the angle about its axis) the tip is given the acceleration `A =
/// A_D + 2 ζ ω (V_D - V_E) + ω² ē`, that is `Ĵ Ĥ⁻¹ τ = A - A_0`: resolved acceleration with the generalized Jacobian
/// (Y. Umetani and K. Yoshida, Resolved motion rate control of space manipulators with generalized Jacobian matrix,
/// IEEE Trans. Robotics and Automation 5, 1989), by the least efforts in the metric of the reduced inertia
/// ([`TaskPriority`]). The motion is exponentially stable where the rows of all tasks are independent. Unlike the
/// transpose law it needs correct masses, and near a singularity its efforts are bounded only by the damping.
///
/// The base has the angular acceleration `α = α_0 + H_A Ĥ⁻¹ τ` with `H_A` of eq. (4.23), so holding its attitude is a
/// task like any other. With a higher priority than the tips', it leaves them the joint motion that does not rotate the
/// base, the reaction null space of D. Nenchev, K. Yoshida and M. Uchiyama (CDC 1996). The task uses three joints; any
/// angular momentum of the robot must then remain in the arm, which never comes to rest.
#[derive(Debug, Clone)]
pub struct OperationalSpace {
    config: OperationalSpaceConfig,
    state: State,
    no_efforts: Input,
    /// Joint accelerations of the motion without efforts.
    free: DVector<f64>,
    /// Joint accelerations that the first task adds, and those that all tasks add.
    first: DVector<f64>,
    tasks: DVector<f64>,
    acceleration: DVector<f64>,
    jacobian: Matrix6xX<f64>,
    priority: TaskPriority,
    /// The same tasks in the metric of joint rates.
    rate_priority: TaskPriority,
    identity: DMatrix<f64>,
    /// Joint rates that no task uses; scratch of the rate limit.
    unused: DVector<f64>,
    /// Attitude of the base in I that is held.
    held_attitude: Option<UnitQuaternion<f64>>,
}

impl OperationalSpace {
    /// The law for a robot with one tip or several.
    pub fn new(config: OperationalSpaceConfig, manipulator: &Manipulator) -> Self {
        let n = manipulator.model.dof();
        let priority = TaskPriority::new(n, manipulator.tips().count() + 1);
        Self {
            config,
            state: State::at_rest(&manipulator.model),
            no_efforts: Input::zero(&manipulator.model),
            free: DVector::zeros(n),
            first: DVector::zeros(n),
            tasks: DVector::zeros(n),
            acceleration: DVector::zeros(n),
            jacobian: Matrix6xX::zeros(n),
            rate_priority: priority.clone(),
            priority,
            identity: DMatrix::identity(n, n),
            unused: DVector::zeros(n),
            held_attitude: None,
        }
    }

    /// Computes the motion without efforts, to which the tasks add.
    fn begin(&mut self, manipulator: &mut Manipulator, input: &LawInput<'_>) {
        let workspace = &mut manipulator.workspace;
        let turning = Twist::new(*input.w_IB_B, Vector3::zeros());
        self.state.q.copy_from(input.q);
        self.state.qd.copy_from(input.qd);
        self.state.momentum_W = Momentum {
            linear: Vector3::zeros(),
            angular: workspace.momentum_of(&turning, input.qd).angular,
        };
        workspace.set_motion(&self.state);
        workspace.accelerations(&self.state, &self.no_efforts, &mut self.free);
        workspace.set_accelerations(&self.free);
        self.priority.damping = self.config.task_damping;
        self.rate_priority.damping = self.config.task_damping;
        self.priority.begin(workspace.reduced_inertia());
        self.rate_priority.begin(&self.identity);
    }

    /// Adds the task of a tip: to follow its goal, or to come to rest without a goal.
    fn add_tip_task(
        &mut self,
        workspace: &Workspace,
        tip: &Frame,
        task: TipTask,
        goal: Option<&TipPrediction>,
        saturation: &Saturation,
    ) {
        if task == TipTask::Free {
            return;
        }
        let (V, A_0) = (workspace.V_WF_B(tip), workspace.A_WF_B(tip));
        let damping = self.config.damping();
        let mut A = (Twist::ZERO - V) * damping;
        if let Some(goal) = goal {
            let error = PoseError::between(&goal.X_BE, &goal.X_BD);
            let error = Twist::new(
                saturation.orientation_error(&error).0,
                saturation.position_error(&error).0,
            );
            A += goal.A_ID_B + goal.V_ID_B * damping + error * self.config.frequency.powi(2);
        }
        let Twist { linear, angular } = A - A_0;
        let mut acceleration = Vector6::zeros();
        acceleration.fixed_rows_mut::<3>(0).copy_from(&linear);
        workspace.generalized_jacobian(tip, &mut self.jacobian);
        if task == TipTask::Pose {
            acceleration.fixed_rows_mut::<3>(3).copy_from(&angular);
        } else {
            self.jacobian.fixed_rows_mut::<3>(3).fill(0.0);
        }
        self.priority.add(&self.jacobian, &acceleration);
        self.rate_priority.add(&self.jacobian, &Vector6::zeros());
    }

    /// Adds the task of the base: to hold its attitude.
    fn add_base_task(&mut self, model: &Model, workspace: &Workspace, input: &LawInput<'_>) {
        let held = *self.held_attitude.get_or_insert(*input.R_IB);
        let base = &model.frames()[0];
        let (w, A_0) = (input.w_IB_B, workspace.A_WF_B(base));
        let error = (input.R_IB.inverse() * held)
            .scaled_axis()
            .cap_magnitude(MAX_BASE_ERROR);
        let alpha = error * self.config.frequency.powi(2) - w * self.config.damping() - A_0.angular;
        workspace.base_map(&mut self.jacobian);
        self.jacobian.fixed_rows_mut::<3>(0).fill(0.0);
        let mut acceleration = Vector6::zeros();
        acceleration.fixed_rows_mut::<3>(3).copy_from(&alpha);
        self.priority.add(&self.jacobian, &acceleration);
        self.rate_priority.add(&self.jacobian, &Vector6::zeros());
    }

    /// Keeps every joint's rate within the largest one `f`: its acceleration is limited to the range from
    /// `-RATE_LIMIT_GAIN (f + q̇)` to `RATE_LIMIT_GAIN (f - q̇)`. The tasks after the first are scaled until all joints
    /// respect that, so that the first task is fulfilled; only the remaining excess is cut joint by joint.
    fn limit_rates(
        &mut self,
        workspace: &mut Workspace,
        rates: &DVector<f64>,
        efforts: &mut DVector<f64>,
    ) {
        let limit = self.config.max_joint_rate;
        let bounds = |rate: f64| {
            (
                -RATE_LIMIT_GAIN * (limit + rate),
                RATE_LIMIT_GAIN * (limit - rate),
            )
        };
        self.priority.accelerations(&mut self.unused);
        let Self {
            free,
            first,
            tasks,
            unused: all,
            ..
        } = self;
        let mut scale = 1.0f64;
        for (j, rate) in rates.iter().enumerate() {
            let (lower, upper) = bounds(*rate);
            let later = tasks[j] - first[j];
            let rest = free[j] + all[j] - later;
            let bound = if later > 0.0 { upper } else { lower };
            if later != 0.0 && (rest + later < lower || rest + later > upper) {
                scale = scale.min(((bound - rest) / later).max(0.0));
            }
        }
        let mut cut = false;
        for (j, rate) in rates.iter().enumerate() {
            let (lower, upper) = bounds(*rate);
            let total = free[j] + all[j];
            let scaled = total - (1.0 - scale) * (tasks[j] - first[j]);
            all[j] = scaled.max(lower).min(upper) - total;
            cut |= all[j] != 0.0;
        }
        if cut {
            efforts.gemv(1.0, workspace.reduced_inertia(), all, 1.0);
        }
    }
}

impl Law for OperationalSpace {
    fn efforts(
        &mut self,
        input: &LawInput<'_>,
        manipulator: &mut Manipulator,
        efforts: &mut DVector<f64>,
    ) -> Result<LawStatus, LawError> {
        if input.error.is_none() {
            return Ok(LawStatus::Inactive);
        }
        self.begin(manipulator, input);
        let base = self.config.base;
        if base == BaseTask::BeforeTips {
            self.add_base_task(&manipulator.model, &manipulator.workspace, input);
            self.priority.accelerations(&mut self.first);
        }
        let saturation = &input.gains.saturation;
        for (k, (tip, goal)) in manipulator.tips().zip(input.tips).enumerate() {
            let task = self.config.tip_task(k);
            self.add_tip_task(&manipulator.workspace, tip, task, goal.as_ref(), saturation);
            if k == 0 && base != BaseTask::BeforeTips {
                self.priority.accelerations(&mut self.first);
            }
        }
        if base == BaseTask::AfterTips {
            self.add_base_task(&manipulator.model, &manipulator.workspace, input);
        }
        self.priority.accelerations(&mut self.tasks);
        // Joint motion that no task uses decays. It is computed in the metric of joint rates: in the metric of the
        // inertia, light wrists would do the work of heavy shoulders.
        self.unused.copy_from(input.qd);
        self.rate_priority.project_to_null_space(&mut self.unused);
        let inertia = manipulator.workspace.reduced_inertia();
        let rate = -self.config.null_space_damping;
        self.acceleration.gemv(rate, inertia, &self.unused, 0.0);
        self.priority.add_in_null_space(&self.acceleration);
        self.priority.efforts(efforts);
        self.limit_rates(&mut manipulator.workspace, input.qd, efforts);
        Ok(LawStatus::TipFeedback)
    }

    fn reset(&mut self) {
        self.held_attitude = None;
    }

    fn configure(&mut self, config: &LawConfig) -> bool {
        let LawConfig::OperationalSpace(config) = config else {
            return false;
        };
        if config.base != self.config.base {
            // Hold the present attitude from now on.
            self.held_attitude = None;
        }
        self.config.clone_from(config);
        true
    }

    fn joint_damping_fraction(&self) -> f64 {
        0.0
    }
}
