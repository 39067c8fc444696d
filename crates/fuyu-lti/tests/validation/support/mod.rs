//! Fixtures, and comparisons with messages.
pub mod servicer;

use fuyu_lti::{Complex, Margins, Matrix, StateSpace};
use serde_json::Value;

pub fn fixture(name: &str) -> Value {
    let path = format!("{}/tests/fixtures/{name}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}")))
        .unwrap()
}

pub fn number(v: &Value) -> f64 {
    v.as_f64().unwrap_or_else(|| panic!("{v} is no number"))
}

pub fn list(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(number).collect()
}

pub fn matrix(v: &Value) -> Matrix {
    let rows: Vec<Vec<f64>> = v.as_array().unwrap().iter().map(list).collect();
    Matrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

pub fn pairs(v: &Value) -> Vec<(f64, f64)> {
    v.as_array()
        .unwrap()
        .iter()
        .map(|p| (number(&p[0]), number(&p[1])))
        .collect()
}

pub fn complex_list(v: &Value) -> Vec<Complex> {
    pairs(v)
        .into_iter()
        .map(|(re, im)| Complex::new(re, im))
        .collect()
}

#[track_caller]
pub fn assert_close(what: &str, got: f64, want: f64, tolerance: f64) {
    assert!(
        (got - want).abs() <= tolerance,
        "{what}: {got:.15e}, expected {want:.15e}, differs by {:.2e}",
        (got - want).abs()
    );
}

/// Crossovers as pairs of frequency and margin: as many as wanted, frequencies within the tolerance that belongs to the wanted one.
#[track_caller]
pub fn assert_crossovers(
    what: &str,
    got: impl Iterator<Item = (f64, f64)>,
    want: &Value,
    frequency_tolerance: impl Fn(f64) -> f64,
    tolerance: f64,
) {
    let (got, want): (Vec<_>, _) = (got.collect(), pairs(want));
    assert_eq!(got.len(), want.len(), "{what}: {got:?} {want:?}");
    for ((frequency, margin), (w, m)) in got.into_iter().zip(want) {
        assert_close(what, frequency, w, frequency_tolerance(w));
        assert_close(what, margin, m, tolerance);
    }
}

/// Gain crossovers: frequency in rad/s and phase margin in degrees.
pub fn phase_margins(m: &Margins) -> impl Iterator<Item = (f64, f64)> {
    m.phase.iter().map(|p| (p.frequency, p.degrees))
}

/// Largest difference of two matrices over the largest entry of the second.
#[track_caller]
pub fn relative(got: &Matrix, want: &Matrix) -> f64 {
    assert_eq!(got.shape(), want.shape());
    (got - want).amax() / want.amax()
}

/// Each value of `want` is matched with a different value of `got`; returns the largest distance.
#[track_caller]
pub fn matched(got: &[Complex], want: &[Complex]) -> f64 {
    let mut free: Vec<Complex> = got.to_vec();
    let mut worst: f64 = 0.0;
    for w in want {
        let (i, d) = free
            .iter()
            .enumerate()
            .map(|(i, g)| (i, (g - w).norm()))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .expect("as many values");
        free.swap_remove(i);
        worst = worst.max(d);
    }
    worst
}

/// Numbers that look random, the same in every run: a linear congruential generator (Knuth's MMIX constants).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(1))
    }

    /// Uniform between -1 and 1.
    pub fn signed(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Uniform between two positive limits on a logarithmic scale.
    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(0.5 * (self.signed() + 1.0))
    }

    pub fn matrix(&mut self, rows: usize, cols: usize) -> Matrix {
        Matrix::from_fn(rows, cols, |_, _| self.signed())
    }

    /// Symmetric positive definite, eigenvalues at least `least`.
    pub fn definite(&mut self, n: usize, least: f64) -> Matrix {
        let m = self.matrix(n, n);
        &m * m.transpose() + Matrix::identity(n, n) * least
    }
}

/// The 1 x 1 matrix.
pub fn one(v: f64) -> Matrix {
    Matrix::from_element(1, 1, v)
}

/// The identity.
pub fn eye(n: usize) -> Matrix {
    Matrix::identity(n, n)
}

/// A stable system whose slowest pole is between .02 and 1 rad/s from the axis, with n states, m inputs and p outputs.
pub fn random_stable(random: &mut Random, n: usize, m: usize, p: usize) -> StateSpace {
    let a = random.matrix(n, n) * 2.0;
    let shift = fuyu_lti::spectral_abscissa(&a).unwrap() + random.log_uniform(0.02, 1.0);
    StateSpace::new(
        &a - eye(n) * shift,
        random.matrix(n, m),
        random.matrix(p, n),
        random.matrix(p, m) * 0.1,
    )
    .unwrap()
}
