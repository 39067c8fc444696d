//! Envelope (skyline) storage and Cholesky factorisation of a symmetric positive definite matrix of 3 × 3 blocks.
//!
//! Each row of blocks is stored from its first nonzero block to the diagonal. The factorisation computes nine dot products
//! at a time, of three rows with three rows, with SIMD.

use pulp::{Arch, Simd, WithSimd};

/// Lower triangle of a symmetric matrix by rows of blocks, each from its first nonzero block. The Cholesky factor has the
/// same envelope. Entries above the diagonal within a diagonal block are unspecified.
#[derive(Debug, Clone)]
pub struct Envelope {
    /// First stored block of each row of blocks.
    firsts: Vec<usize>,
    /// Index in `values` where it begins: three rows, one after another.
    begins: Vec<usize>,
    values: Vec<f64>,
    /// Inverse diagonal of the factor.
    inverse_diagonal: Vec<f64>,
    arch: Arch,
}

impl Envelope {
    /// Zeros, with row `i` of blocks stored from block `firsts[i] <= i`.
    pub fn new(firsts: Vec<usize>) -> Self {
        let mut begins = Vec::with_capacity(firsts.len());
        let mut length = 0;
        for (i, first) in firsts.iter().enumerate() {
            begins.push(length);
            length += 9 * (i + 1 - first);
        }
        Self {
            inverse_diagonal: vec![0.0; 3 * firsts.len()],
            firsts,
            begins,
            values: vec![0.0; length],
            arch: Arch::new(),
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        3 * self.firsts.len()
    }

    /// Indices of a row in `values`.
    #[inline]
    fn range(&self, row: usize) -> std::ops::Range<usize> {
        let block = row / 3;
        let length = 3 * (block + 1 - self.firsts[block]);
        let begin = self.begins[block] + row % 3 * length;
        begin..begin + length
    }

    /// First stored column of a row, and its entries.
    #[inline]
    pub fn row_mut(&mut self, row: usize) -> (usize, &mut [f64]) {
        let range = self.range(row);
        (3 * self.firsts[row / 3], &mut self.values[range])
    }

    /// An entry inside the envelope.
    #[inline]
    pub fn at(&mut self, row: usize, column: usize) -> &mut f64 {
        let (start, values) = self.row_mut(row);
        &mut values[column - start]
    }

    /// The value of an entry; zero outside the envelope.
    pub fn entry(&self, row: usize, column: usize) -> f64 {
        let start = 3 * self.firsts[row / 3];
        match column < start {
            true => 0.0,
            false => self.values[self.range(row)][column - start],
        }
    }

    /// Subtracts `Wᵀ W`. `W` has three columns for each of `blocks` (ascending); its rows are stored one after another,
    /// each padded with zeros to [`row_length`].
    pub fn subtract_product(&mut self, blocks: &[usize], w: &[f64], line: &mut Vec<f64>) {
        if !w.is_empty() {
            line.resize(row_length(blocks.len()), 0.0);
            self.arch.dispatch(Product {
                envelope: self,
                blocks,
                w,
                line,
            });
        }
    }

    /// Replaces the matrix by its Cholesky factor; false if it is not positive definite.
    pub fn factor(&mut self) -> bool {
        self.arch.dispatch(Factor(self))
    }

    /// Solves with the factor, in place.
    pub fn solve(&self, x: &mut [f64]) {
        for i in 0..self.rows() {
            let (start, own) = (3 * self.firsts[i / 3], &self.values[self.range(i)]);
            x[i] = (x[i] - dot(&own[..i - start], &x[start..i])) * self.inverse_diagonal[i];
        }
        for i in (0..self.rows()).rev() {
            let (start, own) = (3 * self.firsts[i / 3], &self.values[self.range(i)]);
            let value = x[i] * self.inverse_diagonal[i];
            x[i] = value;
            for (x, factor) in x[start..i].iter_mut().zip(own) {
                *x -= factor * value;
            }
        }
    }
}

/// Length of a row of `W` in [`Envelope::subtract_product`], padded to whole registers.
pub const fn row_length(blocks: usize) -> usize {
    (3 * blocks).next_multiple_of(8)
}

/// Subtraction of `Wᵀ W`, as a SIMD kernel.
struct Product<'a> {
    envelope: &'a mut Envelope,
    blocks: &'a [usize],
    w: &'a [f64],
    /// Scratch for a row of the product.
    line: &'a mut [f64],
}

