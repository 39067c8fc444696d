//! The simulated robot: rigid, or with flexible parts, wheels and thrusters.

use nalgebra::{DVector, Isometry3};

use super::{
    contact_system::ContactSystem,
    flexible_robot::FlexibleRobot,
    free_body::{FreeBody, Restorable, in_world, try_to_move},
    loops::LoopParams,
    params::{DynamicsParams, joint_vector},
    rigid_robot::RigidRobot,
};
use crate::{
    control::commander::BaseState,
    dynamics::{
        Floating, FormulationKind, Input, IntegrationMethod, JointPhysics, Loops, Momentum, State,
        capture::{CaptureError, Grasp, ReleaseSpring},
        flexible::{FlexibleFloating, FlexibleInput, FlexibleState},
    },
    model::{Frame, Model},
    nodes::{choice, geometry::with_matrix},
    spatial::{Pose, Twist},
};

/// The robot with its state, integrated under held efforts. A rigid robot has its own integrator, which is faster and
/// simulates closed loops, friction, stops and contact.
pub enum Robot {
    /// A tree of rigid bodies, possibly with closed loops; may hold a target.
    Rigid(Box<RigidRobot>),
    /// A tree with deformable bodies, elastic joints, wheels or thrusters; may hold a target if nothing on it is
    /// deformable or elastic.
    Flexible(Box<FlexibleRobot>),
}

/// Complete state of the robot.
#[derive(Clone)]
pub enum RobotState {
    /// State of a rigid robot.
    Rigid(State),
    /// State of a robot with flexible parts, wheels or thrusters.
    Flexible(FlexibleState),
}

impl From<Floating> for Robot {
    fn from(robot: Floating) -> Self {
        Self::Rigid(Box::new(RigidRobot::new(robot)))
    }
}

impl From<FlexibleFloating> for Robot {
    fn from(robot: FlexibleFloating) -> Self {
        Self::Flexible(Box::new(FlexibleRobot::new(robot)))
    }
}

impl Robot {
    /// The robot of `model` in its initial state, as configured by the parameters.
    ///
    /// # Errors
    /// A line that names the parameter.
    pub fn new(params: &DynamicsParams, model: &Model) -> Result<Self, String> {
        let q = &params.initial_joint_positions;
        let mut state = State::at_rest_with(
            model,
            &joint_vector("initial_joint_positions", q, model.dof())?,
        );
        let qd = &params.initial_joint_velocities;
        state.qd = joint_vector("initial_joint_velocities", qd, model.dof())?;
        match params.flexible.is_empty() {
            true => Self::rigid_at(params, model, state),
            false => Self::flexible_at(params, model, &state),
        }
    }

    fn rigid_at(params: &DynamicsParams, model: &Model, mut state: State) -> Result<Self, String> {
        let mut loops: Loops =
            LoopParams::loops(&params.loop_closures, model).map_err(|e| e.to_string())?;
        (loops.assemble(&mut state, params.loop_tolerance)).map_err(|e| e.to_string())?;
        params.base.place(model, &mut state);
        let robot = Floating::with_loops(loops, state, params.method);
        let robot = robot.with_joint_physics(&params.joint_physics);
        let robot = robot.with_formulation(params.formulation).map_err(|e| {
            let name = choice::name_of(&FormulationKind::NAMES, &params.formulation);
            format!("parameter formulation is '{name}': {e}")
        })?;
        Ok(robot.into())
    }

    fn flexible_at(params: &DynamicsParams, model: &Model, joints: &State) -> Result<Self, String> {
        let system = params.flexible.system(model)?;
        let step = params.longest_step();
        (system.check_step(&joints.q, params.method, step))
            .map_err(|e| format!("parameter time_step is {}: {e}", params.time_step))?;
        let mut state = params.flexible.start(&system, joints);
        let mut robot = FlexibleFloating::new(&system, state.clone(), params.method);
        let (X_WB, V_WB_B) = params.base.motion();
        let mut workspace = robot.workspace().clone();
        state.set_base(&mut workspace, &with_matrix(&X_WB), &V_WB_B);
        robot.set_state(state);
        Ok(robot.into())
    }

