//! Fixed-step explicit Runge-Kutta integration of a [`State`].

use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};

use super::joint_physics::{Acting, JointSteps, Stepper};
use super::newton_euler::SystemError;
use super::rate::{Rate, advance, damping_loss};
use super::{
    Evaluation, Formulation, FormulationKind, ForwardDynamics, Input, InstructionSets,
    JointPhysics, Loops, State, Tableau, TreeAcceleration, Workspace, checks,
};
use crate::model::Model;

/// Integration methods to choose from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum IntegrationMethod {
    /// Classical Runge-Kutta, order 4, 4 evaluations a step.
    Rk4,
    /// Dormand-Prince, order 8, 12 evaluations a step. The default: at equal cost its energy drifts
    /// orders of magnitude less (`docs/integrators.md`).
    #[default]
    Dop8,
}

impl IntegrationMethod {
    /// All methods by name, the default first.
    pub const NAMES: [(&'static str, Self); 2] = [("dop8", Self::Dop8), ("rk4", Self::Rk4)];

    /// The method's coefficients.
    pub fn tableau(self) -> &'static Tableau {
        match self {
            Self::Rk4 => &Tableau::RK4,
            Self::Dop8 => &Tableau::DOP8,
        }
    }
}

/// Efforts and wrenches as a function of time and state, evaluated at every stage of a step. A sampled controller,
/// which holds its efforts over a step, ignores both arguments.
pub trait Forcing {
    /// Writes efforts and wrenches for `state` at `time` \[s\]; `input` initially holds the values of the last call.
    fn apply(&mut self, time: f64, state: &State, input: &mut Input);
}

impl<F: FnMut(f64, &State, &mut Input)> Forcing for F {
    fn apply(&mut self, time: f64, state: &State, input: &mut Input) {
        self(time, state, input);
    }
}

/// Steps a [`State`]; owns the memory of the stages. Attitude is integrated on the rotation group (Munthe-Kaas: the
/// coordinate is the rotation vector since the start of the step), so any tableau keeps its order and the quaternion
/// needs no correction. Momentum is part of the state: without external wrenches it does not change at all, bit by bit.
///
/// The tableau integrates smooth motion. Steps in which a joint's damping, friction or limits act are integrated by an
/// exponential collocation method of order 4 (tableaus of up to four stages) or 8, see [`JointPhysics`].
#[derive(Debug, Clone)]
pub struct Integrator {
    tableau: &'static Tableau,
    arch: Arch,
    rates: Vec<Rate>,
    stage: State,
    input: Input,
    equations: EquationsOfMotion,
    /// Steps of joints with damping, friction or limits; `None` for a robot without any.
    stepper: Option<Box<Stepper>>,
}

impl Integrator {
    /// An integrator for `model` with one of the library's methods and the default formulation.
    pub fn new(model: &Model, method: IntegrationMethod) -> Self {
        Self::with_tableau(model, method.tableau())
    }

    /// An integrator for `model` with any explicit tableau.
    pub fn with_tableau(model: &Model, tableau: &'static Tableau) -> Self {
        Self::with_loops(Loops::none(model), tableau)
    }

    /// An integrator for a robot with closed loops, whose states are projected onto the constraints at every stage. The
    /// first state must be assembled ([`Loops::assemble`]).
    pub fn with_loops(loops: Loops, tableau: &'static Tableau) -> Self {
        let model = loops.model.clone();
        let stepper = stepper(&model, &loops, &JointPhysics::default(), tableau);
        Self {
            stepper,
            tableau,
            arch: InstructionSets::of_this_processor().forward_dynamics,
            rates: vec![Rate::zero(model.dof()); tableau.c.len()],
            stage: State::at_rest(&model),
            input: Input::zero(&model),
            equations: EquationsOfMotion {
                formulation: ForwardDynamics::articulated_body(&model),
                loops,
                evaluation: Evaluation::zero(&model),
                mass: model.total_mass(),
                model,
            },
        }
    }

    /// The same integrator, with forward dynamics by another formulation. Closed loops always use the reduced form,
    /// because the reduced inertia is the metric of their projection.
    ///
    /// # Errors
    /// [`SystemError`] as [`FormulationKind::prepare`].
    pub fn with_formulation(mut self, kind: FormulationKind) -> Result<Self, SystemError> {
        self.equations.formulation = kind.prepare(&self.equations.model)?;
        Ok(self)
    }

    /// The same integrator, with other settings for friction, stops and speed limits of the joints. With closed loops only
    /// damping is simulated.
    pub fn with_joint_physics(mut self, settings: &JointPhysics) -> Self {
        let Self {
            equations, tableau, ..
        } = &self;
        self.stepper = stepper(&equations.model, &equations.loops, settings, tableau);
        self
    }

