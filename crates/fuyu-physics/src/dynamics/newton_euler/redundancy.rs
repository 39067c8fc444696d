//! Which constraints repeat others, and which others.

use nalgebra::DVector;

use super::{Axis, MatrixMethod, Start, System, SystemError};

/// A column of which less than this is left beside those before it repeats them.
const REPEATED: f64 = 1e-8;

/// A constraint that others make already.
struct Repeated {
    hinge: usize,
    axis: Axis,
    /// The other hinges that make it.
    holders: Vec<usize>,
}

impl System {
    /// Leaves out the constraints that repeat others when the system stands as `start` says, such as those of a
    /// planar loop with four whole revolute hinges; returns hinge and axis of each. Motion stays the same. The
    /// forces that hold the system are then determined: what is left out transmits none.
    ///
    /// The start must not be a singular position, where constraints repeat others that do not elsewhere.
    ///
    /// # Errors
    /// As [`System::assemble`], but for redundancy.
    pub fn leave_out_redundant(
        &mut self,
        start: &Start,
    ) -> Result<Vec<(usize, Axis)>, SystemError> {
        let state = self.assemble_singular(start)?;
        let repeated = self.repeated(&state);
        for r in &repeated {
            self.joined[r.hinge].left_out[r.axis.index()] = true;
        }
        Ok(repeated.iter().map(|r| (r.hinge, r.axis)).collect())
    }

    pub(super) fn check_independent(&self, state: &[f64]) -> Result<(), SystemError> {
        let repeated = self.repeated(state);
        let Some(first) = repeated.first() else {
            return Ok(());
        };
        let of_hinge = || repeated.iter().filter(|r| r.hinge == first.hinge);
        let holds = |i: &usize| of_hinge().any(|r| r.holders.contains(i));
        let name = |i: usize| self.hinges[i].name.clone();
        Err(SystemError::Redundant {
            hinge: name(first.hinge),
            axes: of_hinge().map(|r| r.axis).collect(),
            others: (0..self.hinges.len()).filter(holds).map(name).collect(),
        })
    }

    /// Rank of the constraints by orthogonalizing their columns in the order of the hinges.
    fn repeated(&self, state: &[f64]) -> Vec<Repeated> {
        let columns = MatrixMethod::new(self).constraint_columns(self, state);
        // Each with its expansion in the columns before it that were kept.
        let mut kept: Vec<(usize, DVector<f64>, Vec<f64>)> = Vec::new();
        let mut repeated = Vec::new();
        for (hinge, axis, column) in columns {
            let mut rest = column;
            let mut shares = vec![0.0; kept.len()];
            // Twice, since one pass leaves rounding where columns nearly repeat.
            for _ in 0..2 {
                for ((_, direction, _), share) in kept.iter().zip(&mut shares) {
                    let part = direction.dot(&rest);
                    rest.axpy(-part, direction, 1.0);
                    *share += part;
                }
            }
            let left = rest.norm();
            if left > REPEATED {
                shares.push(left);
                kept.push((hinge, rest / left, shares));
                continue;
            }
            // Back from orthogonal directions to the columns themselves.
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
            repeated.push(Repeated {
                hinge,
                axis,
                holders,
            });
        }
        repeated
    }
}