impl WithSimd for Product<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            envelope,
            blocks,
            w,
            line,
        } = self;
        let stride = line.len();
        for (k, block) in blocks.iter().enumerate() {
            for a in 0..3 {
                let line = &mut line[..row_length(k + 1)];
                for (c, into) in S::as_mut_simd_f64s(line).0.iter_mut().enumerate() {
                    let mut sum = simd.splat_f64s(0.0);
                    for w in w.chunks_exact(stride) {
                        let factor = simd.splat_f64s(w[3 * k + a]);
                        sum = simd.mul_add_e_f64s(factor, S::as_simd_f64s(w).0[c], sum);
                    }
                    *into = sum;
                }
                let (start, values) = envelope.row_mut(3 * block + a);
                for (block, product) in blocks[..=k].iter().zip(line.chunks_exact(3)) {
                    let at = 3 * block - start;
                    let into = &mut values[at..at + 3];
                    into[0] -= product[0];
                    into[1] -= product[1];
                    into[2] -= product[2];
                }
            }
        }
    }
}

/// The factorisation, as a SIMD kernel.
struct Factor<'a>(&'a mut Envelope);

impl WithSimd for Factor<'_> {
    type Output = bool;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Envelope {
            firsts,
            begins,
            values,
            inverse_diagonal,
            ..
        } = self.0;
        for (j, &first) in firsts.iter().enumerate() {
            let length = 3 * (j + 1 - first);
            let (above, own) = values.split_at_mut(begins[j]);
            for k in first..=j {
                let from = first.max(firsts[k]);
                let (at, width) = (3 * (from - first), 3 * (k - from));
                // No closures: they would not be inlined into the SIMD kernel.
                let here = three(&own[at..], length, width);
                let other_length = 3 * (k + 1 - firsts[k]);
                let sums = if k == j {
                    products(simd, here, here)
                } else {
                    let begin = begins[k] + 3 * (from - firsts[k]);
                    products(simd, here, three(&above[begin..], other_length, width))
                };
                let column = 3 * (k - first);
                if k < j {
                    let inverse_diagonal = &inverse_diagonal[3 * k..3 * k + 3];
                    let [_, second, third] = three(&above[begins[k]..], other_length, other_length);
                    let diagonal = other_length - 3;
                    let (l10, l20, l21) = (second[diagonal], third[diagonal], third[diagonal + 1]);
                    for (a, sums) in sums.iter().enumerate() {
                        let row = &mut own[a * length + column..][..3];
                        row[0] = (row[0] - sums[0]) * inverse_diagonal[0];
                        row[1] = (row[1] - sums[1] - row[0] * l10) * inverse_diagonal[1];
                        row[2] =
                            (row[2] - sums[2] - row[0] * l20 - row[1] * l21) * inverse_diagonal[2];
                    }
                    continue;
                }
                for a in 0..3 {
                    for b in 0..=a {
                        let mut sum = own[a * length + column + b] - sums[a][b];
                        for c in 0..b {
                            sum -= own[a * length + column + c] * own[b * length + column + c];
                        }
                        if a > b {
                            own[a * length + column + b] = sum * inverse_diagonal[3 * j + b];
                        } else if sum > 0.0 && sum.is_finite() {
                            own[a * length + column + a] = sum.sqrt();
                            inverse_diagonal[3 * j + a] = sum.sqrt().recip();
                        } else {
                            return false;
                        }
                    }
                }
            }
        }
        true
    }
}

/// The first `width` entries of three consecutive rows.
#[inline(always)]
fn three(rows: &[f64], length: usize, width: usize) -> [&[f64]; 3] {
    [
        &rows[..width],
        &rows[length..][..width],
        &rows[2 * length..][..width],
    ]
}

/// Dot products of each of three rows with each of three others.
#[inline(always)]
pub fn products<S: Simd>(simd: S, a: [&[f64]; 3], b: [&[f64]; 3]) -> [[f64; 3]; 3] {
    let mut sums = [[simd.splat_f64s(0.0); 3]; 3];
    let [a0, a1, a2] = lanes::<S>(a);
    let [b0, b1, b2] = lanes::<S>(b);
    for c in 0..a0.len() {
        add(
            simd,
            &mut sums,
            [a0[c], a1[c], a2[c]],
            [b0[c], b1[c], b2[c]],
        );
    }
    let vectorised = a0.len() * S::F64_LANES;
    if vectorised < a[0].len() {
        let last = [
            [
                simd.partial_load_f64s(&a[0][vectorised..]),
                simd.partial_load_f64s(&a[1][vectorised..]),
                simd.partial_load_f64s(&a[2][vectorised..]),
            ],
            [
                simd.partial_load_f64s(&b[0][vectorised..]),
                simd.partial_load_f64s(&b[1][vectorised..]),
                simd.partial_load_f64s(&b[2][vectorised..]),
            ],
        ];
        add(simd, &mut sums, last[0], last[1]);
    }
    let mut out = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            out[i][j] = simd.reduce_sum_f64s(sums[i][j]);
        }
    }
    out
}

