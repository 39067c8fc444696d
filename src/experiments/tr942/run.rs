//! A run as the report made it: all of the motion in one vector, integrated in equal steps.

use nalgebra::{DVector, Isometry3, Translation3};

use super::{chain, pantograph};
use crate::dynamics::{
    Formulation, Input, Kane, Momentum, RungeKutta, State, Tableau, TreeAcceleration, VectorState,
    Workspace,
};
use crate::model::Model;

/// A motion by some formulation and some Runge-Kutta method, from rest.
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
    /// At rest with joint positions `q`, in the order of the model.
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

    /// Steps of `dt` \[s\] to `time` \[s\], which must be a multiple of it from now.
    pub fn advance_to(&mut self, time: f64, dt: f64) {
        for _ in 0..((time - self.time) / dt).round() as usize {
            self.stepper.step(&mut self.x, dt, |x, rate| {
                let (model, input) = (&self.model, &self.input);
                let formulation = &mut self.formulation;
                self.layout
                    .rate(model, formulation, input, x, &mut self.scratch, rate);
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

    /// Momentum as the bodies have it, and the sums of their own momenta (linear, angular), against which to
    /// judge it.
    pub fn momentum(&self) -> (Momentum, (f64, f64)) {
        let motion = self.layout.motion(&self.x);
        let mut state = State::at_rest_with(&self.model, &DVector::from_column_slice(motion.q));
        state.qd.copy_from_slice(motion.qd);
        let position = Translation3::new(self.x[0], self.x[1], self.x[2]);
        let X_WB = Isometry3::from_parts(position, motion.R_WB);
        let mut workspace = Workspace::new(&self.model);
        state.set_base(&self.model, &mut workspace, &X_WB, &motion.V_WB_B);
        workspace.set_motion(&state);
        (state.momentum_W, workspace.momentum_scale(&self.model))
    }
}
