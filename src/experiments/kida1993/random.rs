//! Pseudo-random structures, the same in every run.

use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// A source of random numbers.
pub(super) struct Random(StdRng);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(StdRng::seed_from_u64(seed))
    }

    /// A number between two limits.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    /// A number between two positive limits, uniform on a logarithmic scale.
    pub fn on_log_scale(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// An integer from `least` to `most`.
    pub fn count(&mut self, least: usize, most: usize) -> usize {
        self.0.random_range(least..=most)
    }

    /// A matrix with entries between -1 and 1.
    pub fn matrix(&mut self, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| self.between(-1.0, 1.0))
    }

    /// A symmetric matrix with eigenvalues of at least `least`.
    pub fn definite(&mut self, n: usize, least: f64) -> DMatrix<f64> {
        let A = self.matrix(n, n);
        (&A * A.transpose()).symmetric_part() + DMatrix::identity(n, n) * least
    }
}
