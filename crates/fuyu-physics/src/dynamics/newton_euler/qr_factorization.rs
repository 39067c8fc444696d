//! QR factorization of the constraints, with column pivoting.
//!
//! The Schur complement of the augmented inertia matrix is `GᵀG` with `G = L⁻¹Jᵀ`. Factorizing `G` itself keeps twice
//! as many digits of the accelerations as factorizing the complement. Pivoting selects columns by their norm, which
//! reveals the rank; nalgebra's pivoted QR selects single elements and allocates.

/// `G P = Q R` by Householder reflections with column pivoting, in place.
#[derive(Debug, Clone, Default)]
pub(super) struct QrFactorization {
    rows: usize,
    columns: usize,
    /// Column by column: `R` on and above the diagonal, reflection vectors from the diagonal on in `heads`.
    data: Vec<f64>,
    /// First entry of each reflection vector (its place in `data` is taken by `R`'s diagonal), and `2/|v|²`.
    heads: Vec<(f64, f64)>,
    norms: Vec<f64>,
    pub order: Vec<usize>,
    pub rank: usize,
}

impl QrFactorization {
    pub fn new(rows: usize, columns: usize) -> Self {
        Self {
            rows,
            columns,
            data: vec![0.0; rows * columns],
            heads: Vec::with_capacity(columns),
            norms: vec![0.0; columns],
            order: (0..columns).collect(),
            rank: 0,
        }
    }

    /// Sets all entries to zero.
    pub fn clear(&mut self) {
        self.data.fill(0.0);
    }

    /// Column `j` before factoring.
    pub fn column_mut(&mut self, j: usize) -> &mut [f64] {
        &mut self.data[j * self.rows..(j + 1) * self.rows]
    }

    /// Factorizes the matrix, whose columns must have unit norm. Stops when the remainders of all columns are shorter
    /// than `tolerance`.
    pub fn factor(&mut self, tolerance: f64) {
        let (rows, columns) = (self.rows, self.columns);
        self.heads.clear();
        for (j, order) in self.order.iter_mut().enumerate() {
            *order = j;
        }
        self.rank = 0;
        for k in 0..rows.min(columns) {
            for j in k..columns {
                let rest = &self.data[j * rows + k..(j + 1) * rows];
                self.norms[j] = rest.iter().map(|x| x * x).sum();
            }
            let longest = (k..columns).max_by(|a, b| self.norms[*a].total_cmp(&self.norms[*b]));
            let pivot = longest.expect("k is below the number of columns");
            let norm = self.norms[pivot].sqrt();
            if norm.is_nan() || norm <= tolerance {
                break;
            }
            if pivot != k {
                let (left, right) = self.data.split_at_mut(pivot * rows);
                left[k * rows..(k + 1) * rows].swap_with_slice(&mut right[..rows]);
                self.order.swap(k, pivot);
            }
            let (left, right) = self.data.split_at_mut((k + 1) * rows);
            let v = &mut left[k * rows + k..];
            let diagonal = if v[0] > 0.0 { -norm } else { norm };
            let head = v[0] - diagonal;
            let scale = 1.0 / (norm * (norm + v[0].abs()));
            v[0] = head;
            for column in right.chunks_exact_mut(rows) {
                reflect(v, scale, &mut column[k..]);
            }
            v[0] = diagonal;
            self.heads.push((head, scale));
            self.rank += 1;
        }
    }

    /// `x = Qᵀ x`.
    pub fn transpose_multiply(&self, x: &mut [f64]) {
        for k in 0..self.rank {
            self.reflect(k, x);
        }
    }

    /// `x = Q x`.
    pub fn multiply(&self, x: &mut [f64]) {
        for k in (0..self.rank).rev() {
            self.reflect(k, x);
        }
    }

    fn reflect(&self, k: usize, x: &mut [f64]) {
        let (head, scale) = self.heads[k];
        let v = &self.data[k * self.rows + k..(k + 1) * self.rows];
        let x = &mut x[k..];
        let tail: f64 = v[1..].iter().zip(&x[1..]).map(|(v, x)| v * x).sum();
        let s = scale * (head * x[0] + tail);
        x[0] -= s * head;
        for (x, v) in x[1..].iter_mut().zip(&v[1..]) {
            *x -= s * v;
        }
    }

    /// Solves `Rᵀ x = b` in place for the first `rank` entries.
    pub fn solve_transposed(&self, x: &mut [f64]) {
        for k in 0..self.rank {
            let column = &self.data[k * self.rows..k * self.rows + k + 1];
            let known: f64 = column[..k].iter().zip(&*x).map(|(r, x)| r * x).sum();
            x[k] = (x[k] - known) / column[k];
        }
    }

    /// Solves `R x = b` in place for the first `rank` entries.
    pub fn solve(&self, x: &mut [f64]) {
        for k in (0..self.rank).rev() {
            let column = &self.data[k * self.rows..k * self.rows + k + 1];
            x[k] /= column[k];
            let solved = x[k];
            for (x, r) in x.iter_mut().zip(&column[..k]) {
                *x -= r * solved;
            }
        }
    }
}

fn reflect(v: &[f64], scale: f64, x: &mut [f64]) {
    let s = scale * v.iter().zip(&*x).map(|(v, x)| v * x).sum::<f64>();
    for (x, v) in x.iter_mut().zip(v) {
        *x -= s * v;
    }
}
