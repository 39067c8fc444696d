//! Redundant constraints, and the constraints on which they depend.

use nalgebra::DVector;

use super::{Axis, MatrixMethod, Start, System, SystemError};

/// A column whose remainder is below this depends on the previous ones.
const DEPENDENT: f64 = 1e-8;

/// A redundant constraint.
struct Redundant {
    hinge: usize,
    axis: Axis,
    /// The other hinges that constrain the same direction.
    holders: Vec<usize>,
}

impl System {
    /// Removes constraints that are redundant at `start`, such as those of a planar loop with four revolute hinges; returns
    /// hinge and axis of each. The motion does not change, and all constraint forces are then determined; those of removed
    /// constraints are zero.
    ///
    /// The start must not be a singular position, where constraints are redundant that are not elsewhere.
    ///
    /// # Errors
    /// As [`System::assemble`], except for redundancy.
    pub fn leave_out_redundant(
        &mut self,
        start: &Start,
    ) -> Result<Vec<(usize, Axis)>, SystemError> {
        let state = self.assemble_singular(start)?;
        let redundant = self.redundant_constraints(&state);
        for r in &redundant {
            self.joined[r.hinge].left_out[r.axis.index()] = true;
        }
        Ok(redundant.iter().map(|r| (r.hinge, r.axis)).collect())
    }

    pub(super) fn check_independent(&self, state: &[f64]) -> Result<(), SystemError> {
        let redundant = self.redundant_constraints(state);
        let Some(first) = redundant.first() else {
            return Ok(());
        };
        let of_hinge = || redundant.iter().filter(|r| r.hinge == first.hinge);
        let holds = |i: &usize| of_hinge().any(|r| r.holders.contains(i));
        let name = |i: usize| self.hinges[i].name.clone();
        Err(SystemError::Redundant {
            hinge: name(first.hinge),
            axes: of_hinge().map(|r| r.axis).collect(),
            others: (0..self.hinges.len()).filter(holds).map(name).collect(),
        })
    }

    /// Rank of the constraints by orthogonalizing their columns in the order of the hinges.
    fn redundant_constraints(&self, state: &[f64]) -> Vec<Redundant> {
        let columns = MatrixMethod::new(self).constraint_columns(self, state);
        // Each kept column, with its expansion in the columns kept before it.
        let mut kept: Vec<(usize, DVector<f64>, Vec<f64>)> = Vec::new();
        let mut redundant = Vec::new();
        for (hinge, axis, column) in columns {
            let mut rest = column;
            let mut shares = vec![0.0; kept.len()];
            // Twice, since one pass leaves rounding errors where columns nearly depend on each other.
            for _ in 0..2 {
                for ((_, direction, _), share) in kept.iter().zip(&mut shares) {
                    let part = direction.dot(&rest);
                    rest.axpy(-part, direction, 1.0);
                    *share += part;
                }
            }
            let remainder = rest.norm();
            if remainder > DEPENDENT {
                shares.push(remainder);
                kept.push((hinge, rest / remainder, shares));
                continue;
            }
            // The expansion in the columns, from that in the orthogonal directions.
            let mut holders = Vec::new();
            for j in (0..kept.len()).rev() {
                let (holder, _, expansion) = &kept[j];
                let weight = shares[j] / expansion[j];
                for (share, part) in shares[..j].iter_mut().zip(expansion) {
                    *share -= weight * part;
                }
                if weight.abs() > 1e-6 && *holder != hinge {
                    holders.push(*holder);
                }
            }
            redundant.push(Redundant {
                hinge,
                axis,
                holders,
            });
        }
        redundant
    }
}
