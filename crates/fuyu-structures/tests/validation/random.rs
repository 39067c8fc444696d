//! Random structures.

use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng, rngs::StdRng};

pub struct Random(StdRng);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(StdRng::seed_from_u64(seed))
    }

    /// Between -1 and 1.
    pub fn number(&mut self) -> f64 {
        self.0.random_range(-1.0..1.0)
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    pub fn count(&mut self, low: usize, high: usize) -> usize {
        self.0.random_range(low..=high)
    }

    pub fn matrix(&mut self, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| self.number())
    }

    /// Symmetric, positive definite with eigenvalues from `least` on.
    pub fn definite(&mut self, n: usize, least: f64) -> DMatrix<f64> {
        let A = self.matrix(n, n);
        &A * A.transpose() + DMatrix::identity(n, n) * least
    }
}
