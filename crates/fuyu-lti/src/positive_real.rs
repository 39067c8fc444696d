//! Positive-real systems: those that absorb energy at every frequency.

use crate::matrix::{Matrix, identity, positive_definite, shaped, solve, symmetric_part};
use crate::riccati::stabilizing_solution;
use crate::{LtiError, StateSpace};

/// Result of a test for positive realness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositiveReal {
    /// Whether `H(s) + H(s)^H >= 0` in the right half plane.
    pub holds: bool,
    /// H-infinity norm of the scattering function `(H - I)(H + I)^-1`, at most 1 for a positive-real H; infinite if that is unstable.
    pub scattering_norm: f64,
    /// Smallest eigenvalue of `(H(jw) + H(jw)^H) / 2` of a frequency sweep.
    pub smallest_real_part: f64,
    /// Frequency of that in rad/s.
    pub frequency: f64,
}

/// Tests a square continuous system, which may have poles on the imaginary axis.
///
/// H is positive real exactly if its scattering function `(H - I)(H + I)^-1` is stable with norm at most 1 (Anderson & Vongpanitlerd
/// 1973), which the Hamiltonian matrix decides; the sweep is a second opinion and says where. The realization must be minimal: an
/// unobservable pole on the imaginary axis, such as the position of a free body whose rate is the output, stays in the scattering
/// function, which then counts as unstable.
pub fn positive_real(sys: &StateSpace) -> Result<PositiveReal, LtiError> {
    sys.require_continuous("the test for positive realness")?;
    let m = sys.inputs();
    shaped("D", &sys.d, m, m)?;
    let (smallest_real_part, frequency) = sweep(sys)?;
    let scattering_norm = match scattering(sys) {
        Ok(s) => match s.hinf_norm() {
            Ok(n) => n.norm,
            Err(LtiError::Unstable { .. }) => f64::INFINITY,
            Err(e) => return Err(e),
        },
        Err(LtiError::Singular { .. }) => f64::INFINITY,
        Err(e) => return Err(e),
    };
    Ok(PositiveReal {
        holds: scattering_norm <= 1.0 + 1e-7,
        scattering_norm,
        smallest_real_part,
        frequency,
    })
}

/// `(H - I)(H + I)^-1 = I - 2 (I + H)^-1`.
fn scattering(sys: &StateSpace) -> Result<StateSpace, LtiError> {
    let m = sys.inputs();
    let k = solve("I + D", &(identity(m) + &sys.d), &identity(m))?;
    StateSpace::new(
        &sys.a - &sys.b * &k * &sys.c,
        &sys.b * &k,
        &k * &sys.c * 2.0,
        identity(m) - &k * 2.0,
    )
}

fn sweep(sys: &StateSpace) -> Result<(f64, f64), LtiError> {
    let m = sys.inputs();
    let mut best = (f64::INFINITY, 0.0);
    for w in sys.natural_grid(30)? {
        let Ok(h) = sys.response(w) else { continue };
        // Hermitian part as a real symmetric matrix of twice the size.
        let mut part = Matrix::zeros(2 * m, 2 * m);
        for i in 0..m {
            for j in 0..m {
                let v = (h[(i, j)] + h[(j, i)].conj()) * 0.5;
                part[(i, j)] = v.re;
                part[(m + i, m + j)] = v.re;
                part[(i, m + j)] = -v.im;
                part[(m + i, j)] = v.im;
            }
        }
        let smallest = crate::matrix::smallest_eigenvalue(&symmetric_part(&part))?;
        if smallest < best.0 {
            best = (smallest, w);
        }
    }
    Ok(best)
}

/// Certificate of strict positive realness by the lemma of Kalman, Yakubovich and Popov: P positive definite with
/// `A'P + PA + (PB - C')(D + D')^-1 (B'P - C) = 0`, so that `x'Px` is a storage function.
///
/// Needs `D + D'` positive definite. Error: the system is not strictly positive real.
pub fn storage_matrix(sys: &StateSpace) -> Result<Matrix, LtiError> {
    sys.require_continuous("a storage matrix")?;
    sys.require_stable("a strictly positive-real system")?;
    let m = sys.inputs();
    shaped("D", &sys.d, m, m)?;
    let r = positive_definite("D + D'", &(&sys.d + sys.d.transpose()))?;
    let a = &sys.a - &sys.b * r.solve(&sys.c);
    let g = symmetric_part(&(-&sys.b * r.solve(&sys.b.transpose())));
    let q = symmetric_part(&(sys.c.transpose() * r.solve(&sys.c)));
    let (p, _) = stabilizing_solution(&a, &g, &q, "Riccati equation of the positive-real lemma")?;
    crate::matrix::semidefinite("the storage matrix", &p)?;
    Ok(p)
}
