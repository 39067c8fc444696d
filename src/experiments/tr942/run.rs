//! A run as in the report: the whole motion as one state vector, integrated in equal steps.

use nalgebra::{DVector, Isometry3, Translation3};

use super::{chain, pantograph};
use crate::dynamics::newton_euler::{Axis, Load, MatrixMethod, Start, System};
use crate::dynamics::{
    Formulation, Input, Kane, Momentum, RungeKutta, State, Tableau, TreeAcceleration, VectorState,
    Workspace,
};
use crate::model::Model;

/// A motion from rest, by a given formulation and Runge-Kutta method.
pub struct Run<F> {
    model: Model,
    formulation: F,
    layout: VectorState,
    stepper: RungeKutta,
    time: f64,
    x: Vec<f64>,
    scratch: TreeAcceleration,
    input: Input,
}

impl Run<Kane> {
    /// Example 1 by Kane's method.
    pub fn chain(tableau: &'static Tableau) -> Self {
        let model = chain::model();
        let kane = Kane::new(&model);
        Self::new(model, kane, tableau, &chain::INITIAL)
    }

    /// Example 2 by Kane's method, both loops cut.
    pub fn pantograph(tableau: &'static Tableau) -> Self {
        let model = pantograph::model();
        let kane = Kane::with_cuts(&model, &pantograph::cuts(&model));
        let kane = kane.expect("the pantograph's cuts are sound");
        Self::new(model, kane, tableau, &pantograph::initial())
    }
}

impl<F: Formulation> Run<F> {
    /// Starts at rest at joint positions `q`, in the order of the model.
    pub fn new(model: Model, formulation: F, tableau: &'static Tableau, q: &[f64]) -> Self {
        let layout = VectorState::new(&model);
        Self {
            layout,
            stepper: RungeKutta::new(tableau, layout.length()),
            time: 0.0,
            x: layout.at_rest_with(q),
            scratch: TreeAcceleration::zero(&model),
            input: Input::zero(&model),
            formulation,
            model,
        }
    }

    /// Advances in steps of `dt` \[s\] to `time` \[s\]; the difference must be a multiple of `dt`.
    pub fn advance_to(&mut self, time: f64, dt: f64) {
        for _ in 0..((time - self.time) / dt).round() as usize {
            self.stepper.step(&mut self.x, dt, |x, rate| {
                let input = &self.input;
                let formulation = &mut self.formulation;
                self.layout
                    .rate(formulation, input, x, &mut self.scratch, rate);
            });
        }
        self.time = time;
    }

    /// Joint positions \[rad, m\].
    pub fn q(&self) -> &[f64] {
        &self.x[self.layout.q()]
    }

    /// Joint rates \[rad/s, m/s\].
    pub fn qd(&self) -> &[f64] {
        &self.x[self.layout.qd()]
    }

    /// Total momentum of the bodies, and the sums of the magnitudes of their momenta (linear, angular) as reference
    /// values.
    pub fn momentum(&self) -> (Momentum, (f64, f64)) {
        let motion = self.layout.motion(&self.x);
        let mut state = State::at_rest_with(&self.model, &DVector::from_column_slice(motion.q));
        state.qd.copy_from_slice(motion.qd);
        let position = Translation3::new(self.x[0], self.x[1], self.x[2]);
        let X_WB = Isometry3::from_parts(position, motion.R_WB);
        let mut workspace = Workspace::new(&self.model);
        state.set_base(&mut workspace, &X_WB, &motion.V_WB_B);
        workspace.set_motion(&state);
        (state.momentum_W, workspace.momentum_scale())
    }
}

/// A motion by the matrix method: 13 numbers per body.
pub struct MatrixRun {
    system: System,
    method: MatrixMethod,
    load: Load,
    stepper: RungeKutta,
    projected: bool,
    time: f64,
    state: Vec<f64>,
}

impl MatrixRun {
    /// Example 1. If `projected`, the state is projected onto the constraints after every step.
    pub fn chain(tableau: &'static Tableau, projected: bool) -> Self {
        let system = System::from_model(&chain::model()).expect("a chain of five bodies");
        let start = chain::start(&system);
        Self::new(system, &start, tableau, projected)
    }

    /// Example 2.
    pub fn pantograph(tableau: &'static Tableau, projected: bool) -> Self {
        let system = pantograph::system(pantograph::IN_PLANE).build();
        let system = system.expect("the pantograph is sound");
        let mut run = Self::new(system, &pantograph::start(), tableau, projected);
        // The later passages of the stretched configuration are slow, 1e-4 rad per step.
        run.method = run.method.with_tolerance(1e-5);
        run
    }

    fn new(system: System, start: &Start, tableau: &'static Tableau, projected: bool) -> Self {
        let state = system.assemble(start).expect("the printed state is sound");
        Self {
            method: MatrixMethod::new(&system),
            load: Load::zero(&system),
            stepper: RungeKutta::new(tableau, state.len()),
            system,
            projected,
            time: 0.0,
            state,
        }
    }

    /// Advances as [`Run::advance_to`].
    pub fn advance_to(&mut self, time: f64, dt: f64) {
        for _ in 0..((time - self.time) / dt).round() as usize {
            let (system, method, load) = (&self.system, &mut self.method, &self.load);
            self.stepper.step(&mut self.state, dt, |x, rates| {
                method.derivative(system, x, load, rates);
            });
            if self.projected {
                self.method.project(&self.system, &mut self.state);
            }
        }
        self.time = time;
    }

    /// The angle of hinge `number` of the report \[rad\].
    pub fn angle(&self, number: usize) -> f64 {
        self.system.displacement(&self.state, number - 1)[Axis::RotationZ.index()]
    }

    /// Its rate \[rad/s\].
    pub fn rate(&self, number: usize) -> f64 {
        self.system.rate(&self.state, number - 1)[Axis::RotationZ.index()]
    }
}
