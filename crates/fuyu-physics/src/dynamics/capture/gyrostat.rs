//! A robot with reaction wheels and thrusters that holds a target.
//!
//! An impulse does not change the angular momentum of a wheel about its axis, because bearing and motor transmit no
//! impulsive torque about it. So the impulse acts on robot and target as rigid trees that do not include the wheels'
//! axial inertia; afterwards the wheels' speeds relative to their bodies follow from their momenta. (P. C. Hughes,
//! Spacecraft Attitude Dynamics, 1986, section 3.4: a gyrostat whose rotor is free about its axis.)

use nalgebra::Vector3;

use super::captured::Captured;
use super::grasp::{CaptureError, Grasp};
use super::impulse::LatchImpulses;
use super::parts::{RobotPart, read_robot, robot_accelerations};
use super::release::{ReleaseSpring, push};
use crate::dynamics::flexible::{
    FlexibleFloating, FlexibleForcing, FlexibleInput, FlexibleState, FlexibleSystem,
    FlexibleWorkspace,
};
use crate::dynamics::{Floating, IntegrationMethod, State, Workspace};
use crate::model::Frame;

/// A robot with wheels and thrusters, joined with a target by a grasp: the counterpart of [`Captured`] for a
/// [`FlexibleSystem`] without deformable bodies and elastic joints. Springs and dampers of the target's joints act;
/// friction, stops and speed limits of joints do not.
#[derive(Debug, Clone)]
pub struct CapturedGyrostat {
    floating: FlexibleFloating,
    method: IntegrationMethod,
    /// The same tree with locked wheels. Its momentum excludes the wheels' momentum relative to their bodies.
    locked: Captured,
    robot: FlexibleSystem,
    free_wheels: FreeWheels,
    /// State and input of the robot at a stage of a step.
    stage: (FlexibleState, FlexibleInput),
}

/// Robot and target after a release.
#[derive(Debug, Clone, PartialEq)]
pub struct ReleasedGyrostat {
    /// State of the robot.
    pub robot: FlexibleState,
    /// State of the target.
    pub target: State,
}

impl CapturedGyrostat {
    /// Joins robot and target in their present states. Returns the impulse; system 0 is the robot, whose state includes
    /// the momentum of its wheels.
    ///
    /// # Errors
    /// [`CaptureError`] as for [`Captured::new`], and if the robot has deformable bodies or elastic joints, or the target
    /// mimic joints.
    pub fn new(
        robot: &FlexibleFloating,
        target: &Floating,
        grasp: &Grasp,
        method: IntegrationMethod,
    ) -> Result<(Self, LatchImpulses), CaptureError> {
        let system = robot.system();
        if !system.is_gyrostat() {
            return Err(CaptureError::Deformable(system.model().name().to_owned()));
        }
        grasp.check(system.model(), target)?;
        let mut free_wheels = FreeWheels::new(system);
        let (state, momenta) = free_wheels.without_wheels(robot.state(), robot.workspace());
        let mut impulses = grasp.close((&state, &mut free_wheels.workspace), target);
        let after = free_wheels.with_wheels(robot.state(), &impulses.states[0], &momenta);
        impulses.states[0] = after.tree.clone();
        let mut of_robot = FlexibleWorkspace::new(system);
        of_robot.set_state(&after);
        let rigid = wheels_locked(&after, &of_robot);
        let carrier = Floating::new(system.model().clone(), rigid.clone(), method);
        let states = [rigid, impulses.states[1].clone()];
        let mut locked = Captured::joined(&carrier, target, grasp, method, &states);
        locked.lose(impulses.energy_lost);
        let floating = joined_system(system, &locked, &after, method)?;
        let captured = Self {
            floating,
            method,
            locked,
            robot: system.clone(),
            free_wheels,
            stage: (after, FlexibleInput::zero(system)),
        };
        Ok((captured, impulses))
    }

    /// The joined system.
    pub fn floating(&self) -> &FlexibleFloating {
        &self.floating
    }

    /// The joined system with locked wheels. Its momentum excludes the wheels' momentum relative to their bodies.
    pub fn locked(&self) -> &Captured {
        &self.locked
    }

    /// Holds the robot's input, in the robot's order of joints, from now on, and opens its thrusters for as long as
    /// `robot` does.
    ///
    /// # Panics
    /// If it is another robot.
    pub fn hold_robot_input(&mut self, robot: &FlexibleFloating) {
        let from = robot.input();
        self.floating
            .change_state_with(|state, _| state.copy_valves(robot.state()));
        let to = self.floating.input_mut();
        RobotPart::write(
            &self.locked.places,
            &self.locked.part.bodies,
            &from.tree,
            &mut to.tree,
        );
        to.wheel_torques.copy_from(&from.wheel_torques);
    }

