//! The constraints' normals in the metric of the reduced inertia.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// An orthonormal basis of the constraints' normals in the coordinates `y = Lᵀ q̇` (`Ĥ = L Lᵀ`), in which kinetic
/// energy is `yᵀy/2`: `L⁻¹ Jᵀ P = Q R` by Gram-Schmidt with pivoting. Choosing the largest remainder first reveals the
/// rank; normals with a remainder below the tolerance depend on the chosen ones, and are dropped. No matrix is
/// multiplied by its transpose, so that the relative error is `1e-16 / tolerance`.
#[derive(Debug, Clone)]
pub(super) struct Normals {
    /// `L` in the lower triangle.
    factor: DMatrix<f64>,
    /// Columns of `Q` first, remainders of dropped normals behind them.
    basis: DMatrix<f64>,
    /// `R`, for all columns in the order taken.
    r: DMatrix<f64>,
    /// Constraint of each column.
    order: Vec<usize>,
    /// Closure of each constraint.
    closure: Vec<usize>,
    /// Size of the largest normal of each closure, to which remainders are compared.
    size: Vec<f64>,
    rank: usize,
    /// Coordinates along the basis.
    along: DVector<f64>,
    /// A vector in the coordinates `y`.
    y: DVector<f64>,
}

impl Normals {
    /// Scratch; `closure` gives the closure of each constraint.
    pub(super) fn new(joints: usize, closure: Vec<usize>) -> Self {
        let constraints = closure.len();
        Self {
            factor: DMatrix::zeros(joints, joints),
            basis: DMatrix::zeros(joints, constraints),
            r: DMatrix::zeros(constraints, constraints),
            order: (0..constraints).collect(),
            size: vec![0.0; closure.last().map_or(0, |last| last + 1)],
            closure,
            rank: 0,
            along: DVector::zeros(constraints),
            y: DVector::zeros(joints),
        }
    }

    /// Number of independent constraints.
    pub(super) fn rank(&self) -> usize {
        self.rank
    }

    /// Computes the basis from the reduced inertia and the constraints' gradients (one per column). Normals are dropped
    /// if their remainder is below `tolerance` times the largest normal of their closure.
    pub(super) fn set(&mut self, mass: &DMatrix<f64>, gradients: &DMatrix<f64>, tolerance: f64) {
        self.basis.copy_from(gradients);
        self.rank = 0;
        self.set_factor(mass);
        self.factor.solve_lower_triangular_mut(&mut self.basis);
        for (k, constraint) in self.order.iter_mut().enumerate() {
            *constraint = k;
        }
        self.r.fill(0.0);
        let constraints = self.order.len();
        self.size.fill(0.0);
        for (column, closure) in self.basis.column_iter().zip(&self.closure) {
            self.size[*closure] = self.size[*closure].max(column.norm());
        }
        for k in 0..constraints.min(self.basis.nrows()) {
            let remainder = |c: usize| self.basis.column(c).norm() / self.size_of(c);
            let pivot = (k + 1..constraints).fold((k, remainder(k)), |best, c| {
                let size = remainder(c);
                if size > best.1 { (c, size) } else { best }
            });
            self.basis.swap_columns(k, pivot.0);
            self.r.swap_columns(k, pivot.0);
            self.order.swap(k, pivot.0);
            // Orthogonalize again, since cancellation leaves remainders not quite orthogonal.
            for i in 0..k {
                self.r[(i, k)] += self.orthogonalize(i, k);
            }
            let size = self.basis.column(k).norm();
            // NaN also ends the loop.
            if size.is_nan() || size <= tolerance * self.size_of(k) {
                break;
            }
            self.r[(k, k)] = size;
            self.basis.column_mut(k).unscale_mut(size);
            for c in k + 1..constraints {
                self.r[(k, c)] = self.orthogonalize(k, c);
            }
            self.rank = k + 1;
        }
    }

    /// The largest normal of the closure that column `c` belongs to.
    fn size_of(&self, c: usize) -> f64 {
        self.size[self.closure[self.order[c]]]
    }

    /// Removes the component of column `c` along the basis vector `k < c`; returns it.
    fn orthogonalize(&mut self, k: usize, c: usize) -> f64 {
        let n = self.basis.nrows();
        let (known, rest) = self.basis.as_mut_slice().split_at_mut(c * n);
        let (known, column) = (&known[k * n..(k + 1) * n], &mut rest[..n]);
        let share: f64 = known.iter().zip(&*column).map(|(a, b)| a * b).sum();
        for (entry, known) in column.iter_mut().zip(known) {
            *entry -= share * known;
        }
        share
    }

    /// Factorizes the reduced inertia without allocating.
    fn set_factor(&mut self, mass: &DMatrix<f64>) {
        self.factor.copy_from(mass);
        let matrix = std::mem::replace(&mut self.factor, DMatrix::zeros(0, 0));
        self.factor = match Cholesky::<f64, Dyn>::new(matrix) {
            Some(cholesky) => cholesky.unpack_dirty(),
            // Only for positions that are not finite: NaN then propagates to every result.
            None => DMatrix::from_element(mass.nrows(), mass.ncols(), f64::NAN),
        };
    }

    /// Adds to `into` the smallest change of joint rates (or positions, accelerations), in the metric of the reduced inertia,
    /// that changes each constraint by its entry of `target`.
    pub(super) fn add_smallest_change(&mut self, target: &DVector<f64>, into: &mut DVector<f64>) {
        for k in 0..self.rank {
            let known: f64 = (0..k).map(|i| self.r[(i, k)] * self.along[i]).sum();
            self.along[k] = (target[self.order[k]] - known) / self.r[(k, k)];
        }
        self.add_along(1.0, into);
    }

    /// Removes from `rates` the components across the constraints.
    pub(super) fn remove_normal(&mut self, rates: &mut DVector<f64>) {
        self.y.copy_from(rates);
        // y = Lᵀ q̇ in place: each entry from those after it, which are still q̇.
        let n = self.y.len();
        for i in 0..n {
            self.y[i] = (i..n).map(|j| self.factor[(j, i)] * self.y[j]).sum();
        }
        for k in 0..self.rank {
            self.along[k] = self.basis.column(k).dot(&self.y);
        }
        self.add_along(-1.0, rates);
    }

    /// Adds `sign` times the change with coordinates `along`.
    fn add_along(&mut self, sign: f64, into: &mut DVector<f64>) {
        self.y.fill(0.0);
        for k in 0..self.rank {
            self.y
                .axpy(sign * self.along[k], &self.basis.column(k), 1.0);
        }
        self.factor.ad_solve_lower_triangular_mut(&mut self.y);
        *into += &self.y;
    }

    /// Multipliers of the constraints for the last [`Normals::add_smallest_change`], zero for dropped normals; and whether
    /// each is uniquely determined.
    pub(super) fn multipliers(&self) -> Vec<(f64, bool)> {
        let (rank, constraints) = (self.rank, self.order.len());
        // R₁ [λ, dependence] = [along, R₂]
        let mut solved = DMatrix::zeros(rank, 1 + constraints - rank);
        for i in 0..rank {
            solved[(i, 0)] = self.along[i];
            for c in rank..constraints {
                solved[(i, 1 + c - rank)] = self.r[(i, c)];
            }
        }
        self.r
            .view((0, 0), (rank, rank))
            .solve_upper_triangular_mut(&mut solved);
        let mut out = vec![(0.0, false); constraints];
        for k in 0..rank {
            let depends = (1..solved.ncols()).any(|c| solved[(k, c)].abs() > 1e-6);
            out[self.order[k]] = (solved[(k, 0)], !depends);
        }
        out
    }
}
