//! Many states of one robot with flexible parts, stepped on all processors.

use rayon::prelude::*;

use super::{FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleSystem, FlexibleWorkspace};
use crate::dynamics::IntegrationMethod;

/// States of one [`FlexibleSystem`] that are stepped in parallel, with the results of [`FlexibleIntegrator`]. Memory is
/// allocated once, for each state.
#[derive(Clone, Debug)]
pub struct FlexibleBatch {
    runs: Vec<Run>,
}

#[derive(Clone, Debug)]
struct Run {
    state: FlexibleState,
    workspace: FlexibleWorkspace,
    integrator: FlexibleIntegrator,
}

impl FlexibleBatch {
    /// A batch of `states`.
    ///
    /// # Panics
    /// If a state is of another system.
    pub fn new(
        system: &FlexibleSystem,
        states: impl IntoIterator<Item = FlexibleState>,
        method: IntegrationMethod,
    ) -> Self {
        let runs = states.into_iter().map(|state| {
            let mut workspace = FlexibleWorkspace::new(system);
            workspace.set_state(&state);
            Run {
                state,
                workspace,
                integrator: FlexibleIntegrator::new(system, method),
            }
        });
        Self {
            runs: runs.collect(),
        }
    }

    /// Number of states.
    pub fn len(&self) -> usize {
        self.runs.len()
    }

    /// Whether there is no state.
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// State `i`.
    ///
    /// # Panics
    /// If there are fewer.
    pub fn state(&self, i: usize) -> &FlexibleState {
        &self.runs[i].state
    }

    /// Kinematics of state `i`.
    ///
    /// # Panics
    /// If there are fewer.
    pub fn workspace(&self, i: usize) -> &FlexibleWorkspace {
        &self.runs[i].workspace
    }

    /// Advances all states by `count` steps of `dt` \[s\]. `forcing` is called at every stage with the number of the
    /// state, as [`FlexibleForcing::apply`](super::FlexibleForcing::apply) is.
    pub fn step(
        &mut self,
        dt: f64,
        count: usize,
        forcing: &(impl Fn(usize, f64, &FlexibleState, &mut FlexibleInput) + Sync),
    ) {
        self.runs.par_iter_mut().enumerate().for_each(|(i, run)| {
            let Run {
                state,
                workspace,
                integrator,
            } = run;
            let mut forcing = |time: f64, state: &FlexibleState, input: &mut FlexibleInput| {
                forcing(i, time, state, input);
            };
            integrator.steps(state, workspace, dt, count, &mut forcing);
        });
    }
}
