//! A free-floating robot with flexible parts and its state, stepped under held efforts and torques.

use nalgebra::DVector;

use super::{
    Accelerations, FlexibleForcing, FlexibleInput, FlexibleIntegrator, FlexibleState,
    FlexibleSystem, FlexibleWorkspace,
};
use crate::dynamics::{IntegrationMethod, checks};
use crate::model::Model;
use crate::spatial::{Pose, Wrench};

/// A [`FlexibleSystem`] with its state and scratch memory: the counterpart of [`Floating`](crate::dynamics::Floating)
/// for rigid robots. Joint efforts, wrenches and wheel torques are held from step to step.
#[derive(Clone, Debug)]
pub struct FlexibleFloating {
    state: FlexibleState,
    workspace: FlexibleWorkspace,
    integrator: FlexibleIntegrator,
    input: FlexibleInput,
}

impl FlexibleFloating {
    /// A robot in a state, to be stepped with `method`.
    ///
    /// # Panics
    /// If `state` is of another system.
    pub fn new(system: &FlexibleSystem, state: FlexibleState, method: IntegrationMethod) -> Self {
        let mut workspace = FlexibleWorkspace::new(system);
        workspace.set_state(&state);
        Self {
            integrator: FlexibleIntegrator::new(system, method),
            input: FlexibleInput::zero(system),
            workspace,
            state,
        }
    }

    /// The robot.
    pub fn system(&self) -> &FlexibleSystem {
        self.integrator.system()
    }

    /// Its tree of rigid bodies.
    pub fn model(&self) -> &Model {
        self.system().model()
    }

    /// The present state.
    pub fn state(&self) -> &FlexibleState {
        &self.state
    }

    /// Kinematics and dynamics terms of the present state.
    pub fn workspace(&self) -> &FlexibleWorkspace {
        &self.workspace
    }

    /// Pose of the base frame in the world.
    pub fn X_WB(&self) -> Pose {
        self.workspace.X_WB(&self.state)
    }

    /// Kinetic and strain energy \[J\].
    pub fn energy(&self) -> f64 {
        self.workspace.kinetic_energy(&self.state) + self.workspace.strain_energy(&self.state)
    }

    /// Replaces the state.
    ///
    /// # Panics
    /// If `state` is of another system.
    pub fn set_state(&mut self, state: FlexibleState) {
        self.workspace.set_state(&state);
        self.state = state;
    }

    /// The held input: joint efforts (of elastic joints: of the motor), wrenches and wheel torques.
    pub fn input(&self) -> &FlexibleInput {
        &self.input
    }

    /// The held input, mutable.
    pub fn input_mut(&mut self) -> &mut FlexibleInput {
        &mut self.input
    }

    /// The held joint efforts \[N m or N\].
    pub fn efforts(&self) -> &DVector<f64> {
        &self.input.tree.efforts
    }

    /// Holds joint efforts \[N m or N\] from now on, each clamped to its joint's effort limit. Returns whether any was
    /// clamped.
    ///
    /// # Panics
    /// If `efforts` does not have one element per joint.
    pub fn hold_efforts(&mut self, efforts: &[f64]) -> bool {
        let model = self.integrator.system().model();
        checks::joint_vector("efforts", efforts.len(), model);
        let mut is_clamped = false;
        let held = self.input.tree.efforts.iter_mut();
        for ((joint, held), wanted) in model.joints().iter().zip(held).zip(efforts) {
            let limit = joint.limits.effort;
            *held = wanted.clamp(-limit, limit);
            is_clamped |= *held != *wanted;
        }
        is_clamped
    }

    /// Sets joint efforts and wheel torques to zero from now on.
    pub fn release(&mut self) {
        self.input.tree.efforts.fill(0.0);
        self.input.wheel_torques.fill(0.0);
    }

    /// Opens the valve of thruster `i` for `duration` \[s\] from now, as [`FlexibleState::fire`].
    ///
    /// # Panics
    /// As [`FlexibleState::fire`].
    pub fn fire(&mut self, i: usize, duration: f64) {
        self.state.fire(self.integrator.system(), i, duration);
    }

    /// Whether a thruster is on.
    pub fn is_firing(&self) -> bool {
        self.state.on_times().iter().any(|t| *t > 0.0)
    }

    /// Advances by `steps` steps of `dt` \[s\] under the held input.
    pub fn step(&mut self, dt: f64, steps: usize) {
        let Self {
            state,
            workspace,
            integrator,
            input: held,
        } = self;
        let mut hold = |_: f64, _: &FlexibleState, input: &mut FlexibleInput| input.copy_from(held);
        integrator.steps(state, workspace, dt, steps, &mut hold);
    }

    /// Advances by one step of `dt` \[s\]; at every stage `forcing` changes the held efforts, wrenches and wheel
    /// torques. Afterwards its values for the new state are held.
    pub fn step_with(&mut self, dt: f64, forcing: &mut impl FlexibleForcing) {
        let Self {
            state,
            workspace,
            integrator,
            input: held,
        } = self;
        let mut apply = |time: f64, state: &FlexibleState, input: &mut FlexibleInput| {
            input.copy_from(held);
            forcing.apply(time, state, input);
        };
        integrator.step(state, workspace, dt, &mut apply);
        forcing.apply(state.tree.time, state, held);
    }

    /// Accelerations at this instant under the held input.
    pub(in crate::dynamics) fn accelerations(&mut self) -> Accelerations<'_> {
        (self.integrator).accelerations(&self.state, &mut self.workspace, &self.input)
    }

    /// State and scratch memory; the caller must keep them consistent.
    pub(super) fn parts_mut(&mut self) -> (&mut FlexibleState, &mut FlexibleWorkspace) {
        (&mut self.state, &mut self.workspace)
    }

    /// Computes the accelerations of all frames at this instant under the held input
    /// ([`FlexibleWorkspace::A_WF_B`]).
    pub fn set_accelerations(&mut self) {
        (self.integrator).set_accelerations(&self.state, &mut self.workspace, &self.input);
    }

    /// Wrench that body `b` and its subtree exert on the rest of the robot through the body's joint, under the held
    /// input: torque about the base's origin \[N m\] and force \[N\], base axes. Needs the present accelerations
    /// ([`Self::set_accelerations`]); of a robot that holds a target, the accelerations of the joined system
    /// ([`CapturedGyrostat::copy_robot_accelerations_to`](crate::dynamics::capture::CapturedGyrostat::copy_robot_accelerations_to)).
    ///
    /// # Panics
    /// If no joint moves a body `b`.
    pub fn transmitted_wrench(&mut self, b: usize) -> Wrench {
        (self.workspace).transmitted_wrench(b, &self.state, &self.input)
    }
}
