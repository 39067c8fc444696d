//! Constraint forces of the loop closures.

use nalgebra::DVector;

use super::Loops;
use super::constraints::scale;
use crate::dynamics::{Input, State, Workspace, checks};

impl Loops {
    /// Constraint force of each closure on frame B (the opposite acts on frame A) in each of
    /// [`Direction::ALL`](super::Direction::ALL) \[N, N m\], in A's axes and about A's origin; zero in free directions.
    /// `None` where the force is not determined: for rigid bodies, the distribution of a load among redundant
    /// constraints is undetermined, and in a singular state forces are unbounded.
    ///
    /// `state` must be on the constraints, and `workspace` must hold its positions and motion. Allocates; meant for
    /// output, not for every step.
    pub fn forces(
        &mut self,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
    ) -> Vec<[Option<f64>; 6]> {
        if self.closures.is_empty() {
            return Vec::new();
        }
        checks::same_robot("the loops", &self.model, "the workspace", workspace.model());
        checks::state(state, &self.model);
        let mut qdd = DVector::zeros(self.model.dof());
        if self.normals_at != state.q {
            self.gap_before = 0.0;
            self.set_normals(workspace, &state.q);
        }
        self.constrained_accelerations(state, workspace, input, &mut qdd);
        let singular = self.normals.rank() < self.rank;
        let mut multipliers = self.normals.multipliers().into_iter();
        let length = self.length;
        let closures = self.closures.iter().map(|closure| {
            let mut forces = [Some(0.0); 6];
            for (direction, (value, defined)) in closure.directions().zip(&mut multipliers) {
                forces[direction as usize] =
                    (defined && !singular).then_some(value * scale(direction, length));
            }
            forces
        });
        closures.collect()
    }
}