/// The rows as whole registers; the remainder is left out.
#[inline(always)]
fn lanes<S: Simd>(rows: [&[f64]; 3]) -> [&[S::f64s]; 3] {
    let first = S::as_simd_f64s(rows[0]).0;
    let count = first.len();
    [
        first,
        &S::as_simd_f64s(rows[1]).0[..count],
        &S::as_simd_f64s(rows[2]).0[..count],
    ]
}

#[inline(always)]
fn add<S: Simd>(simd: S, sums: &mut [[S::f64s; 3]; 3], x: [S::f64s; 3], y: [S::f64s; 3]) {
    for i in 0..3 {
        for j in 0..3 {
            sums[i][j] = simd.mul_add_e_f64s(x[i], y[j], sums[i][j]);
        }
    }
}

/// `a b + c` with one instruction where the processor has one.
#[inline(always)]
pub fn mul_add<S: Simd>(a: f64, b: f64, c: f64) -> f64 {
    // Processors with so many lanes have it; elsewhere it may be a function of the C library.
    match S::F64_LANES >= 4 {
        true => a.mul_add(b, c),
        false => a * b + c,
    }
}

/// Dot product with four independent sums, so that additions need not wait for each other.
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

    /// A matrix whose rows begin at different blocks, dense and in envelope storage.
    fn matrix() -> (DMatrix<f64>, Envelope) {
        let firsts = vec![0, 0, 1, 1, 3, 0, 4, 7, 2, 0];
        let n = 3 * firsts.len();
        let mut dense = DMatrix::<f64>::zeros(n, n);
        let mut envelope = Envelope::new(firsts.clone());
        for i in 0..n {
            for j in 3 * firsts[i / 3]..=i {
                let value = if i == j {
                    40.0
                } else {
                    ((3 * i + 5 * j) % 7) as f64 - 3.0
                };
                dense[(i, j)] = value;
                dense[(j, i)] = value;
                *envelope.at(i, j) = value;
            }
        }
        (dense, envelope)
    }

    #[test]
    fn factor_and_solution_equal_those_of_the_dense_matrix_at_every_simd_width() {
        let (dense, stored) = matrix();
        let n = dense.nrows();
        let right = DVector::from_fn(n, |i, _| i as f64 - 2.5);
        let expected = dense.cholesky().unwrap();
        for arch in [Arch::Scalar, Arch::new()] {
            let mut envelope = stored.clone();
            envelope.arch = arch;
            assert!(envelope.factor());
            let mut x: Vec<f64> = right.iter().copied().collect();
            envelope.solve(&mut x);
            assert!((DVector::from_vec(x) - expected.solve(&right)).norm() < 1e-12);
            for (row, column) in [(16, 4), (29, 28), (29, 0), (25, 8)] {
                let off = envelope.entry(row, column) - expected.l()[(row, column)];
                assert!(off.abs() < 1e-13, "{row} {column}");
            }
            assert_eq!(envelope.entry(13, 2), 0.0);
        }
    }

    #[test]
    fn a_product_is_subtracted_from_its_blocks() {
        let blocks = [0, 1, 5];
        let stride = row_length(blocks.len());
        let mut w = vec![0.0; 2 * stride];
        let mut spread = DMatrix::<f64>::zeros(2, 30);
        for (l, row) in w.chunks_exact_mut(stride).enumerate() {
            for (k, w) in row[..9].iter_mut().enumerate() {
                *w = ((5 * k + 3 * l) % 11) as f64 - 4.0;
                spread[(l, 3 * blocks[k / 3] + k % 3)] = *w;
            }
        }
        let (dense, mut envelope) = matrix();
        envelope.subtract_product(&blocks, &w, &mut Vec::new());
        let expected = dense - spread.tr_mul(&spread);
        for i in 0..30 {
            for j in 0..=i {
                assert_eq!(envelope.entry(i, j), expected[(i, j)], "{i} {j}");
            }
        }
    }

    #[test]
    fn an_indefinite_matrix_is_reported() {
        let mut envelope = Envelope::new(vec![0]);
        for i in 0..3 {
            *envelope.at(i, i) = 1.0;
        }
        *envelope.at(1, 0) = 2.0;
        assert!(!envelope.factor());
    }
}