    /// The rigid robot; `None` for [`Self::Flexible`].
    pub fn rigid(&self) -> Option<&Floating> {
        match self {
            Self::Rigid(robot) => Some(robot.own()),
            Self::Flexible(_) => None,
        }
    }

    /// Mutable access to the rigid robot, to grasp and release; `None` for [`Self::Flexible`].
    pub(super) fn rigid_mut(&mut self) -> Option<&mut RigidRobot> {
        match self {
            Self::Rigid(robot) => Some(robot),
            Self::Flexible(_) => None,
        }
    }

    /// The rigid robot with the bodies that it holds and touches; `None` for [`Self::Flexible`].
    pub(super) fn as_rigid(&self) -> Option<&RigidRobot> {
        match self {
            Self::Rigid(robot) => Some(robot),
            Self::Flexible(_) => None,
        }
    }

    /// The rigid robot, or the joined system with a held target; `None` for [`Self::Flexible`].
    pub(super) fn rigid_whole(&self) -> Option<&Floating> {
        match self {
            Self::Rigid(robot) => Some(robot.whole()),
            Self::Flexible(_) => None,
        }
    }

    /// Name of the held target.
    pub fn held(&self) -> Option<&str> {
        match self {
            Self::Rigid(robot) => robot.held(),
            Self::Flexible(robot) => robot.held(),
        }
    }

    /// Grasps the target called `name`: the impulse of the capture changes the motion of both. Returns the energy lost
    /// \[J\].
    ///
    /// # Errors
    /// [`CaptureError`]; nothing has changed then.
    pub(super) fn grasp(
        &mut self,
        (name, target): (&str, &mut Floating),
        grasp: &Grasp,
        method: IntegrationMethod,
        joint_physics: &JointPhysics,
    ) -> Result<f64, CaptureError> {
        match self {
            Self::Rigid(robot) => robot.grasp((name, target), grasp, method, joint_physics),
            Self::Flexible(robot) => robot.grasp((name, target), grasp, method),
        }
    }

    /// Opens all grasps; a `spring` pushes robot and target apart.
    pub(super) fn release_target(&mut self, target: &mut Floating, spring: Option<&ReleaseSpring>) {
        match self {
            Self::Rigid(robot) => robot.release(target, spring),
            Self::Flexible(robot) => robot.release(target, spring),
        }
    }

    /// Forgets the held target; the robot keeps its motion.
    pub(super) fn let_go(&mut self) {
        match self {
            Self::Rigid(robot) => robot.let_go(),
            Self::Flexible(robot) => robot.let_go(),
        }
    }

    /// Copies the motion of the held target in the joined system to `target`.
    pub(super) fn copy_target_to(&self, target: &mut Floating) {
        match self {
            Self::Rigid(robot) => robot.copy_target_to(target),
            Self::Flexible(robot) => robot.copy_target_to(target),
        }
    }

    /// Total work done on the robot and a held target, minus the losses in wheels and flexible parts \[J\].
    pub(super) fn whole_work(&self) -> f64 {
        match self {
            Self::Rigid(robot) => robot.whole().state().work,
            Self::Flexible(robot) => {
                let state = robot.whole_state();
                state.tree.work - state.losses().total()
            }
        }
    }

    /// Momentum of the robot with all that it holds or may touch, angular about the common centre of mass.
    pub(super) fn whole_momentum(&self) -> Momentum {
        match self {
            Self::Rigid(robot) => robot.whole_momentum(),
            Self::Flexible(robot) => robot.whole_state().tree.momentum_W,
        }
    }

    /// Work of contacts on the robot since contact was set up \[J\].
    pub(super) fn contact_work(&self) -> f64 {
        match self {
            Self::Rigid(robot) => robot.contact_work(),
            Self::Flexible(_) => 0.0,
        }
    }

