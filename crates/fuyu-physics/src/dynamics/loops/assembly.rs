//! From joints given approximately to a state on the constraints.

use super::constraints::scale;
use super::{Direction, LoopError, Loops};
use crate::dynamics::{State, Workspace, checks};

/// A loop is closed when its gap is below this, relative to the size of the mechanism.
const CLOSED: f64 = 1e-12;

/// Projections before a loop is given up: each is several steps of Newton's method.
const ATTEMPTS: usize = 20;

/// How far to look for a place where the mechanism is not singular \[rad, or m relative to its size\].
const NEARBY: f64 = 1e-2;

impl Loops {
    /// Moves a state that closes the loops approximately onto the constraints, positions and rates, and finds
    /// out how many constraints are independent. Gaps up to `tolerance` \[m and rad\] are closed, and
    /// rates of opening up to `tolerance` \[m/s and rad/s\] are taken off. Centre of mass and momentum
    /// stay as they are; to start from a pose of the base, set it afterwards
    /// ([`State::set_base`](crate::dynamics::State::set_base)).
    ///
    /// # Errors
    /// [`LoopError`] when a loop is open by more, cannot be closed nearby, opens at the given rates, or when
    /// the closures lock all joints.
    pub fn assemble(&mut self, state: &mut State, tolerance: f64) -> Result<(), LoopError> {
        if self.closures.is_empty() {
            return Ok(());
        }
        checks::state(state, &self.model);
        let mut workspace = Workspace::new(&self.model);
        workspace.set_positions(&state.q);
        self.set_wanted(&workspace);
        if let Some((closure, direction, gap)) = self.worst(tolerance) {
            return Err(LoopError::Open {
                closure,
                direction: direction.name(),
                gap,
                unit: direction.unit(),
                limit: tolerance,
            });
        }
        if !self.close(state, &mut workspace)
            && let Some((closure, direction, gap)) = self.worst(0.0)
        {
            return Err(LoopError::NotClosable {
                closure,
                direction: direction.name(),
                gap,
                unit: direction.unit(),
            });
        }
        self.rank = self.normals.rank();
        self.gradients.tr_mul_to(&state.qd, &mut self.wanted);
        if let Some((closure, direction, rate)) = self.worst(tolerance) {
            return Err(LoopError::Opening {
                closure,
                direction: direction.name(),
                rate,
                unit: direction.unit(),
                limit: tolerance,
            });
        }
        self.normals.remove_normal(&mut state.qd);
        self.explore(state, &mut workspace);
        if self.mobility() == 0 {
            let names: Vec<_> = self.closures.iter().map(|c| c.name.as_str()).collect();
            return Err(LoopError::Locked {
                closures: names.join(", "),
                joints: self.model.dof(),
                rank: self.rank,
            });
        }
        Ok(())
    }

    /// Projects positions until the loops are closed; whether they are. Normals are then those of a state
    /// without any gap.
    fn close(&mut self, state: &mut State, workspace: &mut Workspace) -> bool {
        let closed = (0..ATTEMPTS).any(|_| {
            self.normals_at.fill(f64::NAN);
            self.project_positions(state, workspace);
            self.set_wanted(workspace) <= CLOSED * self.length
        });
        self.gap_before = 0.0;
        self.set_normals(workspace, &state.q);
        closed
    }

    /// The constraint with the largest entry of `wanted`, if that is above `limit`.
    fn worst(&self, limit: f64) -> Option<(String, Direction, f64)> {
        let rows = (self.closures.iter()).flat_map(|c| c.directions().map(move |d| (c, d)));
        let gaps = rows.zip(self.wanted.iter());
        let gaps = gaps.map(|((c, d), wanted)| (c, d, wanted.abs() / scale(d, self.length)));
        gaps.max_by(|a, b| a.2.total_cmp(&b.2))
            .filter(|(.., gap)| *gap > limit || gap.is_nan())
            .map(|(closure, direction, gap)| (closure.name.clone(), direction, gap))
    }

    /// Looks around a state whose constraints depend on each other: if more are independent nearby, the
    /// state is a singular one of a mechanism with that many constraints.
    fn explore(&mut self, state: &State, workspace: &mut Workspace) {
        let (n, m) = (self.model.dof(), self.wanted.len());
        let mut nearby = state.clone();
        // First where it goes, then where it could.
        for attempt in 0..=n {
            if self.rank == n.min(m) {
                break;
            }
            let mut way = state.qd.clone();
            if attempt > 0 {
                way.fill(0.0);
                way[attempt - 1] = 1.0;
            }
            self.normals.remove_normal(&mut way);
            let size = way.amax();
            if size > 1e-9 {
                nearby.q.copy_from(&state.q);
                nearby.q.axpy(NEARBY / size, &way, 1.0);
                if self.close(&mut nearby, workspace) {
                    self.rank = self.rank.max(self.normals.rank());
                }
                workspace.set_positions(&state.q);
                self.set_normals(workspace, &state.q);
            }
        }
    }
}
