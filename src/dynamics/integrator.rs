//! Fixed-step explicit Runge-Kutta on the state's own manifold.

use nalgebra::{DVector, Vector3};

use super::newton_euler::SystemError;
use super::{
    Formulation, FormulationKind, ForwardDynamics, Input, Loops, State, Tableau, TreeAcceleration,
    TreeMotion, Workspace,
};
use crate::model::Model;
use crate::spatial::{exp_so3, rotation_vector_rate};

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

/// The state's rate of change at one stage. The attitude's is that of the rotation vector turned
/// since the step began.
#[derive(Debug, Clone)]
struct Rate {
    turned: Vector3<f64>,
    com: Vector3<f64>,
    linear_momentum: Vector3<f64>,
    angular_momentum: Vector3<f64>,
    q: DVector<f64>,
    qd: DVector<f64>,
    work: f64,
}

impl Rate {
    fn zero(n: usize) -> Self {
        Self {
            turned: Vector3::zeros(),
            com: Vector3::zeros(),
            linear_momentum: Vector3::zeros(),
            angular_momentum: Vector3::zeros(),
            q: DVector::zeros(n),
            qd: DVector::zeros(n),
            work: 0.0,
        }
    }

    /// Fills in all but the joint accelerations, for which `workspace` was last asked.
    fn complete(
        &mut self,
        model: &Model,
        state: &State,
        workspace: &Workspace,
        input: &Input,
        turned: &Vector3<f64>,
    ) {
        self.turned = rotation_vector_rate(turned, &workspace.V_WB_B().angular);
        self.com = state.momentum_W.linear / workspace.mass;
        self.linear_momentum = state.R_WB * workspace.external.force;
        self.angular_momentum = state.R_WB * workspace.external.torque;
        let (q, qd) = (state.q.as_slice(), state.qd.as_slice());
        self.q.as_mut_slice().copy_from_slice(qd);
        self.work = workspace.external_power;
        let actuated = model.joints().iter().zip(input.efforts.as_slice());
        for ((joint, effort), (q, qd)) in actuated.zip(q.iter().zip(qd)) {
            self.work += (effort + joint.passive_effort(*q, *qd)) * qd;
        }
    }
}

/// Steps a [`State`]; owns the stage memory. Attitude is integrated on the rotation group
/// (Munthe-Kaas: the rotation vector turned within the step is the coordinate), so any tableau keeps
/// its order and the quaternion needs no correction; momentum is integrated as state, so without
/// external wrenches it does not change by a single bit.
#[derive(Debug, Clone)]
pub struct Integrator {
    tableau: &'static Tableau,
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
            },
            tableau,
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

    /// Accelerations of a state; afterwards `workspace` holds its positions, the base's motion, and what
    /// external wrenches sum up to.
    pub(super) fn evaluate(
        &mut self,
        model: &Model,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
    ) -> &TreeAcceleration {
        self.plant.evaluate(model, state, workspace, input);
        &self.plant.answer
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
    /// positions and motion of the new state, so that the next step's first stage starts from them.
    pub fn step(
        &mut self,
        model: &Model,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        forcing: &mut impl Forcing,
    ) {
        self.plant.loops.project(model, state, workspace);
        forcing.apply(state.time, state, &mut self.input);
        self.plant.evaluate(model, state, workspace, &self.input);
        self.begin(model, state, workspace);
        self.finish(model, state, workspace, dt, forcing);
    }

    /// A step under `input` held, from the state that was evaluated last, under the same input.
    pub(super) fn step_held(
        &mut self,
        model: &Model,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        input: &Input,
    ) {
        self.input.copy_from(input);
        self.begin(model, state, workspace);
        let mut held = |_: f64, _: &State, _: &mut Input| {};
        self.finish(model, state, workspace, dt, &mut held);
    }

    /// The first stage, from the last evaluation.
    fn begin(&mut self, model: &Model, state: &State, workspace: &Workspace) {
        let rate = &mut self.rates[0];
        let qdd = self.plant.answer.qdd.as_slice();
        rate.qd.as_mut_slice().copy_from_slice(qdd);
        rate.complete(model, state, workspace, &self.input, &Vector3::zeros());
    }

    /// The stages after the first, and the new state.
    fn finish(
        &mut self,
        model: &Model,
        state: &mut State,
        workspace: &mut Workspace,
        dt: f64,
        forcing: &mut impl Forcing,
    ) {
        let tableau = self.tableau;
        for (i, (a, c)) in tableau.a.iter().zip(tableau.c).enumerate().skip(1) {
            let turned = advance(&mut self.stage, state, &self.rates[..i], a, dt);
            self.stage.time = state.time + c * dt;
            self.plant.loops.project(model, &mut self.stage, workspace);
            forcing.apply(self.stage.time, &self.stage, &mut self.input);
            self.plant
                .evaluate(model, &self.stage, workspace, &self.input);
            let rate = &mut self.rates[i];
            let qdd = self.plant.answer.qdd.as_slice();
            rate.qd.as_mut_slice().copy_from_slice(qdd);
            rate.complete(model, &self.stage, workspace, &self.input, &turned);
        }
        advance(&mut self.stage, state, &self.rates, tableau.b, dt);
        self.stage.time = state.time + dt;
        std::mem::swap(state, &mut self.stage);
        self.plant.loops.project(model, state, workspace);
        state.R_WB.renormalize_fast();
        workspace.set_positions(model, &state.q);
        workspace.set_motion(state);
    }
}

