//! Theorems 2.1 to 2.6: transmission zeros of structures from a symmetric eigenvalue problem of the modes, compared
//! with those of a solver for general linear systems.

use fuyu_lti::{LtiError, StateSpace, Structure};
use fuyu_structures::{FemModel, HybridModel, Matrices, StructureError, generalized_eigen};
use nalgebra::{Complex, DMatrix, DVector};

use super::random::Random;

/// Results of one theorem on random structures.
#[derive(Debug, Clone, Default)]
pub struct Checked {
    /// Its name.
    pub theorem: &'static str,
    /// For each structure: largest relative difference of a zero or pole from the general solver's; infinite if their
    /// numbers differ.
    pub errors: Vec<f64>,
    /// Number of structures with a zero in the right half-plane.
    pub not_minimum_phase: usize,
}

impl Checked {
    fn named(theorem: &'static str) -> Self {
        Self {
            theorem,
            ..Self::default()
        }
    }

    /// The largest error.
    pub fn worst(&self) -> f64 {
        self.errors.iter().copied().fold(0.0, f64::max)
    }

    fn add(&mut self, found: &[Complex<f64>], expected: &[Complex<f64>]) {
        self.errors.push(largest_difference(found, expected));
        let right = |s: &Complex<f64>| s.re > 1e-9 * s.norm();
        self.not_minimum_phase += usize::from(found.iter().any(right));
    }
}

