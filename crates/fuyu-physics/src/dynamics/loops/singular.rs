//! Where constraints lose rank for a moment.

use nalgebra::DVector;

use super::Loops;
use crate::dynamics::{Input, State, Workspace};
use crate::model::Model;

/// How far aside to look \[rad, or m relative to the size of the mechanism\]. The limit's error is of the
/// fourth power; too near, normals have no digits left.
const ASIDE: f64 = 5e-3;

/// Rates and accelerations below this say nothing about where a mechanism goes.
const STILL: f64 = 1e-9;

/// How often to look farther.
const WIDER: usize = 3;

/// Scratch: a state beside the singular one.
#[derive(Debug, Clone)]
pub(super) struct Aside {
    state: State,
    /// What is interpolated, there.
    value: DVector<f64>,
    /// The interpolated value.
    limit: DVector<f64>,
}

impl Aside {
    pub(super) fn new(model: &Model) -> Self {
        Self {
            state: State::at_rest(model),
            value: DVector::zeros(model.dof()),
            limit: DVector::zeros(model.dof()),
        }
    }
}

/// Places along the way and their weights, which are exact for cubics.
const BOTH_SIDES: [(f64, f64); 4] = [
    (-2.0, -1.0 / 6.0),
    (-1.0, 2.0 / 3.0),
    (1.0, 2.0 / 3.0),
    (2.0, -1.0 / 6.0),
];

/// The same on one side, exact for lines.
const AHEAD: [(f64, f64); 2] = [(1.0, 2.0), (2.0, -1.0)];

impl Loops {
    /// Takes off the rates of `state` also what moves against a constraint that depends on the others here,
    /// but not to either side along the motion.
    pub(super) fn limit_rates(&mut self, state: &mut State, workspace: &mut Workspace) {
        let rates = |_: &mut Self, there: &State, _: &mut Workspace, out: &mut DVector<f64>| {
            out.copy_from(&there.qd);
        };
        let size = state.qd.amax();
        if size > STILL
            && self.interpolate(state, workspace, &state.qd, &BOTH_SIDES, rates)
            && let Some(aside) = &self.aside
        {
            state.qd.copy_from(&aside.limit);
        }
    }

    /// Replaces `qdd`, which lacks the constraint that depends on the others at `state`, by the limit of
    /// accelerations along the motion. The mechanism moves through such a state on a smooth branch, on
    /// which acceleration is smooth too: it is interpolated from both sides, or, from rest, extrapolated
    /// from the side to which the mechanism starts. Where nothing moves, nothing is replaced.
    pub(super) fn limit_accelerations(
        &mut self,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
        qdd: &mut DVector<f64>,
    ) {
        let (way, places): (_, &[_]) = if state.qd.amax() > STILL {
            (&state.qd, &BOTH_SIDES)
        } else if qdd.amax() > STILL {
            (&*qdd, &AHEAD)
        } else {
            return;
        };
        let found = self.interpolate(state, workspace, way, places, |s, there, w, out| {
            w.set_motion(there);
            s.constrained_accelerations(there, w, input, out);
        });
        workspace.set_motion(state);
        if let Some(aside) = &mut self.aside {
            // The workspace is to hold what acts here.
            workspace.accelerations(state, input, &mut aside.value);
            if found {
                qdd.copy_from(&aside.limit);
            }
        }
    }

    /// Interpolates `value` at `state` from what it is at `places` along the `way`, into the scratch's
    /// `limit`. Gives whether the constraints are independent at all of them. `workspace` stands at the
    /// positions of `state` before and after.
    fn interpolate(
        &mut self,
        state: &State,
        workspace: &mut Workspace,
        way: &DVector<f64>,
        places: &[(f64, f64)],
        mut value: impl FnMut(&mut Self, &State, &mut Workspace, &mut DVector<f64>),
    ) -> bool {
        // Asked from beside a singular state: it is not to look farther.
        let Some(mut aside) = self.aside.take() else {
            return false;
        };
        let gap = self.gap_before;
        let mut distance = ASIDE.max(gap / self.length);
        let mut found = false;
        for _ in 0..WIDER {
            let step = distance / way.amax();
            let Aside {
                state: there,
                value: f,
                limit,
            } = &mut *aside;
            limit.fill(0.0);
            found = places.iter().all(|(place, weight)| {
                there.copy_from(state);
                there.q.axpy(place * step, way, 1.0);
                self.project(there, workspace);
                value(self, there, workspace, f);
                limit.axpy(*weight, f, 1.0);
                self.normals.rank() >= self.rank
            });
            if found {
                break;
            }
            distance *= 3.0;
        }
        workspace.set_positions(&state.q);
        self.gap_before = gap;
        self.set_normals(workspace, &state.q);
        self.aside = Some(aside);
        found
    }
}
