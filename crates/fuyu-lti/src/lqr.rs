//! Linear-quadratic regulators, Kalman filters, and compensators made of both.

use crate::matrix::{Matrix, blocks, identity, shaped};
use crate::{LtiError, RiccatiSolution, StateSpace, care, dare};

/// Optimal state feedback `u = -K x` for the cost of `x'Qx + u'Ru`, integrated over time (continuous) or summed over samples (discrete).
///
/// The gain is `solution.gain`, m x n. Errors as in [`care`] and [`dare`].
pub fn lqr(plant: &StateSpace, q: &Matrix, r: &Matrix) -> Result<RiccatiSolution, LtiError> {
    if plant.sampling_time.is_some() {
        dare(&plant.a, &plant.b, q, r)
    } else {
        care(&plant.a, &plant.b, q, r)
    }
}

/// A steady Kalman filter.
#[derive(Debug, Clone)]
pub struct SteadyKalman {
    /// Observer gain L, n x p: continuous `x^' = A x^ + B u + L (y - C x^)`; discrete `x^[k+1] = A x^[k] + B u[k] + L (y[k] - C x^[k])`, the predictor.
    pub gain: Matrix,
    /// Covariance of the error, n x n (discrete: of the prediction).
    pub covariance: Matrix,
    /// Relative residual of the Riccati equation.
    pub residual: f64,
}

/// Steady Kalman filter for process noise of intensity W (n x n) on the state and measurement noise of intensity V (p x p).
///
/// Errors: V not positive definite, modes that do not decay and are not seen by C or not excited by W.
pub fn steady_kalman(plant: &StateSpace, w: &Matrix, v: &Matrix) -> Result<SteadyKalman, LtiError> {
    let dual = plant.dual();
    let solution = lqr(&dual, w, v).map_err(|e| match e {
        // The names of the dual problem.
        LtiError::NotStabilizable { eigenvalue } => LtiError::NotDetectable { eigenvalue },
        LtiError::NotDetectable { eigenvalue } => LtiError::NotStabilizable { eigenvalue },
        LtiError::NotPositiveDefinite { smallest, .. } => LtiError::NotPositiveDefinite {
            what: "the intensity V of the measurement noise".into(),
            smallest,
        },
        LtiError::NotSemidefinite { smallest, .. } => LtiError::NotSemidefinite {
            what: "the intensity W of the process noise".into(),
            smallest,
        },
        other => other,
    })?;
    Ok(SteadyKalman {
        gain: solution.gain.transpose(),
        covariance: solution.x,
        residual: solution.residual,
    })
}

/// Compensator of state feedback K and observer gain L, to be closed by negative feedback: `u = -compensator(y)`.
///
/// `x^' = (A - B K - L C + L D K) x^ + L y`, output `K x^`.
pub fn observer_based(plant: &StateSpace, k: &Matrix, l: &Matrix) -> Result<StateSpace, LtiError> {
    let n = plant.order();
    shaped("the state feedback K", k, plant.inputs(), n)?;
    shaped("the observer gain L", l, n, plant.outputs())?;
    let a = &plant.a - &plant.b * k - l * &plant.c + l * &plant.d * k;
    let out = StateSpace::new(
        a,
        l.clone(),
        k.clone(),
        Matrix::zeros(plant.inputs(), plant.outputs()),
    )?;
    Ok(StateSpace {
        sampling_time: plant.sampling_time,
        ..out
    })
}

/// A linear-quadratic-Gaussian design.
#[derive(Debug, Clone)]
pub struct Lqg {
    /// Compensator, closed by negative feedback.
    pub compensator: StateSpace,
    /// State feedback.
    pub regulator: RiccatiSolution,
    /// Filter.
    pub filter: SteadyKalman,
}

/// LQG: regulator for Q, R and filter for W, V, separately optimal.
pub fn lqg(
    plant: &StateSpace,
    q: &Matrix,
    r: &Matrix,
    w: &Matrix,
    v: &Matrix,
) -> Result<Lqg, LtiError> {
    let regulator = lqr(plant, q, r)?;
    let filter = steady_kalman(plant, w, v)?;
    let compensator = observer_based(plant, &regulator.gain, &filter.gain)?;
    Ok(Lqg {
        compensator,
        regulator,
        filter,
    })
}

/// Observer gain for loop transfer recovery at the plant input: process noise B B', measurement noise mu I (Kida 1993 eq. (3.15); Doyle & Stein 1979).
///
/// As mu falls, the loop with the observer tends to the loop of the state feedback, if the plant has no zero in the right half plane (Theorem 3.6).
pub fn recovery_observer(plant: &StateSpace, mu: f64) -> Result<SteadyKalman, LtiError> {
    crate::matrix::positive("mu", mu)?;
    steady_kalman(
        plant,
        &(&plant.b * plant.b.transpose()),
        &(identity(plant.outputs()) * mu),
    )
}

/// Closed loop of plant and compensator with the disturbance at the plant input and the noise at the measurement as inputs, and plant output and
/// control `u` as outputs: `[w; v] -> [y; u]`, `u = -K (y + v)`, plant input `u + w`.
pub fn closed_loop(plant: &StateSpace, compensator: &StateSpace) -> Result<StateSpace, LtiError> {
    let (m, p) = (plant.inputs(), plant.outputs());
    let n = plant.order();
    let z = Matrix::zeros;
    let (im, ip) = (identity(m), identity(p));
    // Inputs [w; v; u], outputs [y; u; y + v].
    let generalized = StateSpace {
        a: plant.a.clone(),
        b: blocks(&[&[&plant.b, &z(n, p), &plant.b]]),
        c: blocks(&[&[&plant.c], &[&z(m, n)], &[&plant.c]]),
        d: blocks(&[
            &[&plant.d, &z(p, p), &plant.d],
            &[&z(m, m), &z(m, p), &im],
            &[&plant.d, &ip, &plant.d],
        ]),
        sampling_time: plant.sampling_time,
    };
    generalized.lower_lft(&compensator.negated(), p, m)
}

/// Closed loop from the reference of every plant output to `[y; u]`, with `u = K (r - y)`.
pub fn tracking_loop(plant: &StateSpace, compensator: &StateSpace) -> Result<StateSpace, LtiError> {
    let (m, p) = (plant.inputs(), plant.outputs());
    let outputs: Vec<usize> = (0..p + m).collect();
    let noise: Vec<usize> = (m..m + p).collect();
    // A reference acts as measurement noise with the opposite sign.
    closed_loop(plant, compensator)?
        .select(&outputs, &noise)?
        .scaled_inputs(&-identity(p))
}