/// Reason why a check could not be made; does not occur with the structures below.
#[derive(Debug, thiserror::Error)]
pub enum TheoremError {
    /// Error of the structures library.
    #[error(transparent)]
    Structure(#[from] StructureError),
    /// Error of the linear systems library.
    #[error(transparent)]
    Lti(#[from] LtiError),
}

/// Largest relative difference after pairing each found root with the nearest unpaired expected one.
fn largest_difference(found: &[Complex<f64>], expected: &[Complex<f64>]) -> f64 {
    if found.len() != expected.len() {
        return f64::INFINITY;
    }
    let mut left = expected.to_vec();
    let mut largest = 0.0_f64;
    for root in found {
        let distances = left.iter().map(|s| (s - root).norm() / root.norm());
        let nearest = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((place, distance)) = nearest else {
            return f64::INFINITY;
        };
        left.swap_remove(place);
        largest = largest.max(distance);
    }
    largest
}

/// The system `M q'' + C q' + K q = L u`, `y = H q`.
fn system(
    [M, C, K]: [DMatrix<f64>; 3],
    L: DMatrix<f64>,
    H: &DMatrix<f64>,
) -> Result<StateSpace, LtiError> {
    let none = DMatrix::zeros(H.nrows(), H.ncols());
    Structure::new(M, C, K, L)?.with_outputs(H, &none)
}

/// Theorems 2.1 (FEM model) and 2.2 (modal model with all modes) on `count` random structures with one or two
/// collocated inputs.
///
/// # Errors
/// Numerical failure.
pub fn uniform(count: usize) -> Result<[Checked; 2], TheoremError> {
    let mut random = Random::new(21);
    let mut checked = [Checked::named("2.1"), Checked::named("2.2")];
    for _ in 0..count {
        let (n, r) = (random.count(3, 8), random.count(1, 2));
        let M = random.definite(n, 0.5);
        let K = random.definite(n, 0.5) * 10.0;
        let eigen = generalized_eigen(&K, &M)?;
        let ratios: Vec<f64> = (0..n).map(|_| random.between(0.0, 0.05)).collect();
        let modal = DVector::from_fn(n, |i, _| 2.0 * ratios[i] * eigen.values[i].sqrt());
        let MPhi = &M * &eigen.vectors;
        let D = (&MPhi * DMatrix::from_diagonal(&modal) * MPhi.transpose()).symmetric_part();
        let matrices = Matrices::new(M.clone(), K.clone())?;
        let mut model = FemModel::collocated(matrices, D.clone(), &[0])?;
        model.L = random.matrix(n, r);
        let general = system([M, D, K], model.L.clone(), &model.L.transpose())?.zeros()?;
        checked[0].add(&model.zeros()?, &general);
        checked[1].add(&model.modal(&ratios, n)?.zeros()?, &general);
    }
    Ok(checked)
}

/// A random rigid part with r coordinates, and n modes. N^c must be positive definite, since J includes the flexible
/// parts.
fn hybrid(random: &mut Random) -> Result<(HybridModel, usize, usize), StructureError> {
    let (r, n) = (random.count(1, 3), random.count(1, 5));
    let P = random.matrix(n, r);
    let J = random.definite(r, 0.3) + P.transpose() * &P;
    let frequencies: Vec<f64> = (0..n).map(|_| random.between(0.5, 6.0)).collect();
    let ratios: Vec<f64> = (0..n).map(|_| random.between(0.001, 0.05)).collect();
    let model = HybridModel::new(J.symmetric_part(), P, &frequencies, &ratios)?;
    Ok((model, r, n))
}

fn joined(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let mut whole = DMatrix::zeros(left.nrows(), left.ncols() + right.ncols());
    whole.columns_mut(0, left.ncols()).copy_from(left);
    whole
        .columns_mut(left.ncols(), right.ncols())
        .copy_from(right);
    whole
}

/// Theorems 2.3(a), 2.4(a) (poles) and 2.3(b), 2.4(b) (zeros) on `count` random hybrid models; finally 2.4(b) with only
/// the diagonal of the modal damping, as in the book.
///
/// # Errors
/// Numerical failure.
pub fn collocated(count: usize) -> Result<[Checked; 5], TheoremError> {
    let mut random = Random::new(23);
    let names = [
        "2.3(a)",
        "2.4(a)",
        "2.3(b)",
        "2.4(b)",
        "2.4(b), diagonal damping",
    ];
    let mut checked = names.map(Checked::named);
    for _ in 0..count {
        let (model, r, n) = hybrid(&mut random)?;
        let rigid = joined(&DMatrix::identity(r, r), &DMatrix::zeros(r, n));
        let whole = system(model.matrices(), rigid.transpose(), &rigid)?;
        // Another 2 r poles are zero.
        let mut poles = whole.poles()?;
        poles.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
        poles.truncate(2 * n);
        let zeros = whole.zeros()?;
        let mut unconstrained = model.unconstrained()?;
        checked[0].add(&model.poles()?, &poles);
        checked[1].add(&unconstrained.poles()?, &poles);
        checked[2].add(&model.zeros()?, &zeros);
        checked[3].add(&unconstrained.zeros()?, &zeros);
        unconstrained.damping = DMatrix::from_diagonal(&unconstrained.damping.diagonal());
        checked[4].add(&unconstrained.zeros()?, &zeros);
    }
    Ok(checked)
}

/// Theorems 2.5 (sensors on the flexible part) and 2.6 (actuators there), each for constrained (a) and unconstrained
/// modes (b), on `count` random hybrid models.
///
/// # Errors
/// Numerical failure.
pub fn not_collocated(count: usize) -> Result<[Checked; 4], TheoremError> {
    let mut random = Random::new(25);
    let mut checked = ["2.5(a)", "2.5(b)", "2.6(a)", "2.6(b)"].map(Checked::named);
    for _ in 0..count {
        let (model, r, n) = hybrid(&mut random)?;
        let flexible = random.matrix(r, n);
        let H_r = random.matrix(r, r) * 0.3 + DMatrix::identity(r, r);
        let rigid = joined(&DMatrix::identity(r, r), &DMatrix::zeros(r, n));
        let elsewhere = joined(&H_r, &flexible);
        let unconstrained = model.unconstrained()?;
        let general = system(model.matrices(), rigid.transpose(), &elsewhere)?.zeros()?;
        checked[0].add(&model.zeros_measured_elsewhere(&H_r, &flexible)?, &general);
        checked[1].add(
            &unconstrained.zeros_measured_elsewhere(&H_r, &flexible)?,
            &general,
        );
        let (L_r, L_e) = (H_r.transpose(), flexible.transpose());
        let general = system(model.matrices(), elsewhere.transpose(), &rigid)?.zeros()?;
        checked[2].add(&model.zeros_driven_elsewhere(&L_r, &L_e)?, &general);
        checked[3].add(&unconstrained.zeros_driven_elsewhere(&L_r, &L_e)?, &general);
    }
    Ok(checked)
}