    /// Advances by `steps` steps of `dt` \[s\] under the held input.
    pub fn step(&mut self, dt: f64, steps: usize) {
        if self.locked.joined.connection.is_empty() {
            self.floating.step(dt, steps);
            self.follow();
            return;
        }
        for _ in 0..steps {
            self.floating.step(dt, 1);
            self.follow();
        }
    }

    /// Advances by one step of `dt` \[s\]; `forcing` changes the robot's input at every stage. `forcing` receives
    /// joints, attitude, wheels and thrusters of the robot, but centre of mass and momentum of the joined system.
    /// Afterwards its input for the new state is held, also by `robot`.
    ///
    /// # Panics
    /// If it is another robot.
    pub fn step_with(
        &mut self,
        dt: f64,
        robot: &mut FlexibleFloating,
        forcing: &mut impl FlexibleForcing,
    ) {
        self.hold_robot_input(robot);
        let Self {
            floating,
            locked,
            stage: (state, input),
            ..
        } = self;
        input.copy_from(robot.input());
        let mut of_whole = |time: f64, whole: &FlexibleState, to: &mut FlexibleInput| {
            read_robot(&locked.places, &whole.tree, &mut state.tree);
            state.copy_wheels_and_thrusters(whole);
            forcing.apply(time, state, input);
            RobotPart::write(
                &locked.places,
                &locked.part.bodies,
                &input.tree,
                &mut to.tree,
            );
            to.wheel_torques.copy_from(&input.wheel_torques);
        };
        floating.step_with(dt, &mut of_whole);
        robot.input_mut().copy_from(input);
        self.follow();
    }

    /// Copies the robot's motion in the joined system to `robot`, a system of the robot alone. Its work becomes that of
    /// the joined system.
    ///
    /// # Panics
    /// If it is another robot.
    pub fn copy_robot_to(&self, robot: &mut FlexibleFloating) {
        let whole = self.floating.state();
        let (X_WB, V_WB_B) = (self.floating.X_WB(), self.floating.workspace().V_WB_B());
        robot.change_state_with(|state, own| {
            read_robot(&self.locked.places, &whole.tree, &mut state.tree);
            state.copy_wheels_and_thrusters(whole);
            state.set_base(own, &X_WB, V_WB_B);
            state.tree.R_WB = whole.tree.R_WB;
        });
    }

    /// As [`Captured::copy_target_to`].
    pub fn copy_target_to(&self, target: &mut Floating) {
        self.locked.copy_target_to(target);
    }

    /// Copies the accelerations that the robot has in the joined system under the held input to `robot`, which
    /// [`Self::copy_robot_to`] has set.
    ///
    /// # Panics
    /// If it is another robot.
    pub fn copy_robot_accelerations_to(&mut self, robot: &mut FlexibleFloating) {
        let accelerations = self.floating.accelerations();
        let of_robot = robot_accelerations(&self.locked.places, accelerations.joints);
        let A_WB_B = accelerations.base;
        robot.copy_accelerations_to(A_WB_B, &of_robot);
    }

    /// States of robot and target when the grasp opens, pushed apart by `spring`. Their total momentum is that of the
    /// joined system.
    pub fn release(&self, spring: Option<&ReleaseSpring>) -> ReleasedGyrostat {
        let released = self.locked.release(None);
        let mut of_robot = FlexibleWorkspace::new(&self.robot);
        let mut robot = self.floating.state().with_tree(released.robot);
        add_wheels(&mut robot, &mut of_robot);
        let Some(spring) = spring else {
            return ReleasedGyrostat {
                robot,
                target: released.target,
            };
        };
        let mut free_wheels = self.free_wheels.clone();
        let (state, momenta) = free_wheels.without_wheels(&robot, &of_robot);
        let mut of_target = Workspace::new(self.locked.target());
        let [without, target] = push(
            (&state, &mut free_wheels.workspace),
            (&released.target, &mut of_target),
            self.locked.grasp(),
            spring,
        );
        ReleasedGyrostat {
            robot: free_wheels.with_wheels(&robot, &without, &momenta),
            target,
        }
    }

