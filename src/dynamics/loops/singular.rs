//! Where constraints lose rank for a moment.

use nalgebra::DVector;

use super::Loops;
use crate::dynamics::{Input, State, Workspace};
use crate::model::Model;

/// How far aside to look \[rad, or m relative to the size of the mechanism\]. The limit's error is of the
/// fourth power; too near, normals have no digits left.
const ASIDE: f64 = 2e-3;

/// How often to look farther.
const WIDER: usize = 3;

/// Scratch: a state beside the singular one.
#[derive(Debug, Clone)]
pub(super) struct Aside {
    state: State,
    qdd: DVector<f64>,
    limit: DVector<f64>,
}

impl Aside {
    pub(super) fn new(model: &Model) -> Self {
        Self {
            state: State::at_rest(model),
            qdd: DVector::zeros(model.dof()),
            limit: DVector::zeros(model.dof()),
        }
    }
}

impl Loops {
    /// Replaces `qdd`, which lacks the constraint that depends on the others at `state`, by the limit of
    /// accelerations along the motion. The mechanism moves through such a state on a smooth branch, on
    /// which acceleration is smooth too: it is interpolated from both sides, or, from rest, extrapolated
    /// from the side to which the mechanism starts. Where nothing moves, nothing is replaced.
    pub(super) fn limit_accelerations(
        &mut self,
        model: &Model,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
        qdd: &mut DVector<f64>,
    ) {
        // Places and weights that are exact for cubics, and for lines.
        const BOTH_SIDES: [(f64, f64); 4] = [
            (-2.0, -1.0 / 6.0),
            (-1.0, 2.0 / 3.0),
            (1.0, 2.0 / 3.0),
            (2.0, -1.0 / 6.0),
        ];
        const AHEAD: [(f64, f64); 2] = [(1.0, 2.0), (2.0, -1.0)];
        let (moving, starting) = (state.qd.amax(), qdd.amax());
        let (places, size): (&[_], f64) = if moving > 1e-9 {
            (&BOTH_SIDES, moving)
        } else if starting > 1e-9 {
            (&AHEAD, starting)
        } else {
            return;
        };
        let Some(mut aside) = self.aside.take() else {
            return;
        };
        let mut distance = ASIDE.max(10.0 * self.gap_before / self.length);
        for _ in 0..WIDER {
            aside.limit.fill(0.0);
            let complete = places.iter().all(|(place, weight)| {
                let way = if moving > 1e-9 { &state.qd } else { &*qdd };
                let Aside {
                    state: there,
                    qdd: qdd_there,
                    limit,
                } = &mut *aside;
                there.copy_from(state);
                there.q.axpy(place * distance / size, way, 1.0);
                self.project(model, there, workspace);
                workspace.set_motion(there);
                self.constrained_accelerations(model, there, workspace, input, qdd_there);
                limit.axpy(*weight, qdd_there, 1.0);
                self.normals.rank() >= self.rank
            });
            if complete {
                qdd.copy_from(&aside.limit);
                break;
            }
            distance *= 3.0;
        }
        workspace.set_positions(model, &state.q);
        workspace.set_motion(state);
        workspace.accelerations(model, state, input, &mut aside.qdd);
        self.set_normals(workspace, &state.q);
        self.aside = Some(aside);
    }
}
