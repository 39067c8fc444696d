//! Algebraic Riccati equations: the matrix sign function (continuous) and structured doubling (discrete), both followed by Newton's method.

use crate::eigen::beyond_limit;
use crate::lyapunov::lyapunov;
use crate::matrix::{
    Complex, Matrix, blocks, identity, positive_definite, semidefinite, shaped, solve, square,
    symmetric, symmetric_part,
};
use crate::modes::{require_detectable, require_stabilizable};
use crate::{LtiError, eigenvalues};

/// Largest relative residual that a solution may have.
const ACCEPTED_RESIDUAL: f64 = 1e-9;
/// Names in errors.
const CONTINUOUS: &str = "continuous Riccati equation";
const DISCRETE: &str = "discrete Riccati equation";

/// Stabilising solution of an algebraic Riccati equation.
#[derive(Debug, Clone)]
pub struct RiccatiSolution {
    /// The symmetric solution X, n x n.
    pub x: Matrix,
    /// The optimal gain K of `u = -K x`, m x n.
    pub gain: Matrix,
    /// Eigenvalues of `A - B K`.
    pub closed_loop_poles: Vec<Complex>,
    /// Frobenius norm of the residual over the sum of the norms of the equation's terms.
    pub residual: f64,
}

/// Solves the continuous equation `A'X + XA - X B R^-1 B' X + Q = 0` for the X that makes `A - B R^-1 B' X` stable.
///
/// Q (n x n) is symmetric and positive semidefinite, R (m x m) positive definite. The matrix sign function with determinantal scaling
/// (Roberts 1980; Byers 1987) gives a first solution, Newton's method (Kleinman 1968) refines it until the residual no longer falls.
///
/// Errors: R that is not positive definite, Q that is not semidefinite, modes that do not decay and are not moved by an input or not seen
/// by Q, eigenvalues of the Hamiltonian on the imaginary axis.
///
/// ```
/// use fuyu_lti::{Matrix, care};
/// // x' = u, cost x^2 + u^2: X = K = 1.
/// let one = Matrix::identity(1, 1);
/// let s = care(&Matrix::zeros(1, 1), &one, &one, &one).unwrap();
/// assert!((s.gain[(0, 0)] - 1.0).abs() < 1e-15);
/// ```
pub fn care(a: &Matrix, b: &Matrix, q: &Matrix, r: &Matrix) -> Result<RiccatiSolution, LtiError> {
    care_with_cross_weight(a, b, q, r, &Matrix::zeros(a.nrows(), b.ncols()))
}

/// [`care`] for the cost `x'Qx + 2 x'Su + u'Ru`, with S n x m: `A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0`.
///
/// `Q - S R^-1 S'` must be positive semidefinite.
pub fn care_with_cross_weight(
    a: &Matrix,
    b: &Matrix,
    q: &Matrix,
    r: &Matrix,
    s: &Matrix,
) -> Result<RiccatiSolution, LtiError> {
    let reduced = Reduced::new(a, b, q, r, s, false)?;
    let (x, residual) = stabilizing_solution(&reduced.a, &reduced.g, &reduced.q, CONTINUOUS)?;
    let gain = reduced.r_factor.solve(&(b.transpose() * &x)) + reduced.shift;
    finish(a, b, x, gain, residual, false)
}

/// Solves the discrete equation `A'XA - X - A'XB (R + B'XB)^-1 B'XA + Q = 0` for the X that makes `A - B K` stable, with `K = (R + B'XB)^-1 B'XA`.
///
/// Structured doubling (Chu, Fan, Lin & Wang 2004), refined by Hewer's iteration. Conditions and errors as in [`care`], with the unit
/// circle in place of the imaginary axis.
///
/// ```
/// use fuyu_lti::{Matrix, dare};
/// // x+ = x + u, cost x^2 + u^2: X is the golden ratio.
/// let one = Matrix::identity(1, 1);
/// let s = dare(&one, &one, &one, &one).unwrap();
/// assert!((s.x[(0, 0)] - (1.0 + 5f64.sqrt()) / 2.0).abs() < 1e-14);
/// ```
pub fn dare(a: &Matrix, b: &Matrix, q: &Matrix, r: &Matrix) -> Result<RiccatiSolution, LtiError> {
    dare_with_cross_weight(a, b, q, r, &Matrix::zeros(a.nrows(), b.ncols()))
}

