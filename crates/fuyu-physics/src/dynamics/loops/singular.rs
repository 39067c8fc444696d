//! Rates and accelerations at singular states, where constraints lose rank.

use nalgebra::DVector;

use super::Loops;
use crate::dynamics::{Input, State, Workspace};
use crate::model::Model;

/// Distance of the nearby states \[rad, or m relative to the size of the mechanism\]. The error of the limit grows with
/// its fourth power; at smaller distances normals lose precision.
const DISTANCE: f64 = 5e-3;

/// Rates and accelerations below this define no direction of motion.
const STILL: f64 = 1e-9;

/// Number of attempts, each at three times the distance of the previous one.
const ATTEMPTS: usize = 3;

/// Scratch: a state near the singular one.
#[derive(Debug, Clone)]
pub(super) struct NearbyState {
    state: State,
    /// The interpolated quantity at that state.
    value: DVector<f64>,
    /// Its interpolated value at the singular state.
    limit: DVector<f64>,
}

impl NearbyState {
    pub(super) fn new(model: &Model) -> Self {
        Self {
            state: State::at_rest(model),
            value: DVector::zeros(model.dof()),
            limit: DVector::zeros(model.dof()),
        }
    }
}

/// Positions of the states along the motion, and weights of an interpolation that is exact for cubics.
const BOTH_SIDES: [(f64, f64); 4] = [
    (-2.0, -1.0 / 6.0),
    (-1.0, 2.0 / 3.0),
    (1.0, 2.0 / 3.0),
    (2.0, -1.0 / 6.0),
];

/// Positions and weights on one side only: an extrapolation that is exact for lines.
const AHEAD: [(f64, f64); 2] = [(1.0, 2.0), (2.0, -1.0)];

impl Loops {
    /// Replaces the rates of `state` by their limit along the motion. This also removes the component across a
    /// constraint that is dependent at this state only, not before and after it.
    pub(super) fn limit_rates(&mut self, state: &mut State, workspace: &mut Workspace) {
        let rates = |_: &mut Self, there: &State, _: &mut Workspace, out: &mut DVector<f64>| {
            out.copy_from(&there.qd);
        };
        let size = state.qd.amax();
        if size > STILL
            && self.interpolate(state, workspace, &state.qd, &BOTH_SIDES, rates)
            && let Some(nearby) = &self.nearby
        {
            state.qd.copy_from(&nearby.limit);
        }
    }

    /// Replaces `qdd`, which violates the constraint that is dependent at `state`, by the limit of the accelerations
    /// along the motion. The mechanism moves through such a state on a smooth branch with smooth acceleration: the
    /// acceleration is interpolated from both sides, or, from rest, extrapolated from the side to which the mechanism
    /// starts to move. Without rates and accelerations, `qdd` does not change.
    pub(super) fn limit_accelerations(
        &mut self,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
        qdd: &mut DVector<f64>,
    ) {
        let (direction, positions): (_, &[_]) = if state.qd.amax() > STILL {
            (&state.qd, &BOTH_SIDES)
        } else if qdd.amax() > STILL {
            (&*qdd, &AHEAD)
        } else {
            return;
        };
        let found = self.interpolate(
            state,
            workspace,
            direction,
            positions,
            |s, there, w, out| {
                w.set_motion(there);
                s.constrained_accelerations(there, w, input, out);
            },
        );
        workspace.set_motion(state);
        if let Some(nearby) = &mut self.nearby {
            // Restores the bias forces at `state` in the workspace.
            workspace.accelerations(state, input, &mut nearby.value);
            if found {
                qdd.copy_from(&nearby.limit);
            }
        }
    }

    /// Interpolates `value` at `state` from its values at `positions` along `direction`, into the scratch's `limit`. Returns
    /// whether the constraints are independent at all of them. `workspace` must have the positions of `state`, and has them
    /// on return.
    fn interpolate(
        &mut self,
        state: &State,
        workspace: &mut Workspace,
        direction: &DVector<f64>,
        positions: &[(f64, f64)],
        mut value: impl FnMut(&mut Self, &State, &mut Workspace, &mut DVector<f64>),
    ) -> bool {
        // This is called while a nearby state is projected: do not recurse.
        let Some(mut nearby) = self.nearby.take() else {
            return false;
        };
        let gap = self.gap_before;
        let mut distance = DISTANCE.max(gap / self.length);
        let mut found = false;
        for _ in 0..ATTEMPTS {
            let step = distance / direction.amax();
            let NearbyState {
                state: there,
                value: f,
                limit,
            } = &mut *nearby;
            limit.fill(0.0);
            found = positions.iter().all(|(position, weight)| {
                there.copy_from(state);
                there.q.axpy(position * step, direction, 1.0);
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
        self.nearby = Some(nearby);
        found
    }
}
