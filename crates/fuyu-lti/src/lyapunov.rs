//! Lyapunov equations by the method of Bartels & Stewart (CACM 15, 1972), on the complex Schur form, with iterative refinement.

use crate::LtiError;
use crate::eigen::{ComplexSchur, complex_schur};
use crate::matrix::{Complex, ComplexMatrix, Matrix, complex, square, symmetric, symmetric_part};

/// Solution of a Lyapunov equation.
#[derive(Debug, Clone)]
pub struct LyapunovSolution {
    /// The symmetric solution, n x n.
    pub x: Matrix,
    /// Frobenius norm of the residual over the sum of the norms of the equation's terms.
    pub residual: f64,
}

/// Solves `A X + X A' + Q = 0` for symmetric Q.
///
/// A needs not be stable. Error: eigenvalues of A whose sum is zero, for which there is no unique solution.
///
/// ```
/// use fuyu_lti::{Matrix, lyapunov};
/// let a = Matrix::from_row_slice(1, 1, &[-2.0]);
/// let q = Matrix::from_row_slice(1, 1, &[3.0]);
/// assert!((lyapunov(&a, &q).unwrap().x[(0, 0)] - 0.75).abs() < 1e-15);
/// ```
pub fn lyapunov(a: &Matrix, q: &Matrix) -> Result<LyapunovSolution, LtiError> {
    refined(a, q, Kind::Continuous)
}

/// Solves `A X A' - X + Q = 0` for symmetric Q.
///
/// Error: eigenvalues of A whose product is 1, for which there is no unique solution.
pub fn discrete_lyapunov(a: &Matrix, q: &Matrix) -> Result<LyapunovSolution, LtiError> {
    refined(a, q, Kind::Discrete)
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Continuous,
    Discrete,
}

fn refined(a: &Matrix, q: &Matrix, kind: Kind) -> Result<LyapunovSolution, LtiError> {
    let n = square("A", a)?;
    let q = symmetric("Q", q, n)?;
    let schur = complex_schur(complex(a))?;
    let mut x = solve(&schur, &q, kind)?;
    let (mut rest, mut residual) = defect(a, &q, &x, kind);
    for _ in 0..3 {
        if residual < 1e-16 {
            break;
        }
        let better = &x + solve(&schur, &rest, kind)?;
        let (next_rest, next) = defect(a, &q, &better, kind);
        if next >= residual {
            break;
        }
        (x, rest, residual) = (better, next_rest, next);
    }
    if x.iter().any(|v| !v.is_finite()) || residual > 1e-6 {
        return Err(LtiError::Inaccurate {
            what: "Lyapunov equation",
            residual,
            limit: 1e-6,
        });
    }
    Ok(LyapunovSolution { x, residual })
}

fn defect(a: &Matrix, q: &Matrix, x: &Matrix, kind: Kind) -> (Matrix, f64) {
    let (rest, size) = match kind {
        Kind::Continuous => {
            let ax = a * x;
            (&ax + ax.transpose() + q, 2.0 * ax.norm() + q.norm())
        }
        Kind::Discrete => {
            let axa = a * x * a.transpose();
            (&axa - x + q, axa.norm() + x.norm() + q.norm())
        }
    };
    let residual = if size == 0.0 { 0.0 } else { rest.norm() / size };
    (symmetric_part(&rest), residual)
}

/// Column by column from the last: T Y + Y T^H = -F, or T Y T^H - Y = -F, with F = U^H Q U.
fn solve(schur: &ComplexSchur, q: &Matrix, kind: Kind) -> Result<Matrix, LtiError> {
    let n = q.nrows();
    let (u, t) = (&schur.unitary, &schur.triangular);
    let f = u.adjoint() * complex(q) * u;
    let mut y = ComplexMatrix::zeros(n, n);
    let scale = t.iter().fold(0.0, |m: f64, v| m.max(v.norm()));
    for j in (0..n).rev() {
        let mut right = -f.column(j);
        let mut sum = nalgebra::DVector::<Complex>::zeros(n);
        for k in j + 1..n {
            sum.axpy(t[(j, k)].conj(), &y.column(k), Complex::new(1.0, 0.0));
        }
        let mirror = t[(j, j)].conj();
        if kind == Kind::Continuous {
            right -= sum;
        } else {
            right -= t * sum;
        }
        // Back substitution with the triangular matrix T + mirror I, or mirror T - I.
        for i in (0..n).rev() {
            let mut value = right[i];
            for k in i + 1..n {
                let entry = if kind == Kind::Continuous {
                    t[(i, k)]
                } else {
                    mirror * t[(i, k)]
                };
                value -= entry * y[(k, j)];
            }
            let (pivot, size) = match kind {
                Kind::Continuous => (t[(i, i)] + mirror, scale),
                Kind::Discrete => (t[(i, i)] * mirror - 1.0, 1.0),
            };
            if pivot.norm() <= 1e-15 * size {
                return Err(LtiError::MirrorEigenvalues {
                    first: t[(i, i)],
                    second: t[(j, j)],
                });
            }
            y[(i, j)] = value / pivot;
        }
    }
    Ok(symmetric_part(&(u * y * u.adjoint()).map(|v| v.re)))
}
