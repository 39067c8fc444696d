//! Scalar transfer functions, for plants with one input and for shaping filters.

use crate::matrix::{Complex, Matrix, positive};
use crate::{LtiError, StateSpace};

/// A ratio of polynomials in s, coefficients from the highest power down.
///
/// ```
/// use fuyu_lti::{Complex, TransferFunction};
/// let lowpass = TransferFunction::second_order_lowpass(10.0, 0.7)?; // 100 / (s^2 + 14 s + 100)
/// assert!((lowpass.at(Complex::new(0.0, 0.0)) - 1.0).norm() < 1e-15);
/// assert_eq!(lowpass.to_state_space()?.order(), 2);
/// # Ok::<(), fuyu_lti::LtiError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFunction {
    numerator: Vec<f64>,
    denominator: Vec<f64>,
}

impl TransferFunction {
    /// Leading zeros are removed. Errors: a denominator that is zero, coefficients that are not finite.
    pub fn new(numerator: &[f64], denominator: &[f64]) -> Result<Self, LtiError> {
        for (what, list) in [
            ("the numerator", numerator),
            ("the denominator", denominator),
        ] {
            if let Some((col, &value)) = list.iter().enumerate().find(|(_, v)| !v.is_finite()) {
                return Err(LtiError::NotFinite {
                    what: what.into(),
                    value,
                    row: 0,
                    col,
                });
            }
        }
        let trimmed = |list: &[f64]| {
            list.iter()
                .copied()
                .skip_while(|&v| v == 0.0)
                .collect::<Vec<_>>()
        };
        let (numerator, denominator) = (trimmed(numerator), trimmed(denominator));
        if denominator.is_empty() {
            return Err(LtiError::Range {
                what: "the denominator".into(),
                value: 0.0,
                expected: "a polynomial other than zero",
            });
        }
        Ok(Self {
            numerator,
            denominator,
        })
    }

    /// `w0 / (s + w0)`, cut-off w0 in rad/s.
    pub fn first_order_lowpass(w0: f64) -> Result<Self, LtiError> {
        positive("the cut-off frequency", w0)?;
        Self::new(&[w0], &[1.0, w0])
    }

    /// `w0^2 / (s^2 + 2 zeta w0 s + w0^2)`, w0 in rad/s.
    pub fn second_order_lowpass(w0: f64, zeta: f64) -> Result<Self, LtiError> {
        positive("the cut-off frequency", w0)?;
        positive("the damping ratio", zeta)?;
        Self::new(&[w0 * w0], &[1.0, 2.0 * zeta * w0, w0 * w0])
    }

    /// `k (s + zero) / (s + pole)`: lead for zero < pole, lag for zero > pole, both in rad/s.
    pub fn lead_lag(k: f64, zero: f64, pole: f64) -> Result<Self, LtiError> {
        Self::new(&[k, k * zero], &[1.0, pole])
    }

    /// Coefficients of the numerator, highest power first.
    pub fn numerator(&self) -> &[f64] {
        &self.numerator
    }

    /// Coefficients of the denominator, highest power first.
    pub fn denominator(&self) -> &[f64] {
        &self.denominator
    }

    /// Degree of the denominator minus that of the numerator; negative for an improper function.
    pub fn relative_degree(&self) -> isize {
        self.denominator.len() as isize - self.numerator.len() as isize
    }

    /// Value at s.
    pub fn at(&self, s: Complex) -> Complex {
        let value = |p: &[f64]| p.iter().fold(Complex::new(0.0, 0.0), |sum, &c| sum * s + c);
        value(&self.numerator) / value(&self.denominator)
    }

    /// Realisation in phase variables (controllable companion form). Error: improper, that is a numerator of higher degree than the denominator.
    pub fn to_state_space(&self) -> Result<StateSpace, LtiError> {
        if self.relative_degree() < 0 {
            return Err(LtiError::Range {
                what: "the relative degree of the transfer function".into(),
                value: self.relative_degree() as f64,
                expected: "0 or more, as a state-space model is proper",
            });
        }
        let n = self.denominator.len() - 1;
        let lead = self.denominator[0];
        // From the lowest power up, normalised.
        let den: Vec<f64> = self.denominator.iter().rev().map(|c| c / lead).collect();
        let mut num: Vec<f64> = self.numerator.iter().rev().map(|c| c / lead).collect();
        num.resize(n + 1, 0.0);
        let d = num[n];
        let a = Matrix::from_fn(n, n, |i, j| {
            if i + 1 == n {
                -den[j]
            } else if j == i + 1 {
                1.0
            } else {
                0.0
            }
        });
        let b = Matrix::from_fn(n, 1, |i, _| if i + 1 == n { 1.0 } else { 0.0 });
        let c = Matrix::from_fn(1, n, |_, j| num[j] - d * den[j]);
        StateSpace::new(a, b, c, Matrix::from_element(1, 1, d))
    }

    /// The same filter on each of m channels.
    pub fn to_diagonal(&self, m: usize) -> Result<StateSpace, LtiError> {
        let one = self.to_state_space()?;
        let mut out = StateSpace::gain(Matrix::zeros(0, 0));
        for _ in 0..m {
            out = out.append(&one)?;
        }
        Ok(out)
    }
}