    /// Evaluates the equations of motion at `state` under `input`. If there are closed loops or external wrenches,
    /// `workspace` holds positions and motion of the state afterwards.
    pub(super) fn evaluate(&mut self, state: &State, workspace: &mut Workspace, input: &Input) {
        let Some(stepper) = &mut self.stepper else {
            self.equations.evaluate(state, workspace, input);
            return;
        };
        self.input.copy_from(input);
        let mut hold = |_: f64, _: &State, _: &mut Input| {};
        let mut acting = Acting {
            equations: &mut self.equations,
            workspace,
            forcing: &mut hold,
            input: &mut self.input,
        };
        stepper.evaluate(state, &mut acting);
    }

    /// The steps for which the tableau is not sufficient because of the joints.
    pub(super) fn joint_steps(&self) -> JointSteps {
        match &self.stepper {
            None => JointSteps::Never,
            Some(stepper) if stepper.acts_always() => JointSteps::Always,
            Some(_) => JointSteps::AtLimits,
        }
    }

    /// Whether an explicit step from `start` to `end` (positions and rates of the joints) is valid, because the joints
    /// reach no limit in it.
    #[cfg(feature = "batch")]
    pub(super) fn is_free(&self, start: (&[f64], &[f64]), end: (&[f64], &[f64]), dt: f64) -> bool {
        (self.stepper.as_ref()).is_none_or(|stepper| stepper.is_free(start, end, dt))
    }

    /// The tableau, if SIMD lanes can compute the same steps, except those in which a joint reaches a limit.
    #[cfg(feature = "batch")]
    pub(super) fn lane_tableau(&self) -> Option<&'static Tableau> {
        let equations = &self.equations;
        let is_default = matches!(equations.formulation, ForwardDynamics::ArticulatedBody(_));
        let is_tree = equations.loops.closures().is_empty();
        let is_explicit = self.joint_steps() != JointSteps::Always;
        (is_default && is_tree && is_explicit).then_some(self.tableau)
    }

    /// Accelerations of the last evaluation.
    pub(super) fn accelerations(&self) -> &TreeAcceleration {
        &self.equations.evaluation.acceleration
    }

    /// The closed loops.
    pub fn loops(&self) -> &Loops {
        &self.equations.loops
    }

    pub(super) fn loops_mut(&mut self) -> &mut Loops {
        &mut self.equations.loops
    }

    /// Advances `state` by `dt` \[s\], with `forcing` evaluated at every stage. Afterwards `workspace` holds positions
    /// and motion of the new state. A negative `dt` goes back in time, without friction and limits: a joint that they
    /// have stopped cannot be distinguished from a joint that was at rest.
    ///
    /// # Panics
    /// If `state` or `workspace` is of another robot, or `forcing` changes the length of a vector.
    pub fn step(
        &mut self,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        forcing: &mut impl Forcing,
    ) {
        self.steps(state, workspace, dt, 1, forcing);
    }

    /// Takes `count` steps of `dt` \[s\], bit-identical to single steps; `workspace` is updated only after the last
    /// one.
    ///
    /// # Panics
    /// As [`Integrator::step`].
    pub fn steps(
        &mut self,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        count: usize,
        forcing: &mut impl Forcing,
    ) {
        self.steps_from(state, workspace, dt, count, false, forcing);
    }

    /// Sets the input that the forcing receives at the next stage.
    pub(super) fn set_input(&mut self, input: &Input) {
        self.input.copy_from(input);
    }

    /// The input of the last stage.
    #[cfg(feature = "batch")]
    pub(super) fn input(&self) -> &Input {
        &self.input
    }

    /// [`Integrator::steps`]. If `is_evaluated`, the last evaluation was at `state` under the input of the first stage,
    /// and is reused. From here on forcing is a trait object, so that every step runs code that was compiled here, whichever
    /// crate calls.
    pub(super) fn steps_from(
        &mut self,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        count: usize,
        is_evaluated: bool,
        forcing: &mut dyn Forcing,
    ) {
        let model = &self.equations.model;
        checks::same_robot("the integrator", model, "the workspace", &workspace.model);
        checks::state(state, model);
        for step in 0..count {
            let is_evaluated = is_evaluated && step == 0;
            match self.joint_steps() {
                JointSteps::Never => self.take_step(state, workspace, dt, is_evaluated, forcing),
                _ if dt < 0.0 => self.take_damped_step(state, workspace, dt, forcing),
                JointSteps::Always => self.take_joint_step(state, workspace, dt, forcing),
                JointSteps::AtLimits => {
                    self.take_limited_step(state, workspace, dt, is_evaluated, forcing);
                }
            }
        }
        workspace.set_positions(&state.q);
        workspace.set_motion(state);
    }

    /// A step of a robot whose joints have limits: an explicit one unless a limit is reached in it.
    fn take_limited_step(
        &mut self,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        is_evaluated: bool,
        forcing: &mut dyn Forcing,
    ) {
        self.take_step(state, workspace, dt, is_evaluated, forcing);
        // The state before the step is in `stage` now.
        let (before, after) = (&self.stage, &*state);
        let start = (before.q.as_slice(), before.qd.as_slice());
        let end = (after.q.as_slice(), after.qd.as_slice());
        if let Some(stepper) = &self.stepper
            && !stepper.is_free(start, end, dt)
        {
            std::mem::swap(state, &mut self.stage);
            self.take_joint_step(state, workspace, dt, forcing);
        }
    }

