//! A free-floating robot or body with its state, stepped under held joint efforts.

use nalgebra::DVector;

use super::newton_euler::SystemError;
use super::{
    Forcing, FormulationKind, Input, IntegrationMethod, Integrator, JointPhysics, Loops, State,
    TreeAcceleration, Workspace, checks,
};
use crate::model::Model;
use crate::spatial::Twist;
#[cfg(feature = "batch")]
use crate::{dynamics::Tableau, spatial::Wrench};

/// One free-floating tree with its state and scratch memory: a robot, or a target (a tree without joints).
///
/// ```
/// use fuyu_physics::dynamics::{Floating, IntegrationMethod, State};
/// use fuyu_physics::model::{JointKind, ModelBuilder};
/// use fuyu_physics::spatial::RigidInertia;
/// use nalgebra::{Matrix3, Translation3, Vector3};
///
/// // A base of 10 kg with a boom of 1 kg, hinged 0.5 m from the base's centre.
/// let inertia = |mass, x| RigidInertia { mass, com: Vector3::new(x, 0.0, 0.0), about_com: Matrix3::identity() * (0.1 * mass) };
/// let mut builder = ModelBuilder::new("boom", "base_link", inertia(10.0, 0.0));
/// let hinge = Translation3::new(0.5, 0.0, 0.0).into();
/// builder.body("arm", 0, JointKind::Continuous, Vector3::z_axis(), hinge, inertia(1.0, 0.5));
/// let model = builder.build();
///
/// let mut robot = Floating::new(model.clone(), State::at_rest(&model), IntegrationMethod::Dop8);
/// robot.hold_efforts(&[1.0]); // N m
/// robot.step(0.01, 100); // 100 steps of 0.01 s
///
/// // The arm turns one way, the base the other; angular momentum stays exactly zero.
/// let state = robot.state();
/// assert!(state.q[0] > 0.0 && robot.workspace().V_WB_B().angular.z < 0.0);
/// assert_eq!(state.momentum_W.angular, Vector3::zeros());
/// // The efforts' work has become kinetic energy.
/// assert!((robot.workspace().kinetic_energy() - state.work).abs() < 1e-12);
/// ```
#[derive(Debug, Clone)]
pub struct Floating {
    state: State,
    workspace: Workspace,
    integrator: Integrator,
    input: Input,
    /// Whether the integrator's last evaluation was at the present state under the held input.
    is_evaluated: bool,
}

impl Floating {
    /// A tree in a state, to be stepped with `method`.
    ///
    /// # Panics
    /// If `state` does not have one position and one rate per joint.
    pub fn new(model: Model, state: State, method: IntegrationMethod) -> Self {
        Self::with_loops(Loops::none(&model), state, method)
    }

    /// A robot with closed loops, in a state assembled for them ([`Loops::assemble`]).
    ///
    /// # Panics
    /// As [`Floating::new`].
    pub fn with_loops(loops: Loops, state: State, method: IntegrationMethod) -> Self {
        checks::state(&state, &loops.model);
        let mut floating = Self {
            workspace: Workspace::new(&loops.model),
            input: Input::zero(&loops.model),
            integrator: Integrator::with_loops(loops, method.tableau()),
            is_evaluated: false,
            state,
        };
        floating.refresh();
        floating
    }

    /// The same tree, with forward dynamics by another formulation.
    ///
    /// # Errors
    /// [`SystemError`] as [`FormulationKind::prepare`].
    pub fn with_formulation(mut self, kind: FormulationKind) -> Result<Self, SystemError> {
        self.integrator = self.integrator.with_formulation(kind)?;
        self.is_evaluated = false;
        Ok(self)
    }

    /// The same tree, with other settings for friction, stops and speed limits of the joints.
    pub fn with_joint_physics(mut self, settings: &JointPhysics) -> Self {
        self.integrator = self.integrator.with_joint_physics(settings);
        self.is_evaluated = false;
        self
    }

    /// The tree.
    pub fn model(&self) -> &Model {
        self.workspace.model()
    }

    /// Its state.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Kinematics and dynamics terms of the present state.
    pub fn workspace(&self) -> &Workspace {
        &self.workspace
    }

    /// The closed loops.
    pub fn loops(&self) -> &Loops {
        self.integrator.loops()
    }

    /// Constraint forces and torques in the closures: see [`Loops::forces`].
    pub fn closure_forces(&mut self) -> Vec<[Option<f64>; 6]> {
        self.is_evaluated = false;
        let loops = self.integrator.loops_mut();
        loops.forces(&self.state, &mut self.workspace, &self.input)
    }

    /// Replaces the state, which must satisfy the constraints of closed loops.
    ///
    /// # Panics
    /// As [`Floating::new`].
    pub fn set_state(&mut self, state: State) {
        checks::state(&state, self.workspace.model());
        self.state = state;
        self.refresh();
    }

