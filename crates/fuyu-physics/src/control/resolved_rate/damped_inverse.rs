//! Damped inverse of a Jacobian, exact in directions that are not singular.

use nalgebra::{Matrix6, Matrix6xX, SymmetricEigen, U6, Vector6};

/// The principal directions of a Jacobian at the tip.
pub struct Principal {
    /// Eigenvectors of `J Jᵀ`, and the squared singular values.
    eigen: SymmetricEigen<f64, U6>,
}

impl Principal {
    /// The principal directions of `jacobian`, whose unused rows are zero.
    pub fn of(jacobian: &Matrix6xX<f64>) -> Self {
        let mut square = Matrix6::zeros();
        for column in jacobian.column_iter() {
            square.ger(1.0, &column, &column, 1.0);
        }
        Self {
            eigen: SymmetricEigen::new(square),
        }
    }

    fn singular_value(&self, i: usize) -> f64 {
        // Rounding may leave a zero slightly negative.
        self.eigen.eigenvalues[i].max(0.0).sqrt()
    }

    /// The `count`-th largest singular value; infinite if `count` is zero.
    pub fn weakest(&self, count: usize) -> f64 {
        let mut values: [f64; 6] = std::array::from_fn(|i| self.singular_value(i));
        values.sort_by(|a, b| b.total_cmp(a));
        match count {
            0 => f64::INFINITY,
            n => values[n - 1],
        }
    }

    /// `(J Jᵀ + Λ)⁻¹ v`, with `λ² = (ε² - σ²)/4` for directions whose singular value `σ` is below `threshold` (ε).
    pub fn solve(&self, v: &Vector6<f64>, threshold: f64) -> Vector6<f64> {
        let mut out = Vector6::zeros();
        for i in 0..6 {
            let (u, s) = (self.eigen.eigenvectors.column(i), self.singular_value(i));
            let damping = (threshold * threshold - s * s).max(0.0) / 4.0;
            out.axpy(u.dot(v) / (s * s + damping), &u, 1.0);
        }
        out
    }
}