    /// The contact world, if it is up to date: the robot is integrated in it.
    pub fn current_contact_system(&self) -> Option<&ContactSystem> {
        match self {
            Self::Rigid(robot) => robot.current_contact_system(),
            Self::Flexible(_) => None,
        }
    }

    /// The contact world; after a grasp or release it is out of date until contact is set up again.
    pub(super) fn contact_system(&self) -> Option<&ContactSystem> {
        match self {
            Self::Rigid(robot) => robot.contact_system(),
            Self::Flexible(_) => None,
        }
    }

    /// The robot with flexible parts, wheels or thrusters; `None` for [`Self::Rigid`].
    pub fn flexible(&self) -> Option<&FlexibleFloating> {
        match self {
            Self::Rigid(_) => None,
            Self::Flexible(robot) => Some(robot.own()),
        }
    }

    /// Mutable [`Self::flexible`], for commands.
    pub fn flexible_mut(&mut self) -> Option<&mut FlexibleFloating> {
        match self {
            Self::Rigid(_) => None,
            Self::Flexible(robot) => Some(robot.own_mut()),
        }
    }

    /// The tree of rigid bodies of the robot's description.
    pub fn model(&self) -> &Model {
        match self {
            Self::Rigid(robot) => robot.own().model(),
            Self::Flexible(robot) => robot.own().model(),
        }
    }

    /// As [`Self::model`], with the inertia of undeformed deformable bodies.
    pub fn rigid_model(&self) -> Model {
        match self {
            Self::Rigid(robot) => robot.own().model().clone(),
            Self::Flexible(robot) => robot.own().system().rigid_model(),
        }
    }

    /// Total mass \[kg\].
    pub fn total_mass(&self) -> f64 {
        match self {
            Self::Rigid(robot) => robot.own().model().total_mass(),
            Self::Flexible(robot) => robot.own().system().total_mass(),
        }
    }

    /// State of the tree: joints, base attitude, centre of mass, total momentum, work.
    pub fn state(&self) -> &State {
        match self {
            Self::Rigid(robot) => robot.own().state(),
            Self::Flexible(robot) => &robot.own().state().tree,
        }
    }

    /// Closed loops; `None` if there are none.
    pub fn loops(&self) -> Option<&Loops> {
        let loops = self.rigid()?.loops();
        (!loops.closures().is_empty()).then_some(loops)
    }

    /// Pose of `frame` in the base frame.
    pub fn X_BF(&self, frame: &Frame) -> Pose {
        match self {
            Self::Rigid(robot) => robot.own().workspace().X_BF(frame),
            Self::Flexible(robot) => robot.own().workspace().X_BF(frame),
        }
    }

    /// Twist of `frame`'s origin in the world, base axes.
    pub fn V_WF_B(&self, frame: &Frame) -> Twist {
        match self {
            Self::Rigid(robot) => robot.own().workspace().V_WF_B(frame),
            Self::Flexible(robot) => robot.own().workspace().V_WF_B(frame),
        }
    }

    /// Computes the accelerations of all frames under the held input and contacts, for [`Self::A_WF_B`].
    pub fn set_accelerations(&mut self) {
        match self {
            Self::Rigid(robot) => robot.set_accelerations(),
            Self::Flexible(robot) => robot.set_accelerations(),
        }
    }

    /// Acceleration of `frame`'s origin as a point, and angular acceleration, in the world, base axes. Requires
    /// [`Self::set_accelerations`].
    pub fn A_WF_B(&self, frame: &Frame) -> Twist {
        match self {
            Self::Rigid(robot) => robot.own().workspace().A_WF_B(frame),
            Self::Flexible(robot) => robot.own().workspace().A_WF_B(frame),
        }
    }

