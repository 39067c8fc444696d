//! Gramians and Hankel singular values.

use crate::matrix::{Matrix, full_svd, symmetric_eigen, symmetric_part};
use crate::{LtiError, StateSpace, discrete_lyapunov, lyapunov};

/// Controllability Gramian, n x n: `A P + P A' + B B' = 0`, discrete `A P A' - P + B B' = 0`. Error: unstable.
pub fn controllability_gramian(sys: &StateSpace) -> Result<Matrix, LtiError> {
    sys.require_stable("a system with Gramians")?;
    let q = symmetric_part(&(&sys.b * sys.b.transpose()));
    Ok(if sys.sampling_time.is_some() {
        discrete_lyapunov(&sys.a, &q)?
    } else {
        lyapunov(&sys.a, &q)?
    }
    .x)
}

/// Observability Gramian, n x n: `A' Q + Q A + C'C = 0`, discrete `A' Q A - Q + C'C = 0`. Error: unstable.
pub fn observability_gramian(sys: &StateSpace) -> Result<Matrix, LtiError> {
    controllability_gramian(&sys.dual())
}

/// `L` with `L L' = gramian`, from the eigenvalues, so that a singular Gramian does no harm.
pub(crate) fn square_root(gramian: &Matrix) -> Result<Matrix, LtiError> {
    let eigen = symmetric_eigen(gramian)?;
    let roots = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    Ok(eigen.eigenvectors * Matrix::from_diagonal(&roots))
}

/// Hankel singular values in descending order: how much energy each state of a balanced realisation passes from input to output. Error: unstable.
pub fn hankel_singular_values(sys: &StateSpace) -> Result<Vec<f64>, LtiError> {
    let lp = square_root(&controllability_gramian(sys)?)?;
    let lq = square_root(&observability_gramian(sys)?)?;
    Ok(full_svd(&(lq.transpose() * lp))?.1)
}
