//! Fixed-step explicit Runge-Kutta on the state's own manifold.

use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};

use super::newton_euler::SystemError;
use super::rate::{Rate, advance};
use super::{
    ArticulatedBody, Formulation, FormulationKind, ForwardDynamics, Input, Loops, State, Tableau,
    TreeAcceleration, TreeMotion, Workspace,
};
use crate::model::Model;
use crate::spatial::Wrench;

/// Integration methods to choose from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Classical Runge-Kutta, order 4, 4 evaluations a step.
    Rk4,
    /// Dormand-Prince, order 8, 12 evaluations a step. The default: at equal cost its energy drifts
    /// orders of magnitude less (`docs/integrators.md`).
    #[default]
    Dop8,
}

impl Method {
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

/// What acts on the robot as a function of time and state. Called at every stage; a controller that
/// holds its command over a step ignores both arguments.
pub trait Forcing {
    /// Writes efforts and wrenches for `state` at `time`; `input` keeps what the last call wrote.
    fn apply(&mut self, time: f64, state: &State, input: &mut Input);
}

impl<F: FnMut(f64, &State, &mut Input)> Forcing for F {
    fn apply(&mut self, time: f64, state: &State, input: &mut Input) {
        self(time, state, input);
    }
}

/// Steps a [`State`]; owns the stage memory. Attitude is integrated on the rotation group
/// (Munthe-Kaas: the rotation vector turned within the step is the coordinate), so any tableau keeps
/// its order and the quaternion needs no correction; momentum is integrated as state, so without
/// external wrenches it does not change by a single bit.
#[derive(Debug, Clone)]
pub struct Integrator {
    tableau: &'static Tableau,
    pub(super) arch: Arch,
    rates: Vec<Rate>,
    stage: State,
    input: Input,
    plant: Plant,
}

impl Integrator {
    /// An integrator for `model` with one of the library's methods and the default formulation.
    pub fn new(model: &Model, method: Method) -> Self {
        Self::with_tableau(model, method.tableau())
    }

    /// An integrator for `model` with any explicit tableau.
    pub fn with_tableau(model: &Model, tableau: &'static Tableau) -> Self {
        Self::with_loops(model, tableau, Loops::none(model))
    }

    /// An integrator for `model` with closed loops: states are projected onto them at every stage. They
    /// start from one that is assembled ([`Loops::assemble`]).
    pub fn with_loops(model: &Model, tableau: &'static Tableau, loops: Loops) -> Self {
        Self {
            plant: Plant {
                dynamics: ForwardDynamics::articulated_body(model),
                loops,
                answer: TreeAcceleration::zero(model),
                w_WB_B: Vector3::zeros(),
                mass: model.total_mass(),
            },
            tableau,
            arch: Arch::new(),
            rates: vec![Rate::zero(model.dof()); tableau.c.len()],
            stage: State::at_rest(model),
            input: Input::zero(model),
        }
    }

    /// The same integrator, with forward dynamics by another formulation. Closed loops keep to the reduced
    /// form, in whose metric they are solved.
    ///
    /// # Errors
    /// [`SystemError`] as [`FormulationKind::prepare`].
    pub fn by(mut self, model: &Model, kind: FormulationKind) -> Result<Self, SystemError> {
        self.plant.dynamics = kind.prepare(model)?;
        Ok(self)
    }

    /// Accelerations of a state under `input`, which is held for the next step. If there are closed loops or
    /// external wrenches, `workspace` holds positions and motion of the state afterwards.
    pub(super) fn evaluate(
        &mut self,
        model: &Model,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
    ) {
        self.plant.evaluate(model, state, workspace, input);
    }

    /// What the last evaluation gave.
    pub(super) fn answer(&self) -> &TreeAcceleration {
        &self.plant.answer
    }

    /// The closed loops.
    pub fn loops(&self) -> &Loops {
        &self.plant.loops
    }

    pub(super) fn loops_mut(&mut self) -> &mut Loops {
        &mut self.plant.loops
    }

    /// Advances `state` by `dt` \[s\]; `forcing` is asked at every stage. On return `workspace` holds
    /// positions and motion of the new state.
    pub fn step(
        &mut self,
        model: &Model,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        forcing: &mut impl Forcing,
    ) {
        self.steps(model, state, workspace, dt, 1, forcing);
    }

    /// As many steps of `dt` \[s\], the same to the bit as one after the other; only after the last one is
    /// `workspace` brought to the new state.
    pub fn steps(
        &mut self,
        model: &Model,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        count: usize,
        forcing: &mut impl Forcing,
    ) {
        for _ in 0..count {
            self.take_step(model, state, workspace, dt, false, forcing);
        }
        workspace.set_positions(model, &state.q);
        workspace.set_motion(state);
    }

    /// Takes over what acts in [`Integrator::steps_held`].
    pub(super) fn hold(&mut self, input: &Input) {
        self.input.copy_from(input);
    }

    /// [`Integrator::steps`] under the input held. The first starts from the last evaluation if that `is_known`
    /// to be of this state under the same input.
    pub(super) fn steps_held(
        &mut self,
        model: &Model,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        count: usize,
        is_known: bool,
    ) {
        let mut held = |_: f64, _: &State, _: &mut Input| {};
        for step in 0..count {
            let is_known = is_known && step == 0;
            self.take_step(model, state, workspace, dt, is_known, &mut held);
        }
        workspace.set_positions(model, &state.q);
        workspace.set_motion(state);
    }