    /// Base pose and momentum on which motions of the tip depend. The momentum excludes that of the wheels.
    pub fn base_state(&self) -> BaseState {
        match self {
            Self::Rigid(robot) => BaseState::of(robot.own().state(), robot.own().workspace()),
            Self::Flexible(robot) => {
                let state = robot.own().state();
                let mut momentum_B = state.tree.momentum_W.expressed_in(&state.tree.R_WB);
                momentum_B.angular -= robot.own().workspace().rotor_momentum(state);
                BaseState {
                    X_WB: robot.own().X_WB(),
                    momentum_B,
                }
            }
        }
    }

    /// The held joint efforts \[N m or N\], within the joints' limits.
    pub fn efforts(&self) -> &DVector<f64> {
        match self {
            Self::Rigid(robot) => robot.own().efforts(),
            Self::Flexible(robot) => robot.own().efforts(),
        }
    }

    /// Holds joint efforts \[N m or N\] from now on, each clamped to its joint's effort limit. Returns whether any was
    /// clamped.
    pub fn hold_efforts(&mut self, efforts: &[f64]) -> bool {
        match self {
            Self::Rigid(robot) => robot.own_mut().hold_efforts(efforts),
            Self::Flexible(robot) => robot.own_mut().hold_efforts(efforts),
        }
    }

    /// Sets joint efforts and wheel torques to zero from now on.
    pub fn release(&mut self) {
        match self {
            Self::Rigid(robot) => robot.own_mut().release(),
            Self::Flexible(robot) => robot.own_mut().release(),
        }
    }

    /// Held joint efforts and wrenches.
    pub fn input_mut(&mut self) -> &mut Input {
        match self {
            Self::Rigid(robot) => robot.own_mut().input_mut(),
            Self::Flexible(robot) => &mut robot.own_mut().input_mut().tree,
        }
    }

    /// Whether any thruster is on.
    pub fn is_firing(&self) -> bool {
        self.flexible().is_some_and(FlexibleFloating::is_firing)
    }

    /// Advances by `steps` steps of `dt` \[s\] under the held input.
    pub fn step(&mut self, dt: f64, steps: usize) {
        match self {
            Self::Rigid(robot) => robot.step(dt, steps),
            Self::Flexible(robot) => robot.step(dt, steps),
        }
    }

    /// Advances by one step of `dt` \[s\]. At every stage, `forcing` changes joint efforts and wrenches, and wheel
    /// torques, depending on time and state. Afterwards the input for the new state is held.
    pub fn step_with(
        &mut self,
        dt: f64,
        forcing: &mut impl FnMut(f64, &State, &mut Input, &mut [f64]),
    ) {
        match self {
            Self::Rigid(robot) => {
                let mut apply = |time: f64, state: &State, input: &mut Input| {
                    forcing(time, state, input, &mut []);
                };
                robot.step_with(dt, &mut apply);
            }
            Self::Flexible(robot) => {
                let mut apply = |time: f64, state: &FlexibleState, input: &mut FlexibleInput| {
                    let wheels = input.wheel_torques.as_mut_slice();
                    forcing(time, &state.tree, &mut input.tree, wheels);
                };
                robot.step_with(dt, &mut apply);
            }
        }
    }
}

impl FreeBody for Robot {
    fn model(&self) -> &Model {
        self.model()
    }

    fn state(&self) -> &State {
        self.state()
    }

    fn is_finite(&self) -> bool {
        match self {
            Self::Rigid(robot) => robot.own().state().is_finite(),
            Self::Flexible(robot) => robot.own().state().is_finite(),
        }
    }

    fn X_WB(&self) -> Pose {
        match self {
            Self::Rigid(robot) => FreeBody::X_WB(robot.own()),
            Self::Flexible(robot) => robot.own().X_WB(),
        }
    }

    fn V_WB_B(&self) -> Twist {
        match self {
            Self::Rigid(robot) => *robot.own().workspace().V_WB_B(),
            Self::Flexible(robot) => *robot.own().workspace().V_WB_B(),
        }
    }

    fn A_WB_B(&mut self) -> Twist {
        self.set_accelerations();
        self.A_WF_B(&self.model().frames()[0])
    }