/// [`dare`] for the cost `x'Qx + 2 x'Su + u'Ru`.
pub fn dare_with_cross_weight(
    a: &Matrix,
    b: &Matrix,
    q: &Matrix,
    r: &Matrix,
    s: &Matrix,
) -> Result<RiccatiSolution, LtiError> {
    let reduced = Reduced::new(a, b, q, r, s, true)?;
    let n = a.nrows();
    let (mut ak, mut g, mut h) = (reduced.a.clone(), reduced.g.clone(), reduced.q.clone());
    let limit = 60;
    let mut converged = false;
    for _ in 0..limit {
        let w = identity(n) + &g * &h;
        let solved = solve(
            "I + G H of the doubling iteration",
            &w,
            &blocks(&[&[&ak, &g]]),
        )?;
        let (left, right) = (solved.columns(0, n), solved.columns(n, n));
        let step = symmetric_part(&(ak.transpose() * &h * left));
        g = symmetric_part(&(&g + &ak * right * ak.transpose()));
        ak = &ak * left;
        h += &step;
        if !h.iter().all(|v| v.is_finite()) {
            break;
        }
        if step.norm() <= 1e-15 * h.norm() || h.norm() == 0.0 {
            converged = true;
            break;
        }
    }
    if !converged {
        return Err(closest_to_limit(&eigenvalues(&reduced.a)?, DISCRETE, true));
    }
    // Hewer: with A_k = A - B K, A_k' dX A_k - dX + residual = 0.
    let gain_of = |x: &Matrix| -> Result<Matrix, LtiError> {
        let weight = symmetric_part(&(&reduced.r + b.transpose() * x * b));
        // Indefinite only if rounding has destroyed X.
        let factor = positive_definite("R + B'XB", &weight).map_err(|_| LtiError::Inaccurate {
            what: DISCRETE,
            residual: 1.0,
            limit: ACCEPTED_RESIDUAL,
        })?;
        Ok(factor.solve(&(b.transpose() * x * &reduced.a)))
    };
    let defect = |x: &Matrix, k: &Matrix| {
        let axa = reduced.a.transpose() * x * &reduced.a;
        let down = reduced.a.transpose() * x * b * k;
        let rest = symmetric_part(&(&axa - x - &down + &reduced.q));
        let size = axa.norm() + x.norm() + down.norm() + reduced.q.norm();
        let residual = if size == 0.0 { 0.0 } else { rest.norm() / size };
        (rest, residual)
    };
    let mut x = h;
    let mut k = gain_of(&x)?;
    let (mut rest, mut residual) = defect(&x, &k);
    for _ in 0..10 {
        let closed = &reduced.a - b * &k;
        let Ok(step) = crate::lyapunov::discrete_lyapunov(&closed.transpose(), &rest) else {
            break;
        };
        let next = symmetric_part(&(&x + step.x));
        let next_k = gain_of(&next)?;
        let (next_rest, next_residual) = defect(&next, &next_k);
        if next_residual >= residual {
            break;
        }
        (x, k, rest, residual) = (next, next_k, next_rest, next_residual);
    }
    accept(DISCRETE, residual)?;
    finish(a, b, x, k + reduced.shift, residual, true)
}

/// The equation without cross term.
struct Reduced {
    /// A - B R^-1 S'
    a: Matrix,
    /// B R^-1 B'
    g: Matrix,
    /// Q - S R^-1 S'
    q: Matrix,
    /// R^-1 S', the part of the gain that the cross weight adds.
    shift: Matrix,
    r: Matrix,
    r_factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
}

