//! A robot that floats among free bodies, stepped under held joint efforts.

use nalgebra::DVector;

use super::newton_euler::SystemError;
use super::{FormulationKind, Input, Integrator, Loops, Method, State, Workspace};
use crate::model::Model;

/// One free-floating tree with its state and scratch: the servicer, or a target (a tree without joints).
#[derive(Debug, Clone)]
pub struct Floating {
    model: Model,
    state: State,
    workspace: Workspace,
    integrator: Integrator,
    input: Input,
    /// Whether the integrator's last evaluation is that of the present state under the held input.
    qdd_is_known: bool,
}

impl Floating {
    /// A tree in a state, to be stepped with `method`.
    pub fn new(model: Model, state: State, method: Method) -> Self {
        let loops = Loops::none(&model);
        Self::with_loops(model, state, method, loops)
    }

    /// A tree with closed loops in a state assembled for them ([`Loops::assemble`]).
    pub fn with_loops(model: Model, state: State, method: Method, loops: Loops) -> Self {
        let mut floating = Self {
            workspace: Workspace::new(&model),
            integrator: Integrator::with_loops(&model, method.tableau(), loops),
            input: Input::zero(&model),
            qdd_is_known: false,
            model,
            state,
        };
        floating.refresh();
        floating
    }

    /// The same tree, with forward dynamics by another formulation.
    ///
    /// # Errors
    /// [`SystemError`] as [`FormulationKind::prepare`].
    pub fn by(mut self, kind: FormulationKind) -> Result<Self, SystemError> {
        self.integrator = self.integrator.by(&self.model, kind)?;
        self.qdd_is_known = false;
        Ok(self)
    }

    /// The tree.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Its state.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Kinematics and motion of the present state.
    pub fn workspace(&self) -> &Workspace {
        &self.workspace
    }

    /// Its closed loops.
    pub fn loops(&self) -> &Loops {
        self.integrator.loops()
    }

    /// What the closures carry: see [`Loops::forces`].
    pub fn closure_forces(&mut self) -> Vec<[Option<f64>; 6]> {
        self.qdd_is_known = false;
        let (state, input) = (&self.state, &self.input);
        let loops = self.integrator.loops_mut();
        loops.forces(&self.model, state, &mut self.workspace, input)
    }

    /// Replaces the state, which must be on the constraints of closed loops.
    pub fn set_state(&mut self, state: State) {
        self.state = state;
        self.refresh();
    }

    /// The efforts held \[N m or N\], after the limits.
    pub fn efforts(&self) -> &DVector<f64> {
        &self.input.efforts
    }

    /// Holds joint efforts from now on, each cut to its joint's effort limit. Returns whether any was cut.
    ///
    /// # Panics
    /// If `efforts` does not have one element per joint.
    pub fn hold_efforts(&mut self, efforts: &[f64]) -> bool {
        assert_eq!(efforts.len(), self.model.dof(), "one effort per joint");
        self.qdd_is_known = false;
        let mut cut = false;
        for (j, (held, wanted)) in self.input.efforts.iter_mut().zip(efforts).enumerate() {
            let limit = self.model.joints()[j].limits.effort;
            *held = wanted.clamp(-limit, limit);
            cut |= *held != *wanted;
        }
        cut
    }

    /// Holds no efforts from now on.
    pub fn release(&mut self) {
        self.qdd_is_known = false;
        self.input.efforts.fill(0.0);
    }

    /// What acts: external wrenches can be set here.
    pub fn input_mut(&mut self) -> &mut Input {
        self.qdd_is_known = false;
        &mut self.input
    }

    /// Advances by `steps` steps of `dt` \[s\] under the held input.
    pub fn step(&mut self, dt: f64, steps: usize) {
        if steps == 0 {
            return;
        }
        self.integrator.hold(&self.input);
        self.integrator.steps_held(
            &self.model,
            &mut self.state,
            &mut self.workspace,
            dt,
            steps,
            self.qdd_is_known,
        );
        self.qdd_is_known = false;
    }

    /// Joint accelerations at this instant under the held input; afterwards the workspace's
    /// accelerations are those of this instant too.
    pub fn accelerations(&mut self) -> &DVector<f64> {
        self.set_joint_accelerations();
        let answer = self.integrator.answer();
        self.workspace.set_positions(&self.model, &self.state.q);
        self.workspace.set_motion(&self.state);
        (self.workspace).spread_accelerations(answer.A_WB_B, answer.qdd.as_slice());
        &answer.qdd
    }

    fn set_joint_accelerations(&mut self) {
        if !self.qdd_is_known {
            let (model, state, input) = (&self.model, &self.state, &self.input);
            (self.integrator).evaluate(model, state, &mut self.workspace, input);
            self.qdd_is_known = true;
        }
    }

    fn refresh(&mut self) {
        self.workspace.set_positions(&self.model, &self.state.q);
        self.workspace.set_motion(&self.state);
        self.qdd_is_known = false;
    }
}