/// What accelerates the robot: a formulation of forward dynamics, and closed loops.
#[derive(Debug, Clone)]
struct Plant {
    dynamics: ForwardDynamics,
    loops: Loops,
    answer: TreeAcceleration,
}

impl Plant {
    fn evaluate(&mut self, model: &Model, state: &State, workspace: &mut Workspace, input: &Input) {
        let Self {
            dynamics,
            loops,
            answer,
        } = self;
        workspace.set_positions(model, &state.q);
        if !loops.closures().is_empty() {
            workspace.set_motion(state);
            loops.accelerations(model, state, workspace, input, &mut answer.qdd);
            workspace.set_accelerations(&answer.qdd);
            answer.A_WB_B = workspace.bodies[0].acceleration;
            workspace.set_external(input, state.qd.as_slice());
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
        match dynamics {
            ForwardDynamics::ArticulatedBody(dynamics) => {
                dynamics.accelerations_at(&workspace.places, &motion, input, answer);
            }
            other => other.accelerations(model, &motion, input, answer),
        }
    }
}

/// `into = from + dt Σ weights rates`; returns the rotation vector turned.
fn advance(
    into: &mut State,
    from: &State,
    rates: &[Rate],
    weights: &[f64],
    dt: f64,
) -> Vector3<f64> {
    into.p_WC = from.p_WC;
    into.momentum_W = from.momentum_W;
    into.work = from.work;
    let (q, qd) = (into.q.as_mut_slice(), into.qd.as_mut_slice());
    q.copy_from_slice(from.q.as_slice());
    qd.copy_from_slice(from.qd.as_slice());
    let mut turned = Vector3::zeros();
    for (rate, weight) in rates.iter().zip(weights) {
        if *weight == 0.0 {
            continue;
        }
        let k = dt * weight;
        turned += rate.turned * k;
        into.p_WC += rate.com * k;
        into.momentum_W.linear += rate.linear_momentum * k;
        into.momentum_W.angular += rate.angular_momentum * k;
        into.work += rate.work * k;
        let joints = rate.q.as_slice().iter().zip(rate.qd.as_slice());
        for ((q, qd), (q_rate, qd_rate)) in q.iter_mut().zip(&mut *qd).zip(joints) {
            *q += q_rate * k;
            *qd += qd_rate * k;
        }
    }
    into.R_WB = from.R_WB * exp_so3(&turned);
    turned
}
