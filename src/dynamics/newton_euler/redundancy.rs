//! Which constraints repeat others, and which others.

use nalgebra::DVector;

use super::{Axis, MatrixMethod, System, SystemError};

/// A column of which less than this is left beside those before it repeats them.
const REPEATED: f64 = 1e-8;

impl System {
    /// Rank of the constraints by orthogonalizing their columns in the order of the hinges.
    pub(super) fn check_independent(&self, state: &[f64]) -> Result<(), SystemError> {
        let columns = MatrixMethod::new(self).constraint_columns(self, state);
        // Each with its expansion in the columns before it that were kept.
        let mut kept: Vec<(usize, DVector<f64>, Vec<f64>)> = Vec::new();
        let mut repeated: Option<(usize, Vec<Axis>, Vec<bool>)> = None;
        for (hinge, axis, column) in columns {
            if repeated.as_ref().is_some_and(|(first, ..)| *first != hinge) {
                break;
            }
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
            let (_, axes, holders) =
                repeated.get_or_insert_with(|| (hinge, Vec::new(), vec![false; self.hinges.len()]));
            axes.push(axis);
            // Back from orthogonal directions to the columns themselves.
            for j in (0..kept.len()).rev() {
                let (holder, _, expansion) = &kept[j];
                let weight = shares[j] / expansion[j];
                for (share, part) in shares[..j].iter_mut().zip(expansion) {
                    *share -= weight * part;
                }
                if weight.abs() > 1e-6 && *holder != hinge {
                    holders[*holder] = true;
                }
            }
        }
        let Some((hinge, axes, holders)) = repeated else {
            return Ok(());
        };
        let name = |i: usize| self.hinges[i].name.clone();
        Err(SystemError::Redundant {
            hinge: name(hinge),
            axes,
            others: (0..holders.len())
                .filter(|i| holders[*i])
                .map(name)
                .collect(),
        })
    }
}
