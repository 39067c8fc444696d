//! Non-negative least squares with few rows.

use nalgebra::{Cholesky, SMatrix, SVector};

/// Rows of the problem, and the largest number of unknowns that are positive.
pub const ROWS: usize = 7;

/// A column of the matrix, or the right-hand side.
pub type Column = SVector<f64, ROWS>;

/// Minimises `|A x - b|` over `x >= 0` (Lawson & Hanson 1974, algorithm 23.10). No call allocates memory.
#[derive(Debug, Clone)]
pub struct NonNegative {
    /// Indices of the unknowns that may be positive.
    passive: Vec<usize>,
    /// Unknowns that were tried without success since the last progress.
    blocked: Vec<bool>,
}

/// Gradients below this are zero, for columns and right-hand side of length near 1.
const SMALL: f64 = 1e-12;

impl NonNegative {
    /// Scratch for `unknowns` unknowns.
    pub fn new(unknowns: usize) -> Self {
        Self {
            passive: Vec::with_capacity(ROWS + 1),
            blocked: vec![false; unknowns],
        }
    }

    /// Writes the solution to `x`.
    pub fn solve(&mut self, columns: &[Column], b: &Column, x: &mut [f64]) {
        x.fill(0.0);
        self.passive.clear();
        self.blocked.fill(false);
        for _ in 0..3 * columns.len() + ROWS {
            let residual = columns
                .iter()
                .zip(&*x)
                .fold(*b, |r, (column, x)| r - column * *x);
            let candidates = (0..columns.len())
                .filter(|j| !self.blocked[*j] && !self.passive.contains(j))
                .map(|j| (j, columns[j].dot(&residual)));
            let best = candidates.max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((entering, _)) = best.filter(|(_, gradient)| *gradient > SMALL) else {
                return;
            };
            if self.passive.len() == ROWS {
                return;
            }
            self.passive.push(entering);
            if self.descend(columns, b, x) {
                self.blocked.fill(false);
            } else {
                self.blocked[entering] = true;
                self.passive.retain(|j| *j != entering);
                x[entering] = 0.0;
            }
        }
    }

    /// Moves to the minimum over the passive set, without the unknowns that would become negative. False if the columns
    /// of the set are dependent, or if the newest unknown is the first to leave.
    fn descend(&mut self, columns: &[Column], b: &Column, x: &mut [f64]) -> bool {
        let newest = *self.passive.last().unwrap_or(&0);
        while !self.passive.is_empty() {
            let Some(best) = least_squares(columns, b, &self.passive) else {
                return false;
            };
            let place = |j: usize| self.passive.iter().position(|p| *p == j);
            if place(newest).is_some_and(|i| best[i] <= 0.0 && x[newest] == 0.0) {
                return false;
            }
            // As far as no unknown becomes negative.
            let (mut step, mut leaving) = (1.0, None);
            for (i, j) in self.passive.iter().enumerate() {
                if best[i] <= 0.0 {
                    let reach = x[*j] / (x[*j] - best[i]);
                    if leaving.is_none() || reach < step {
                        (step, leaving) = (reach, Some(*j));
                    }
                }
            }
            for (i, j) in self.passive.iter().enumerate() {
                x[*j] += step * (best[i] - x[*j]);
            }
            let Some(leaving) = leaving else {
                return true;
            };
            x[leaving] = 0.0;
            self.passive.retain(|j| *j != leaving);
        }
        true
    }
}

/// Least squares over the given columns, by the normal equations; `None` if they are not independent.
fn least_squares(columns: &[Column], b: &Column, which: &[usize]) -> Option<Column> {
    let mut gram = SMatrix::<f64, ROWS, ROWS>::identity();
    let mut right = Column::zeros();
    for (i, p) in which.iter().enumerate() {
        for (k, q) in which.iter().enumerate() {
            gram[(i, k)] = columns[*p].dot(&columns[*q]);
        }
        right[i] = columns[*p].dot(b);
    }
    let factor = Cholesky::new(gram)?;
    let l = factor.l_dirty();
    let least = (0..which.len()).all(|i| l[(i, i)] > 1e-7 * gram[(i, i)].sqrt());
    least.then(|| factor.solve(&right))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    // The conditions of Kuhn and Tucker, which define the minimum: the gradient is zero where x is positive, and does
    // not point into the feasible set where x is zero.
    #[test]
    fn solutions_meet_the_conditions_of_optimality() {
        let mut random = StdRng::seed_from_u64(3);
        let mut number = || 2.0 * random.random::<f64>() - 1.0;
        for unknowns in [1, 3, 6, 8, 12, 24] {
            let mut solver = NonNegative::new(unknowns);
            let mut x = vec![0.0; unknowns];
            for _ in 0..200 {
                let columns: Vec<Column> = (0..unknowns)
                    .map(|_| Column::from_fn(|_, _| number()))
                    .collect();
                let b = Column::from_fn(|_, _| number());
                solver.solve(&columns, &b, &mut x);
                let residual = columns.iter().zip(&x).fold(b, |r, (c, x)| r - c * *x);
                for (column, x) in columns.iter().zip(&x) {
                    let gradient = column.dot(&residual);
                    assert!(*x >= 0.0);
                    assert!(gradient < 1e-9, "{unknowns}: {gradient:e}");
                    assert!(
                        *x == 0.0 || gradient.abs() < 1e-9,
                        "{unknowns}: {gradient:e}"
                    );
                }
            }
        }
    }
}
