//! Sampled systems: zero-order hold with input delay, by the matrix exponential.

use crate::matrix::{Matrix, blocks, identity, positive};
use crate::{LtiError, StateSpace};

/// Largest `|A h|` whose exponential is computed.
const LARGEST_EXPONENT: f64 = 500.0;

impl StateSpace {
    /// The system as a sampler with zero-order hold sees it: inputs are held for `step` seconds, outputs are sampled at the beginning of each step.
    ///
    /// Exact: `[A B; 0 0] h` is exponentiated (Van Loan 1978). Errors: not continuous, a step that is not positive or so long that the exponential overflows.
    pub fn zero_order_hold(&self, step: f64) -> Result<Self, LtiError> {
        self.zero_order_hold_delayed(step, 0.0)
    }

    /// As [`StateSpace::zero_order_hold`], with inputs that act `delay` seconds late (computation, transport).
    ///
    /// Past inputs are further states: one set for each step that has begun. Delays need not be multiples of the step.
    ///
    /// ```
    /// use fuyu_lti::{Matrix, StateSpace};
    /// // x' = u, one and a half steps late: after two steps of unit input, half a step has acted.
    /// let one = Matrix::identity(1, 1);
    /// let g = StateSpace::new(Matrix::zeros(1, 1), one.clone(), one, Matrix::zeros(1, 1))?.zero_order_hold_delayed(1.0, 1.5)?;
    /// let y = g.step_response(0, 5)?;
    /// assert_eq!(y.iter().map(|v| v[0]).collect::<Vec<_>>(), [0.0, 0.0, 0.5, 1.5, 2.5]);
    /// # Ok::<(), fuyu_lti::LtiError>(())
    /// ```
    pub fn zero_order_hold_delayed(&self, step: f64, delay: f64) -> Result<Self, LtiError> {
        self.require_continuous("zero-order hold")?;
        positive("the sampling time", step)?;
        if !(delay >= 0.0 && delay <= 1e4 * step) {
            return Err(LtiError::Range {
                what: "the input delay".into(),
                value: delay,
                expected: "between 0 and 10000 steps",
            });
        }
        let (n, m) = (self.order(), self.inputs());
        // Whole steps begun, and the part of a step during which the older input still acts.
        let count = (delay / step - 1e-12).ceil().max(0.0) as usize;
        if count == 0 {
            let (a, b) = held(&self.a, &self.b, step)?;
            return Self::discrete(a, b, self.c.clone(), self.d.clone(), step);
        }
        let late = (delay - (count - 1) as f64 * step).min(step);
        let (early_phi, early_gamma) = held(&self.a, &self.b, late)?;
        let (rest_phi, newer) = held(&self.a, &self.b, step - late)?;
        let older = &rest_phi * early_gamma;
        let phi = rest_phi * early_phi;
        // States: x, then the inputs of the last `count` steps, oldest first.
        let size = n + count * m;
        let mut a = Matrix::zeros(size, size);
        a.view_mut((0, 0), (n, n)).copy_from(&phi);
        a.view_mut((0, n), (n, m)).copy_from(&older);
        let mut b = Matrix::zeros(size, m);
        if count == 1 {
            b.view_mut((0, 0), (n, m)).copy_from(&newer);
        } else {
            a.view_mut((0, n + m), (n, m)).copy_from(&newer);
        }
        for k in 0..count - 1 {
            a.view_mut((n + k * m, n + (k + 1) * m), (m, m))
                .copy_from(&identity(m));
        }
        b.view_mut((size - m, 0), (m, m)).copy_from(&identity(m));
        let mut c = Matrix::zeros(self.outputs(), size);
        c.view_mut((0, 0), (self.outputs(), n)).copy_from(&self.c);
        c.view_mut((0, n), (self.outputs(), m)).copy_from(&self.d);
        Self::discrete(a, b, c, Matrix::zeros(self.outputs(), m), step)
    }

    /// Tustin's method, `s = (2/h) (z - 1)/(z + 1)`: stable systems stay stable. Error: a pole at 2/h.
    pub fn tustin(&self, step: f64) -> Result<Self, LtiError> {
        self.require_continuous("Tustin's method")?;
        positive("the sampling time", step)?;
        let one = identity(self.order());
        let left = &one - &self.a * (0.5 * step);
        let inverse = crate::matrix::solve("I - A h/2 of Tustin's method", &left, &one)?;
        let a = &inverse * (&one + &self.a * (0.5 * step));
        let b = &inverse * &self.b * step.sqrt();
        let c = &self.c * &inverse * step.sqrt();
        let d = &self.d + &self.c * &inverse * &self.b * (0.5 * step);
        Self::discrete(a, b, c, d, step)
    }
}

/// `exp(A h)` and the integral of `exp(A t) B` from 0 to h.
fn held(a: &Matrix, b: &Matrix, h: f64) -> Result<(Matrix, Matrix), LtiError> {
    let (n, m) = b.shape();
    if n == 0 {
        return Ok((Matrix::zeros(0, 0), Matrix::zeros(0, m)));
    }
    if h == 0.0 {
        return Ok((identity(n), Matrix::zeros(n, m)));
    }
    let growth = crate::spectral_abscissa(a)? * h;
    if growth > LARGEST_EXPONENT {
        return Err(LtiError::Range {
            what: "the growth over one sampling time, in e-folds,".into(),
            value: growth,
            expected: "at most 500",
        });
    }
    let big = blocks(&[&[a, b], &[&Matrix::zeros(m, n), &Matrix::zeros(m, m)]]) * h;
    // Scaling and squaring of nalgebra (Higham 2005).
    let e = big.exp();
    if e.iter().any(|v| !v.is_finite()) {
        return Err(LtiError::Range {
            what: "the norm of A times the sampling time".into(),
            value: (a * h).norm(),
            expected: "small enough for the exponential to be finite",
        });
    }
    Ok((
        e.view((0, 0), (n, n)).into_owned(),
        e.view((0, n), (n, m)).into_owned(),
    ))
}