    /// The held efforts \[N m or N\], within the joints' limits.
    pub fn efforts(&self) -> &DVector<f64> {
        &self.input.efforts
    }

    /// Holds joint efforts \[N m or N\] from now on, each clamped to its joint's effort limit. Returns whether any was
    /// clamped.
    ///
    /// # Panics
    /// If `efforts` does not have one element per joint.
    pub fn hold_efforts(&mut self, efforts: &[f64]) -> bool {
        let model = self.workspace.model();
        checks::joint_vector("efforts", efforts.len(), model);
        self.is_evaluated = false;
        let mut is_clamped = false;
        let held = self.input.efforts.iter_mut();
        for ((joint, held), wanted) in model.joints().iter().zip(held).zip(efforts) {
            let limit = joint.limits.effort;
            *held = wanted.clamp(-limit, limit);
            is_clamped |= *held != *wanted;
        }
        is_clamped
    }

    /// Sets all efforts to zero from now on.
    pub fn release(&mut self) {
        self.is_evaluated = false;
        self.input.efforts.fill(0.0);
    }

    /// Held efforts and wrenches, mutable. External wrenches are set here.
    pub fn input_mut(&mut self) -> &mut Input {
        self.is_evaluated = false;
        &mut self.input
    }

    /// Held efforts and wrenches.
    pub fn input(&self) -> &Input {
        &self.input
    }

    /// Changes the state without allocating.
    pub(super) fn change_state(&mut self, change: impl FnOnce(&mut State)) {
        change(&mut self.state);
        self.refresh();
    }

    /// As [`Self::change_state`], with the scratch memory of this tree, whose content does not matter.
    pub(super) fn change_state_with(&mut self, change: impl FnOnce(&mut State, &mut Workspace)) {
        change(&mut self.state, &mut self.workspace);
        self.refresh();
    }

    /// The tableau of the integrator, if SIMD lanes can compute the same steps. `None` with closed loops, damping or
    /// friction in the joints, mimic joints, another formulation, or wrenches.
    #[cfg(feature = "batch")]
    pub(super) fn lane_tableau(&self) -> Option<&'static Tableau> {
        let has_wrench = self.input.wrenches.iter().any(|w| *w != Wrench::ZERO);
        let tableau = self.integrator.lane_tableau()?;
        (!has_wrench && !self.model().has_mimics()).then_some(tableau)
    }

    /// As [`Integrator::is_free`].
    #[cfg(feature = "batch")]
    pub(super) fn is_free(&self, start: (&[f64], &[f64]), end: (&[f64], &[f64]), dt: f64) -> bool {
        self.integrator.is_free(start, end, dt)
    }

    /// Advances by `steps` steps of `dt` \[s\] under the held input.
    pub fn step(&mut self, dt: f64, steps: usize) {
        if steps == 0 {
            return;
        }
        self.integrator.set_input(&self.input);
        let mut hold = |_: f64, _: &State, _: &mut Input| {};
        self.integrator.steps_from(
            &mut self.state,
            &mut self.workspace,
            dt,
            steps,
            self.is_evaluated,
            &mut hold,
        );
        self.is_evaluated = false;
    }

    /// Advances by one step of `dt` \[s\]; at every stage `forcing` changes the held input. Afterwards its input for
    /// the new state is held.
    pub fn step_with(&mut self, dt: f64, forcing: &mut impl Forcing) {
        self.integrator.set_input(&self.input);
        (self.integrator).step(&mut self.state, &mut self.workspace, dt, forcing);
        forcing.apply(self.state.time, &self.state, &mut self.input);
        self.is_evaluated = false;
    }

    /// Joint accelerations \[rad/s² or m/s²\] at this instant under the held input; afterwards the workspace also holds
    /// the accelerations of this instant.
    pub fn accelerations(&mut self) -> &DVector<f64> {
        self.present_accelerations();
        let found = self.integrator.accelerations();
        self.workspace.set_positions(&self.state.q);
        self.workspace.set_motion(&self.state);
        (self.workspace).propagate_accelerations(found.A_WB_B, found.qdd.as_slice());
        &found.qdd
    }

    /// Accelerations of base and joints at this instant under the held input.
    pub(super) fn present_accelerations(&mut self) -> &TreeAcceleration {
        if !self.is_evaluated {
            (self.integrator).evaluate(&self.state, &mut self.workspace, &self.input);
            self.is_evaluated = true;
        }
        self.integrator.accelerations()
    }

    /// Sets the accelerations of all bodies in the workspace from those of base and joints.
    pub(super) fn copy_accelerations_to(&mut self, A_WB_B: Twist, qdd: &[f64]) {
        self.workspace.set_positions(&self.state.q);
        self.workspace.set_motion(&self.state);
        self.workspace.propagate_accelerations(A_WB_B, qdd);
    }

    fn refresh(&mut self) {
        self.workspace.set_positions(&self.state.q);
        self.workspace.set_motion(&self.state);
        self.is_evaluated = false;
    }
}