impl Reduced {
    fn new(
        a: &Matrix,
        b: &Matrix,
        q: &Matrix,
        r: &Matrix,
        s: &Matrix,
        discrete: bool,
    ) -> Result<Self, LtiError> {
        let n = square("A", a)?;
        shaped("B", b, n, b.ncols())?;
        let q = symmetric("Q", q, n)?;
        let r = symmetric("R", r, b.ncols())?;
        shaped("S", s, n, b.ncols())?;
        let r_factor = positive_definite("R", &r)?;
        let shift = r_factor.solve(&s.transpose());
        let a = a - b * &shift;
        let q = symmetric_part(&(q - s * &shift));
        semidefinite("Q - S R^-1 S'", &q)?;
        require_stabilizable(&a, b, discrete)?;
        require_detectable(&a, &q, discrete)?;
        let g = symmetric_part(&(b * r_factor.solve(&b.transpose())));
        Ok(Self {
            a,
            g,
            q,
            shift,
            r,
            r_factor,
        })
    }
}

fn accept(what: &'static str, residual: f64) -> Result<(), LtiError> {
    if residual <= ACCEPTED_RESIDUAL {
        Ok(())
    } else {
        Err(LtiError::Inaccurate {
            what,
            residual,
            limit: ACCEPTED_RESIDUAL,
        })
    }
}

fn finish(
    a: &Matrix,
    b: &Matrix,
    x: Matrix,
    gain: Matrix,
    residual: f64,
    discrete: bool,
) -> Result<RiccatiSolution, LtiError> {
    let closed_loop_poles = eigenvalues(&(a - b * &gain))?;
    match closed_loop_poles
        .iter()
        .find(|&&p| beyond_limit(p, discrete) >= 0.0)
    {
        Some(&eigenvalue) => Err(LtiError::StabilityLimit {
            equation: if discrete { DISCRETE } else { CONTINUOUS },
            eigenvalue,
        }),
        None => Ok(RiccatiSolution {
            x,
            gain,
            closed_loop_poles,
            residual,
        }),
    }
}

/// The error that names the eigenvalue closest to the stability limit.
fn closest_to_limit(eigenvalues: &[Complex], equation: &'static str, discrete: bool) -> LtiError {
    let distance = |l: &Complex| beyond_limit(*l, discrete).abs();
    let closest = eigenvalues
        .iter()
        .copied()
        .min_by(|p, q| distance(p).total_cmp(&distance(q)));
    LtiError::StabilityLimit {
        equation,
        eigenvalue: closest.unwrap_or_default(),
    }
}

/// Hamiltonian matrix `[A, -G rho; -Q / rho, -A']` of `A'X + XA - X G X + Q = 0` for `X = rho Y`, and the rho that makes its blocks equally large.
pub(crate) fn scaled_hamiltonian(a: &Matrix, g: &Matrix, q: &Matrix) -> (Matrix, f64) {
    let (g_size, q_size) = (g.norm(), q.norm());
    let rho = if g_size > 0.0 && q_size > 0.0 {
        (q_size / g_size).sqrt()
    } else {
        1.0
    };
    let hamiltonian = blocks(&[&[a, &(-g * rho)], &[&(-q / rho), &(-a.transpose())]]);
    (hamiltonian, rho)
}

