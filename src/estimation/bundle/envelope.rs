//! A symmetric positive matrix stored from the first entry of each row that is not zero to the diagonal.

use nalgebra::Matrix3;

/// Lower triangle of a symmetric matrix by rows; each row starts where it has its first entry. A Cholesky factor
/// fits into the same envelope.
#[derive(Debug, Clone)]
pub struct Envelope {
    starts: Vec<usize>,
    /// Position of row `i`'s column 0 in `values`, were it stored.
    offsets: Vec<isize>,
    values: Vec<f64>,
}

impl Envelope {
    /// Zeros, with row `i` stored from column `starts[i] <= i`.
    pub fn new(starts: Vec<usize>) -> Self {
        let mut offsets = Vec::with_capacity(starts.len());
        let mut length = 0;
        for (i, start) in starts.iter().enumerate() {
            offsets.push(length as isize - *start as isize);
            length += i + 1 - start;
        }
        Self {
            starts,
            offsets,
            values: vec![0.0; length],
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.starts.len()
    }

    #[inline]
    fn position(&self, row: usize, column: usize) -> usize {
        debug_assert!(column <= row && column >= self.starts[row]);
        (self.offsets[row] + column as isize) as usize
    }

    /// The entry in a row and a column of its envelope.
    #[inline]
    pub fn at(&mut self, row: usize, column: usize) -> &mut f64 {
        let position = self.position(row, column);
        &mut self.values[position]
    }

    /// The value there; zero outside the envelope.
    pub fn entry(&self, row: usize, column: usize) -> f64 {
        if column < self.starts[row] {
            return 0.0;
        }
        self.values[self.position(row, column)]
    }

    /// Subtracts a 3 × 3 block whose first entry is (`row`, `column`), `row >= column`; on the diagonal only
    /// its lower half.
    #[inline]
    pub fn subtract_block(&mut self, row: usize, column: usize, block: &Matrix3<f64>) {
        for a in 0..3 {
            let width = if row == column { a + 1 } else { 3 };
            let position = self.position(row + a, column);
            let into = &mut self.values[position..position + width];
            for (b, value) in into.iter_mut().enumerate() {
                *value -= block[(a, b)];
            }
        }
    }

    /// Replaces the matrix by its Cholesky factor; false if it is not positive definite.
    pub fn factor(&mut self) -> bool {
        for i in 0..self.rows() {
            let start = self.starts[i];
            let row = (self.offsets[i] + start as isize) as usize;
            let (above, own) = self.values.split_at_mut(row);
            for j in start..i {
                let from = start.max(self.starts[j]);
                let other = (self.offsets[j] + from as isize) as usize;
                let (left, right) = (&own[from - start..j - start], &above[other..]);
                let sum = own[j - start] - dot(left, &right[..j - from]);
                own[j - start] = sum / above[(self.offsets[j] + j as isize) as usize];
            }
            let pivot = own[i - start] - dot(&own[..i - start], &own[..i - start]);
            if !(pivot > 0.0 && pivot.is_finite()) {
                return false;
            }
            own[i - start] = pivot.sqrt();
        }
        true
    }

    /// Solves with the factor, in place.
    pub fn solve(&self, x: &mut [f64]) {
        for i in 0..self.rows() {
            let start = self.starts[i];
            let row = (self.offsets[i] + start as isize) as usize;
            let own = &self.values[row..=row + i - start];
            let sum = x[i] - dot(&own[..i - start], &x[start..i]);
            x[i] = sum / own[i - start];
        }
        for i in (0..self.rows()).rev() {
            let start = self.starts[i];
            let row = (self.offsets[i] + start as isize) as usize;
            let own = &self.values[row..=row + i - start];
            x[i] /= own[i - start];
            let value = x[i];
            for (x, factor) in x[start..i].iter_mut().zip(own) {
                *x -= factor * value;
            }
        }
    }
}

/// Four sums side by side, so that the processor need not wait for each addition.
#[inline]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = (a4.remainder().iter().zip(b4.remainder()))
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in a4.zip(b4) {
        for k in 0..4 {
            sums[k] += x[k] * y[k];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn factor_and_solution_are_those_of_the_dense_matrix() {
        let starts = vec![0, 0, 1, 1, 3, 0, 4, 7];
        let n = starts.len();
        let mut dense = DMatrix::<f64>::zeros(n, n);
        let mut envelope = Envelope::new(starts.clone());
        for i in 0..n {
            for j in starts[i]..=i {
                let value = if i == j {
                    9.0
                } else {
                    ((3 * i + 5 * j) % 7) as f64 - 3.0
                };
                dense[(i, j)] = value;
                dense[(j, i)] = value;
                *envelope.at(i, j) = value;
            }
        }
        let right = DVector::from_fn(n, |i, _| i as f64 - 2.5);
        assert!(envelope.factor());
        let mut x: Vec<f64> = right.iter().copied().collect();
        envelope.solve(&mut x);
        let expected = dense.cholesky().unwrap();
        assert!((DVector::from_vec(x) - expected.solve(&right)).norm() < 1e-12);
        assert!((envelope.entry(6, 4) - expected.l()[(6, 4)]).abs() < 1e-13);
        assert_eq!(envelope.entry(6, 2), 0.0);
    }

    #[test]
    fn an_indefinite_matrix_is_told() {
        let mut envelope = Envelope::new(vec![0, 0]);
        *envelope.at(0, 0) = 1.0;
        *envelope.at(1, 0) = 2.0;
        *envelope.at(1, 1) = 1.0;
        assert!(!envelope.factor());
    }
}