    /// A step of a robot whose joints have damping, friction or limits.
    fn take_joint_step(
        &mut self,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        forcing: &mut dyn Forcing,
    ) {
        let Some(stepper) = &mut self.stepper else {
            return;
        };
        let mut acting = Acting {
            equations: &mut self.equations,
            workspace,
            forcing,
            input: &mut self.input,
        };
        if stepper.is_explicit_mechanism(state, dt, &mut acting) {
            self.take_damped_step(state, workspace, dt, forcing);
        } else {
            stepper.step(state, dt, &mut acting);
        }
    }

    /// An explicit step of a robot whose joints have damping.
    fn take_damped_step(
        &mut self,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        forcing: &mut dyn Forcing,
    ) {
        self.take_step(state, workspace, dt, false, forcing);
        let weights = self.tableau.weights_after(self.tableau.c.len() - 1);
        let joints = self.equations.model.joints();
        state.dissipated.damping += damping_loss(&self.rates, weights, joints, dt);
    }

    fn take_step(
        &mut self,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        is_evaluated: bool,
        forcing: &mut dyn Forcing,
    ) {
        let Self {
            tableau,
            equations,
            stage,
            input,
            ..
        } = self;
        equations.loops.project(state, workspace);
        let mut turned = Vector3::zeros();
        for (i, c) in tableau.c.iter().enumerate() {
            stage.time = state.time + c * dt;
            let at = if i == 0 { &*state } else { &*stage };
            forcing.apply(at.time, at, input);
            if i > 0 || !is_evaluated {
                equations.evaluate(at, workspace, input);
            }
            turned = self.arch.dispatch(StageEnd {
                tableau,
                rates: &mut self.rates[..=i],
                evaluation: &equations.evaluation,
                mass: equations.mass,
                start: state,
                stage,
                turned,
                dt,
            });
            if i + 1 < tableau.c.len() {
                equations.loops.project(stage, workspace);
            }
        }
        stage.time = state.time + dt;
        std::mem::swap(state, stage);
        equations.loops.project(state, workspace);
        state.R_WB.renormalize_fast();
    }
}

/// End of a stage: computes its rate, and the state of the next stage or of the end of the step. `pulp` compiles it for
/// every instruction set.
struct StageEnd<'a> {
    tableau: &'static Tableau,
    /// Rates of the stages up to this one.
    rates: &'a mut [Rate],
    evaluation: &'a Evaluation,
    mass: f64,
    /// State at the start of the step.
    start: &'a State,
    /// State of this stage on input (for the first stage, `start` instead), state of the next one on output.
    stage: &'a mut State,
    /// Rotation vector from `start` to this stage.
    turned: Vector3<f64>,
    dt: f64,
}

impl WithSimd for StageEnd<'_> {
    /// Rotation vector from `start` to the next stage.
    type Output = Vector3<f64>;
    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Vector3<f64> {
        let i = self.rates.len() - 1;
        let at = if i == 0 { self.start } else { &*self.stage };
        self.rates[i].set(at, self.evaluation, self.mass, &self.turned);
        let weights = self.tableau.weights_after(i);
        advance(self.stage, self.start, self.rates, weights, self.dt)
    }
}

fn stepper(
    model: &Model,
    loops: &Loops,
    settings: &JointPhysics,
    tableau: &Tableau,
) -> Option<Box<Stepper>> {
    let is_tree = loops.closures().is_empty();
    Stepper::new(model, settings, tableau.c.len(), is_tree).map(Box::new)
}

/// A formulation of forward dynamics, or closed loops.
#[derive(Debug, Clone)]
pub(super) struct EquationsOfMotion {
    pub model: Model,
    formulation: ForwardDynamics,
    pub loops: Loops,
    pub evaluation: Evaluation,
    pub mass: f64,
}

impl EquationsOfMotion {
    pub fn evaluate(&mut self, state: &State, workspace: &mut Workspace, input: &Input) {
        checks::input(input, &self.model);
        let out = &mut self.evaluation;
        if self.loops.closures().is_empty() {
            self.formulation.evaluate(state, workspace, input, out);
            return;
        }
        workspace.set_positions(&state.q);
        workspace.set_motion(state);
        let qdd = &mut out.acceleration.qdd;
        self.loops.accelerations(state, workspace, input, qdd);
        workspace.set_accelerations(qdd);
        out.acceleration.A_WB_B = workspace.bodies[0].acceleration;
        workspace.set_external(input, state.qd.as_slice());
        out.w_WB_B = workspace.V_WB_B().angular;
        out.set_forces(state, workspace, input);
    }
}

#[cfg(test)]
impl Integrator {
    /// Restricts the instruction set.
    pub(super) fn set_arch(&mut self, arch: Arch) {
        self.arch = arch;
        if let ForwardDynamics::ArticulatedBody(dynamics) = &mut self.equations.formulation {
            dynamics.scratch.arch = arch;
        }
    }
}