    /// Updates the tree with locked wheels to the motion of the joined system.
    fn follow(&mut self) {
        let (state, workspace) = (self.floating.state(), self.floating.workspace());
        let relative = state.tree.R_WB * workspace.rotor_momentum(state);
        self.locked.floating.change_state(|locked| {
            locked.copy_from(&state.tree);
            locked.momentum_W.angular -= relative;
        });
        if self.locked.choose_axes_if_tilted() {
            // The same parts have been joined before, so this cannot fail.
            let joined = joined_system(&self.robot, &self.locked, state, self.method);
            if let Ok(mut joined) = joined {
                joined.input_mut().copy_from(self.floating.input());
                self.floating = joined;
            }
        }
    }
}

/// The joined system: the tree `locked`, with the robot's wheels and thrusters in their state in `parts`.
fn joined_system(
    robot: &FlexibleSystem,
    locked: &Captured,
    parts: &FlexibleState,
    method: IntegrationMethod,
) -> Result<FlexibleFloating, CaptureError> {
    let system = robot
        .on_model(&locked.joined.model, &locked.part.bodies)
        .map_err(|e| CaptureError::Wheels(e.to_string()))?;
    let mut state = parts.with_tree(locked.floating.state().clone());
    add_wheels(&mut state, &mut FlexibleWorkspace::new(&system));
    Ok(FlexibleFloating::new(&system, state, method))
}

/// Adds the wheels' momentum relative to their bodies to the momentum of `state`.
fn add_wheels(state: &mut FlexibleState, workspace: &mut FlexibleWorkspace) {
    workspace.set_state(state);
    state.tree.momentum_W.angular += state.tree.R_WB * workspace.rotor_momentum(state);
    workspace.set_state(state);
}

/// The tree of `state`, with the wheels' momentum relative to their bodies subtracted.
fn wheels_locked(state: &FlexibleState, workspace: &FlexibleWorkspace) -> State {
    let mut tree = state.tree.clone();
    tree.momentum_W.angular -= tree.R_WB * workspace.rotor_momentum(state);
    tree
}

/// The robot as an impulse acts on it: the wheels contribute no inertia about their axes.
#[derive(Debug, Clone)]
struct FreeWheels {
    system: FlexibleSystem,
    workspace: Workspace,
}

impl FreeWheels {
    fn new(system: &FlexibleSystem) -> Self {
        Self {
            workspace: Workspace::new(&system.free_wheel_model()),
            system: system.clone(),
        }
    }

    /// Frame of the body that carries wheel `i`, and the wheel's axis in it.
    fn carrier(system: &FlexibleSystem, i: usize) -> (&Frame, Vector3<f64>) {
        let (body, axis) = system.wheel_axis(i);
        let model = system.model();
        let frame = model.frame(&model.bodies()[body].name);
        let frame = frame.expect("bodies have frames");
        (frame, frame.X_BF.rotation.inverse() * *axis)
    }

    /// The robot's state without its wheels, and the angular momentum of each wheel about its axis \[N m s\].
    fn without_wheels(
        &self,
        state: &FlexibleState,
        workspace: &FlexibleWorkspace,
    ) -> (State, Vec<f64>) {
        let mut tree = state.tree.clone();
        let mut momenta = Vec::new();
        for (i, wheel) in self.system.wheels().iter().enumerate() {
            let (frame, axis_F) = Self::carrier(&self.system, i);
            let axis = workspace.X_BF(frame).rotation * axis_F;
            let along = axis.dot(&workspace.V_WF_B(frame).angular);
            let momentum = wheel.inertia * (along + state.wheel_speeds()[i]);
            tree.momentum_W.angular -= state.tree.R_WB * (axis * momentum);
            momenta.push(momentum);
        }
        (tree, momenta)
    }

    /// The robot's state with wheels of these angular momenta, from its state without wheels, `tree`.
    fn with_wheels(
        &mut self,
        parts: &FlexibleState,
        tree: &State,
        momenta: &[f64],
    ) -> FlexibleState {
        self.workspace.set_positions(&tree.q);
        self.workspace.set_motion(tree);
        let mut state = parts.with_tree(tree.clone());
        for (i, momentum) in momenta.iter().enumerate() {
            let workspace = &self.workspace;
            let (frame, axis_F) = Self::carrier(&self.system, i);
            let axis = workspace.X_BF(frame).rotation * axis_F;
            let along = axis.dot(&workspace.V_WF_B(frame).angular);
            let inertia = self.system.wheels()[i].inertia;
            state.wheel_speeds_mut()[i] = momentum / inertia - along;
            state.tree.momentum_W.angular += tree.R_WB * (axis * *momentum);
        }
        state
    }
}
