//! Control of one tip or several in operational space, with the inertia that they have on a free-floating robot.

use nalgebra::{DVector, Matrix6xX, UnitQuaternion, Vector3, Vector6};

use super::prediction::Predicted;
use super::{GainError, PoseError, Saturation, TaskPriority, check_positive};
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
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OperationalGains {
    /// Natural frequency of the tips' deviations, and of the base's \[rad/s\].
    pub frequency: f64,
    /// Damping ratio of the same.
    pub damping_ratio: f64,
    /// Rate at which joint motion dies out that no task has use of \[1/s\].
    pub null_space_damping: f64,
    /// Saturation of the deviations.
    pub saturation: Saturation,
}

impl Default for OperationalGains {
    fn default() -> Self {
        Self {
            frequency: 1.0,
            damping_ratio: 1.0,
            null_space_damping: 0.5,
            saturation: Saturation {
                position: 0.2,
                orientation: 0.2,
            },
        }
    }
}

impl OperationalGains {
    /// Refuses gains that do not make a stable motion.
    ///
    /// # Errors
    /// [`GainError`] names the gain.
    pub fn check(&self) -> Result<(), GainError> {
        check_positive("frequency", self.frequency)?;
        check_positive("damping_ratio", self.damping_ratio)?;
        check_positive("null_space_damping", self.null_space_damping)?;
        self.saturation.check()
    }
}

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
    /// Gains; may change between calls.
    pub gains: OperationalGains,
    /// What each tip is to do; may change between calls.
    pub tasks: Vec<TipTask>,
    /// What the base is to do; may change between calls, after [`OperationalSpace::set_base_task`].
    base: BaseTask,
    tips: Vec<Frame>,
    state: State,
    still: Input,
    acceleration: DVector<f64>,
    jacobian: Matrix6xX<f64>,
    priority: TaskPriority,
    /// Attitude of the base in I that is to be held.
    held: Option<UnitQuaternion<f64>>,
}

/// The robot as it knows itself.
#[derive(Debug, Clone, Copy)]
pub struct Robot<'a> {
    /// Joint positions \[rad or m\].
    pub q: &'a DVector<f64>,
    /// Joint rates \[rad/s or m/s\].
    pub qd: &'a DVector<f64>,
    /// Angular velocity of the base, base axes \[rad/s\].
    pub w_IB_B: &'a Vector3<f64>,
    /// Attitude of the base in I ([`super::prediction::BaseMotion`]).
    pub R_IB: &'a UnitQuaternion<f64>,
}

impl OperationalSpace {
    /// The law for `model` with its tips, each to hold its pose.
    ///
    /// # Errors
    /// [`GainError`] as [`OperationalGains::check`].
    pub fn new(model: &Model, tips: &[Frame], gains: OperationalGains) -> Result<Self, GainError> {
        gains.check()?;
        let n = model.dof();
        Ok(Self {
            gains,
            tasks: vec![TipTask::Pose; tips.len()],
            base: BaseTask::Free,
            tips: tips.to_vec(),
            state: State::at_rest(model),
            still: Input::zero(model),
            acceleration: DVector::zeros(n),
            jacobian: Matrix6xX::zeros(n),
            priority: TaskPriority::new(n, tips.len() + 1),
            held: None,
        })
    }

    /// Says what the base is to do; the attitude to hold is the one of the next call.
    pub fn set_base_task(&mut self, base: BaseTask) {
        if base != self.base {
            self.held = None;
        }
        self.base = base;
    }

    /// Writes joint efforts \[N m or N\] for goals, one for each tip; a tip without one is braked. `workspace` is scratch.
    ///
    /// # Panics
    /// If there is not one goal entry per tip.
    pub fn efforts(
        &mut self,
        model: &Model,
        workspace: &mut Workspace,
        robot: &Robot,
        goals: &[Option<Predicted>],
        efforts: &mut DVector<f64>,
    ) {
        assert_eq!(goals.len(), self.tips.len(), "one goal per tip");
        workspace.set_positions(model, robot.q);
        let turning = Twist::new(*robot.w_IB_B, Vector3::zeros());
        self.state.q.copy_from(robot.q);
        self.state.qd.copy_from(robot.qd);
        self.state.R_WB = UnitQuaternion::identity();
        self.state.momentum_W = Momentum {
            linear: Vector3::zeros(),
            angular: workspace.momentum_of(&turning, robot.qd).angular,
        };
        workspace.set_motion(&self.state);
        workspace.accelerations(model, &self.state, &self.still, &mut self.acceleration);
        workspace.set_accelerations(&self.acceleration);
        self.priority.begin(workspace.reduced_inertia());
        if self.base == BaseTask::BeforeTips {
            self.hold_base(model, workspace, robot);
        }
        for (k, goal) in goals.iter().enumerate() {
            self.steer(workspace, k, goal.as_ref());
        }
        if self.base == BaseTask::AfterTips {
            self.hold_base(model, workspace, robot);
        }
        // Efforts in proportion to momentum let all joint motion die out alike.
        let inertia = workspace.reduced_inertia();
        let rate = -self.gains.null_space_damping;
        self.acceleration.gemv(rate, inertia, robot.qd, 0.0);
        self.priority.add_in_null_space(&self.acceleration);
        self.priority.efforts(efforts);
    }

    fn steer(&mut self, workspace: &Workspace, k: usize, goal: Option<&Predicted>) {
        let (task, tip) = (self.tasks[k], &self.tips[k]);
        if task == TipTask::Free {
            return;
        }
        let (V, A_0) = (workspace.V_WF_B(tip), workspace.A_WF_B(tip));
        let OperationalGains {
            frequency,
            damping_ratio,
            saturation,
            ..
        } = &self.gains;
        let brake = 2.0 * damping_ratio * frequency;
        let mut A = (Twist::ZERO - V) * brake;
        if let Some(goal) = goal {
            let error = PoseError::between(&goal.X_BE, &goal.X_BD);
            let pull = Twist::new(
                saturation.orientation_error(&error).0,
                saturation.position_error(&error).0,
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
    }

    fn hold_base(&mut self, model: &Model, workspace: &Workspace, robot: &Robot) {
        let held = *self.held.get_or_insert(*robot.R_IB);
        let base = &model.frames()[0];
        let (w, A_0) = (robot.w_IB_B, workspace.A_WF_B(base));
        let off = (robot.R_IB.inverse() * held).scaled_axis();
        let OperationalGains {
            frequency,
            damping_ratio,
            ..
        } = self.gains;
        let alpha = off * frequency.powi(2) - w * (2.0 * damping_ratio * frequency) - A_0.angular;
        workspace.base_map(model, &mut self.jacobian);
        self.jacobian.fixed_rows_mut::<3>(0).fill(0.0);
        let mut wanted = Vector6::zeros();
        wanted.fixed_rows_mut::<3>(3).copy_from(&alpha);
        self.priority.add(&self.jacobian, &wanted);
    }
}