    /// One step; `is_known` if the first stage was evaluated already.
    fn take_step(
        &mut self,
        model: &Model,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        is_known: bool,
        forcing: &mut impl Forcing,
    ) {
        let tableau = self.tableau;
        self.plant.loops.project(model, state, workspace);
        let mut turned = Vector3::zeros();
        for (i, c) in tableau.c.iter().enumerate() {
            self.stage.time = state.time + c * dt;
            let at = if i == 0 { &*state } else { &self.stage };
            forcing.apply(at.time, at, &mut self.input);
            let is_known = is_known && i == 0;
            if self.plant.is_free(&self.input) {
                let stage = FreeStage {
                    integrator: self,
                    start: state,
                    turned,
                    i,
                    dt,
                    is_known,
                };
                turned = stage.integrator.arch.dispatch(stage);
            } else {
                if !is_known {
                    (self.plant).evaluate(model, at, workspace, &self.input);
                }
                let Plant { answer, w_WB_B, .. } = &self.plant;
                let (rates, mass) = (&mut self.rates, self.plant.mass);
                rates[i].set_motion(at, &answer.qdd, mass, w_WB_B, &turned);
                rates[i].set_driven(model, at, workspace, &self.input);
                let weights = next_weights(tableau, i);
                turned = advance(&mut self.stage, state, &rates[..=i], weights, dt);
            }
            if i + 1 < tableau.c.len() {
                self.plant.loops.project(model, &mut self.stage, workspace);
            }
        }
        self.stage.time = state.time + dt;
        std::mem::swap(state, &mut self.stage);
        self.plant.loops.project(model, state, workspace);
        state.R_WB.renormalize_fast();
    }
}

/// How the stages up to `i` lead to the next one, or to the step's end.
#[inline(always)]
fn next_weights(tableau: &Tableau, i: usize) -> &'static [f64] {
    tableau.a.get(i + 1).copied().unwrap_or(tableau.b)
}

/// One stage of free motion by articulated bodies, and the way to the next, for `pulp` to compile.
struct FreeStage<'a> {
    integrator: &'a mut Integrator,
    /// Where the step began.
    start: &'a State,
    /// Rotation vector turned since then.
    turned: Vector3<f64>,
    i: usize,
    dt: f64,
    is_known: bool,
}

impl WithSimd for FreeStage<'_> {
    type Output = Vector3<f64>;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vector3<f64> {
        let (i, integrator) = (self.i, self.integrator);
        let at = if i == 0 {
            self.start
        } else {
            &integrator.stage
        };
        let plant = &mut integrator.plant;
        let ForwardDynamics::ArticulatedBody(dynamics) = &mut plant.dynamics else {
            unreachable!("free motion is by articulated bodies");
        };
        if !self.is_known {
            let efforts = integrator.input.efforts.as_slice();
            plant.w_WB_B = dynamics.accelerate_free(simd, at, efforts, &mut plant.answer);
        }
        let rate = &mut integrator.rates[i];
        let qdd = &plant.answer.qdd;
        rate.set_motion(at, qdd, plant.mass, &plant.w_WB_B, &self.turned);
        rate.set_free(dynamics.joint_power());
        let (rates, weights) = (&integrator.rates[..=i], next_weights(integrator.tableau, i));
        advance(&mut integrator.stage, self.start, rates, weights, self.dt)
    }
}

/// [`ArticulatedBody::accelerate_free`], for `pulp` to compile.
struct FreeEvaluation<'a> {
    dynamics: &'a mut ArticulatedBody,
    state: &'a State,
    efforts: &'a [f64],
    answer: &'a mut TreeAcceleration,
}

impl WithSimd for FreeEvaluation<'_> {
    type Output = Vector3<f64>;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vector3<f64> {
        (self.dynamics).accelerate_free(simd, self.state, self.efforts, self.answer)
    }
}

/// What accelerates the robot: a formulation of forward dynamics, and closed loops.
#[derive(Debug, Clone)]
struct Plant {
    dynamics: ForwardDynamics,
    loops: Loops,
    answer: TreeAcceleration,
    /// Angular velocity of the base, base axes, as the last evaluation found it.
    w_WB_B: Vector3<f64>,
    mass: f64,
}

impl Plant {
    /// Whether nothing but actuators, springs and dampers acts on a tree in the default formulation: then
    /// no poses are needed.
    fn is_free(&self, input: &Input) -> bool {
        matches!(self.dynamics, ForwardDynamics::ArticulatedBody(_))
            && self.loops.closures().is_empty()
            && !Wrench::any(&input.wrenches)
    }

    fn evaluate(&mut self, model: &Model, state: &State, workspace: &mut Workspace, input: &Input) {
        let is_free = self.is_free(input);
        let Self {
            dynamics,
            loops,
            answer,
            w_WB_B,
            ..
        } = self;
        if let (true, ForwardDynamics::ArticulatedBody(dynamics)) = (is_free, &mut *dynamics) {
            *w_WB_B = workspace.arch.dispatch(FreeEvaluation {
                dynamics,
                state,
                efforts: input.efforts.as_slice(),
                answer,
            });
            return;
        }
        workspace.set_positions(model, &state.q);
        if !loops.closures().is_empty() {
            workspace.set_motion(state);
            loops.accelerations(model, state, workspace, input, &mut answer.qdd);
            workspace.set_accelerations(&answer.qdd);
            answer.A_WB_B = workspace.bodies[0].acceleration;
            workspace.set_external(input, state.qd.as_slice());
            *w_WB_B = workspace.V_WB_B().angular;
            return;
        }
        workspace.set_base_motion(state);
        workspace.set_external(input, state.qd.as_slice());
        let motion = TreeMotion {
            R_WB: state.R_WB,
            V_WB_B: *workspace.V_WB_B(),
            q: state.q.as_slice(),
            qd: state.qd.as_slice(),
        };
        *w_WB_B = motion.V_WB_B.angular;
        dynamics.accelerations(model, &motion, input, answer);
    }
}
