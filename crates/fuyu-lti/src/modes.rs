//! Controllability and observability of single modes: the tests of Popov, Belevitch and Hautus.

use crate::eigen::balance;
use crate::matrix::{Complex, Matrix, blocks, complex, shifted, singular_values};
use crate::{LtiError, eigenvalues};

/// Relative size of a singular value below which a mode counts as out of reach.
const RANK_TOLERANCE: f64 = 1e-12;

/// Errors unless every mode that does not decay is moved by an input: rank [A - s I, B] = n there.
pub(crate) fn require_stabilizable(a: &Matrix, b: &Matrix, discrete: bool) -> Result<(), LtiError> {
    match unreachable_mode(a, b, |l, size| lingers(l, size, discrete))? {
        Some(eigenvalue) => Err(LtiError::NotStabilizable { eigenvalue }),
        None => Ok(()),
    }
}

/// Errors unless every mode that does not decay is seen by an output.
pub(crate) fn require_detectable(a: &Matrix, c: &Matrix, discrete: bool) -> Result<(), LtiError> {
    match unreachable_mode(&a.transpose(), &c.transpose(), |l, size| {
        lingers(l, size, discrete)
    })? {
        Some(eigenvalue) => Err(LtiError::NotDetectable { eigenvalue }),
        None => Ok(()),
    }
}

/// Whether every mode is moved by some input (Popov, Belevitch, Hautus).
///
/// The rank is decided on a balanced realisation at 1e-12 of its norm.
pub fn is_controllable(a: &Matrix, b: &Matrix) -> Result<bool, LtiError> {
    let n = crate::matrix::square("A", a)?;
    crate::matrix::shaped("B", b, n, b.ncols())?;
    Ok(unreachable_mode(a, b, |_, _| true)?.is_none())
}

/// Whether every mode is seen by some output.
pub fn is_observable(a: &Matrix, c: &Matrix) -> Result<bool, LtiError> {
    is_controllable(&a.transpose(), &c.transpose())
}

fn lingers(l: Complex, size: f64, discrete: bool) -> bool {
    if discrete {
        l.norm() >= 1.0 - 1e-10
    } else {
        l.re >= -1e-10 * size
    }
}

fn unreachable_mode(
    a: &Matrix,
    b: &Matrix,
    relevant: impl Fn(Complex, f64) -> bool,
) -> Result<Option<Complex>, LtiError> {
    let n = a.nrows();
    let mut scaled = a.clone();
    let scales = balance(&mut scaled);
    let mut input = Matrix::from_fn(n, b.ncols(), |i, j| b[(i, j)] / scales[i]);
    let size = scaled.norm();
    // Each input in units that move the states as fast as the dynamics do, unless it is rounding next to the others.
    let noise = 1e-14 * input.amax();
    for mut column in input.column_iter_mut() {
        let largest = column.amax();
        if largest > noise {
            column *= size.max(f64::MIN_POSITIVE) / largest;
        }
    }
    let system = complex(&blocks(&[&[&scaled, &input]]));
    for l in eigenvalues(&scaled)? {
        if l.im < 0.0 || !relevant(l, size) {
            continue;
        }
        let smallest = singular_values(&shifted(&system, n, l))?
            .last()
            .copied()
            .unwrap_or(0.0);
        if smallest <= RANK_TOLERANCE * size.max(l.norm()) {
            return Ok(Some(l));
        }
    }
    Ok(None)
}
