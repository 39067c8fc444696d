//! Assembly: from approximate joint positions to a state on the constraints.

use super::constraints::scale;
use super::{Direction, LoopError, Loops};
use crate::dynamics::{State, Workspace, checks};

/// A loop is closed if its gap is below this, relative to the size of the mechanism.
const CLOSED: f64 = 1e-12;

/// Largest number of projections before assembly fails; each is several steps of Newton's method.
const ATTEMPTS: usize = 20;

/// Distance at which a state is searched that is not singular \[rad, or m relative to the size of the mechanism\].
const NEARBY: f64 = 1e-2;

impl Loops {
    /// Moves positions and rates of a state that closes the loops approximately onto the constraints, and determines
    /// the number of independent constraints. Closes gaps up to `tolerance` \[m and rad\] and removes rates across the
    /// constraints up to `tolerance` \[m/s and rad/s\]. Centre of mass and momentum do not change; to prescribe the
    /// pose of the base, set it afterwards ([`State::set_base`](crate::dynamics::State::set_base)).
    ///
    /// # Errors
    /// [`LoopError`] if a gap or a rate exceeds `tolerance`, if a loop cannot be closed nearby, or if the closures lock all
    /// joints.
    pub fn assemble(&mut self, state: &mut State, tolerance: f64) -> Result<(), LoopError> {
        if self.closures.is_empty() {
            return Ok(());
        }
        checks::state(state, &self.model);
        let mut workspace = Workspace::new(&self.model);
        workspace.set_positions(&state.q);
        self.set_target(&workspace);
        if let Some((closure, direction, gap)) = self.largest_violation(tolerance) {
            return Err(LoopError::Open {
                closure,
                direction: direction.name(),
                gap,
                unit: direction.unit(),
                limit: tolerance,
            });
        }
        if !self.close(state, &mut workspace)
            && let Some((closure, direction, gap)) = self.largest_violation(0.0)
        {
            return Err(LoopError::NotClosable {
                closure,
                direction: direction.name(),
                gap,
                unit: direction.unit(),
            });
        }
        self.rank = self.normals.rank();
        self.gradients.tr_mul_to(&state.qd, &mut self.target);
        if let Some((closure, direction, rate)) = self.largest_violation(tolerance) {
            return Err(LoopError::Opening {
                closure,
                direction: direction.name(),
                rate,
                unit: direction.unit(),
                limit: tolerance,
            });
        }
        self.normals.remove_normal(&mut state.qd);
        self.set_rank_from_nearby(state, &mut workspace);
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

    /// Projects positions until the loops are closed, and sets the normals of the closed state. Returns whether the
    /// loops are closed.
    fn close(&mut self, state: &mut State, workspace: &mut Workspace) -> bool {
        let closed = (0..ATTEMPTS).any(|_| {
            self.normals_at.fill(f64::NAN);
            self.project_positions(state, workspace);
            self.set_target(workspace) <= CLOSED * self.length
        });
        self.gap_before = 0.0;
        self.set_normals(workspace, &state.q);
        closed
    }

    /// The constraint with the largest entry of `target`, if that is above `limit`.
    fn largest_violation(&self, limit: f64) -> Option<(String, Direction, f64)> {
        let rows = (self.closures.iter()).flat_map(|c| c.directions().map(move |d| (c, d)));
        let gaps = rows.zip(self.target.iter());
        let gaps = gaps.map(|((c, d), target)| (c, d, target.abs() / scale(d, self.length)));
        gaps.max_by(|a, b| a.2.total_cmp(&b.2))
            .filter(|(.., gap)| *gap > limit || gap.is_nan())
            .map(|(closure, direction, gap)| (closure.name.clone(), direction, gap))
    }

    /// Determines the rank of the constraints from nearby states if they depend on each other at this one: if more
    /// constraints are independent nearby, this state is singular.
    fn set_rank_from_nearby(&mut self, state: &State, workspace: &mut Workspace) {
        let (n, m) = (self.model.dof(), self.target.len());
        let mut nearby = state.clone();
        // First along the present rates, then along each joint.
        for attempt in 0..=n {
            if self.rank == n.min(m) {
                break;
            }
            let mut direction = state.qd.clone();
            if attempt > 0 {
                direction.fill(0.0);
                direction[attempt - 1] = 1.0;
            }
            self.normals.remove_normal(&mut direction);
            let size = direction.amax();
            if size > 1e-9 {
                nearby.q.copy_from(&state.q);
                nearby.q.axpy(NEARBY / size, &direction, 1.0);
                if self.close(&mut nearby, workspace) {
                    self.rank = self.rank.max(self.normals.rank());
                }
                workspace.set_positions(&state.q);
                self.set_normals(workspace, &state.q);
            }
        }
    }
}
