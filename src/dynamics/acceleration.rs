//! Whose forward dynamics an integrator asks: the workspace's, with closed loops, or a formulation's.

use nalgebra::DVector;

use super::{
    Formulation, FormulationKind, ForwardDynamics, Input, Loops, State, TreeAcceleration,
    TreeMotion, Workspace,
};
use crate::model::Model;

/// Joint accelerations of a tree, with closed loops or by the formulation chosen.
#[derive(Debug, Clone)]
pub(super) struct Acceleration {
    pub(super) loops: Loops,
    /// `None` for the reduced form, which the workspace has.
    other: Option<(ForwardDynamics, TreeAcceleration)>,
}

impl Acceleration {
    /// By the reduced form.
    pub(super) fn new(loops: Loops) -> Self {
        Self { loops, other: None }
    }

    pub(super) fn choose(&mut self, model: &Model, kind: FormulationKind) {
        self.other = (kind != FormulationKind::Reduced && self.loops.closures().is_empty())
            .then(|| (kind.prepare(model), TreeAcceleration::zero(model)));
    }

    /// As [`Workspace::accelerations`], after which `workspace` also knows what acts from outside.
    pub(super) fn of(
        &mut self,
        model: &Model,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
        qdd: &mut DVector<f64>,
    ) {
        let Some((dynamics, out)) = &mut self.other else {
            return self
                .loops
                .accelerations(model, state, workspace, input, qdd);
        };
        workspace.set_bias_forces(input);
        let motion = TreeMotion {
            R_WB: state.R_WB,
            V_WB_B: *workspace.V_WB_B(),
            q: state.q.as_slice(),
            qd: state.qd.as_slice(),
        };
        dynamics.accelerations(model, &motion, input, out);
        qdd.copy_from(&out.qdd);
    }
}