/// Stabilising solution X and relative residual of `A'X + XA - X G X + Q = 0`, where neither G nor Q needs to be semidefinite.
///
/// This is the equation of H-infinity control too. The error says whether the Hamiltonian has eigenvalues on the imaginary axis.
pub(crate) fn stabilizing_solution(
    a: &Matrix,
    g: &Matrix,
    q: &Matrix,
    equation: &'static str,
) -> Result<(Matrix, f64), LtiError> {
    let n = a.nrows();
    if n == 0 {
        return Ok((Matrix::zeros(0, 0), 0.0));
    }
    if q.amax() == 0.0 && crate::spectral_abscissa(a)? < 0.0 {
        return Ok((Matrix::zeros(n, n), 0.0));
    }
    let (hamiltonian, rho) = scaled_hamiltonian(a, g, q);
    let eigenvalues = eigenvalues(&hamiltonian)?;
    let axis = eigenvalues.iter().find(|l| l.re.abs() <= 1e-11 * l.norm());
    if let Some(&eigenvalue) = axis {
        return Err(LtiError::StabilityLimit {
            equation,
            eigenvalue,
        });
    }
    let Some(sign) = sign_function(&hamiltonian) else {
        return Err(closest_to_limit(&eigenvalues, equation, false));
    };
    // (sign + I) [I; X] = 0: an overdetermined system of full rank.
    let sum = sign + identity(2 * n);
    let qr = sum.columns(n, n).into_owned().qr();
    let y = qr
        .r()
        .solve_upper_triangular(&(qr.q().transpose() * -sum.columns(0, n)))
        .filter(|y| y.iter().all(|v| v.is_finite()))
        .ok_or(LtiError::Singular {
            what: format!("the stable subspace of the {equation}"),
        })?;
    let (x, residual) = newton(a, g, q, symmetric_part(&(y * rho)));
    accept(equation, residual)?;
    Ok((x, residual))
}

/// Kleinman's iteration in increments: (A - G X)' dX + dX (A - G X) + residual = 0, until the residual no longer falls.
fn newton(a: &Matrix, g: &Matrix, q: &Matrix, mut x: Matrix) -> (Matrix, f64) {
    let defect = |x: &Matrix| {
        let xa = x * a;
        let xgx = x * g * x;
        let rest = symmetric_part(&(&xa + xa.transpose() - &xgx + q));
        let size = 2.0 * xa.norm() + xgx.norm() + q.norm();
        let residual = if size == 0.0 { 0.0 } else { rest.norm() / size };
        (rest, residual)
    };
    let (mut rest, residual) = defect(&x);
    let mut best = (x.clone(), residual);
    let mut worse = 0;
    for _ in 0..60 {
        let Ok(step) = lyapunov(&(a - g * &x).transpose(), &rest) else {
            break;
        };
        x = symmetric_part(&(&x + &step.x));
        let (next_rest, residual) = defect(&x);
        rest = next_rest;
        // The first steps may increase the residual before convergence becomes quadratic. At the level of rounding the last solution is the best:
        // rounding of the residual hides errors of the solution.
        if residual < best.1 || residual < 1e-15 {
            best = (x.clone(), residual);
            worse = 0;
        } else {
            worse += 1;
        }
        if worse == 15 || step.x.norm() <= 1e-15 * x.norm() {
            break;
        }
    }
    best
}

/// Matrix sign function by Newton's iteration with determinantal scaling; `None` if it does not converge.
pub(crate) fn sign_function(m: &Matrix) -> Option<Matrix> {
    let n = m.nrows();
    let mut z = m.clone();
    let mut last = f64::INFINITY;
    for _ in 0..100 {
        let lu = z.clone().lu();
        let inverse = lu.try_inverse()?;
        // |det|^(-1/n) as a mean of logarithms, which cannot overflow; not near convergence, where it would only disturb.
        let scale = if last > 1e-2 {
            let log_det: f64 = lu.u().diagonal().iter().map(|v| v.abs().ln()).sum();
            (-log_det / n as f64).exp()
        } else {
            1.0
        };
        let next = (&z * scale + inverse / scale) * 0.5;
        if next.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let change = (&next - &z).norm() / next.norm();
        z = next;
        if change < 1e-13 || (last < 1e-8 && change >= last) {
            return Some(z);
        }
        last = change;
    }
    // Slow, but close enough for Newton's method on the Riccati equation to finish.
    (last < 1e-6).then_some(z)
}