    fn move_base(&mut self, X_WB: &Isometry3<f64>, V_WB_B: &Twist) -> Result<(), String> {
        if let Some(held) = self.held() {
            return Err(format!("it holds {held}; detach it first"));
        }
        match self {
            Self::Rigid(robot) => robot.own_mut().move_base(X_WB, V_WB_B),
            Self::Flexible(_) => try_to_move(self, |robot| {
                if let Self::Flexible(robot) = robot {
                    let mut state = robot.own().state().clone();
                    let mut workspace = robot.own().workspace().clone();
                    state.set_base(&mut workspace, &with_matrix(X_WB), V_WB_B);
                    robot.set_state(state);
                }
            }),
        }
    }

    fn carried_momentum(&self) -> Momentum {
        let momentum_B = match self {
            Self::Rigid(robot) => robot.own().workspace().carried_momentum(),
            Self::Flexible(robot) => robot
                .own()
                .workspace()
                .carried_momentum(robot.own().state()),
        };
        in_world(self.state(), &momentum_B)
    }

    fn carried_momentum_and_scale(&self) -> (Momentum, (f64, f64)) {
        let (momentum_B, scale) = match self {
            Self::Rigid(robot) => robot.own().workspace().carried_momentum_and_scale(),
            Self::Flexible(robot) => {
                let (workspace, state) = (robot.own().workspace(), robot.own().state());
                (
                    workspace.carried_momentum(state),
                    workspace.momentum_scale(state),
                )
            }
        };
        (in_world(self.state(), &momentum_B), scale)
    }

    fn kinetic_energy(&self) -> f64 {
        match self {
            Self::Rigid(robot) => robot.own().workspace().kinetic_energy(),
            Self::Flexible(robot) => {
                let robot = robot.own();
                robot.workspace().kinetic_energy(robot.state())
            }
        }
    }

    fn strain_energy(&self) -> f64 {
        match self {
            Self::Rigid(_) => 0.0,
            Self::Flexible(robot) => {
                let robot = robot.own();
                robot.workspace().strain_energy(robot.state())
            }
        }
    }

    fn lost_energy(&self) -> f64 {
        match self {
            Self::Rigid(_) => 0.0,
            Self::Flexible(robot) => robot.own().state().losses().total(),
        }
    }
}

impl Restorable for Robot {
    type Saved = RobotState;

    fn saved(&self) -> RobotState {
        match self {
            Self::Rigid(robot) => RobotState::Rigid(robot.own().state().clone()),
            Self::Flexible(robot) => RobotState::Flexible(robot.own().state().clone()),
        }
    }

    fn save_to(&self, saved: &mut RobotState) {
        match (self, saved) {
            (Self::Rigid(robot), RobotState::Rigid(saved)) => saved.copy_from(robot.own().state()),
            (Self::Flexible(robot), RobotState::Flexible(saved)) => {
                saved.copy_from(robot.own().state());
            }
            (_, saved) => *saved = self.saved(),
        }
    }

    fn restore(&mut self, saved: &RobotState) {
        match (self, saved) {
            (Self::Rigid(robot), RobotState::Rigid(saved)) => robot.restore(saved),
            (Self::Flexible(robot), RobotState::Flexible(saved)) => robot.set_state(saved.clone()),
            _ => unreachable!("a state is restored to the robot that it was saved from"),
        }
    }

    fn restore_stopped(&mut self, saved: &RobotState, time: f64, keeps_momentum: bool) {
        match (self, saved) {
            (Self::Rigid(robot), RobotState::Rigid(saved)) => {
                robot.let_go();
                (robot.own_mut()).restore_stopped(saved, time, keeps_momentum);
            }
            (Self::Flexible(robot), RobotState::Flexible(saved)) => {
                let mut state = saved.clone();
                state.tree.time = time;
                state.close_valves();
                match keeps_momentum {
                    true => state.stop_internal_motion(),
                    false => state.stop(),
                }
                robot.set_state(state);
            }
            _ => unreachable!("a state is restored to the robot that it was saved from"),
        }
    }
}
