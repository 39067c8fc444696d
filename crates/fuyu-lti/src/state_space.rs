//! Systems in state space, and how they are connected.

use crate::eigen::beyond_limit;
use crate::matrix::{
    Complex, ComplexMatrix, Matrix, blocks, complex, identity, shaped, singular_values, solve,
    square,
};
use crate::{LtiError, eigenvalues};

/// A linear time-invariant system with n states, m inputs u and p outputs y.
///
/// Continuous: `x' = A x + B u`, `y = C x + D u`. Discrete: `x[k+1] = A x[k] + B u[k]`, with the sampling time in seconds.
///
/// ```
/// use fuyu_lti::{Matrix, StateSpace};
/// // A double integrator under negative position and rate feedback: poles where s^2 + 2 s + 1 = 0.
/// let plant = StateSpace::new(
///     Matrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]),
///     Matrix::from_row_slice(2, 1, &[0.0, 1.0]),
///     Matrix::identity(2, 2),
///     Matrix::zeros(2, 1),
/// )?;
/// let gain = StateSpace::gain(Matrix::from_row_slice(1, 2, &[1.0, 2.0]));
/// let closed = plant.feedback(&gain)?;
/// assert!(closed.poles()?.iter().all(|p| (p.re + 1.0).abs() < 1e-7));
/// # Ok::<(), fuyu_lti::LtiError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct StateSpace {
    /// n x n
    pub a: Matrix,
    /// n x m
    pub b: Matrix,
    /// p x n
    pub c: Matrix,
    /// p x m
    pub d: Matrix,
    /// Sampling time in s of a discrete system; `None` for a continuous one.
    pub sampling_time: Option<f64>,
}

impl StateSpace {
    /// A continuous system. Errors: sizes that do not match, entries that are not finite.
    pub fn new(a: Matrix, b: Matrix, c: Matrix, d: Matrix) -> Result<Self, LtiError> {
        let n = square("A", &a)?;
        shaped("B", &b, n, d.ncols())?;
        shaped("C", &c, d.nrows(), n)?;
        shaped("D", &d, c.nrows(), b.ncols())?;
        Ok(Self {
            a,
            b,
            c,
            d,
            sampling_time: None,
        })
    }

    /// A discrete system with this sampling time in s.
    pub fn discrete(
        a: Matrix,
        b: Matrix,
        c: Matrix,
        d: Matrix,
        sampling_time: f64,
    ) -> Result<Self, LtiError> {
        crate::matrix::positive("the sampling time", sampling_time)?;
        Ok(Self {
            sampling_time: Some(sampling_time),
            ..Self::new(a, b, c, d)?
        })
    }

    /// A continuous static gain.
    pub fn gain(d: Matrix) -> Self {
        Self {
            a: Matrix::zeros(0, 0),
            b: Matrix::zeros(0, d.ncols()),
            c: Matrix::zeros(d.nrows(), 0),
            d,
            sampling_time: None,
        }
    }

    /// Number of states.
    pub fn order(&self) -> usize {
        self.a.nrows()
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.b.ncols()
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.c.nrows()
    }

    /// Eigenvalues of A.
    pub fn poles(&self) -> Result<Vec<Complex>, LtiError> {
        eigenvalues(&self.a)
    }

    /// Whether every pole decays.
    pub fn is_stable(&self) -> Result<bool, LtiError> {
        Ok(self.stability_margin()? > 0.0)
    }

    /// Distance of the worst pole from the stability limit: minus the largest real part in rad/s, or for a discrete system 1 minus the largest modulus. Positive: stable.
    pub fn stability_margin(&self) -> Result<f64, LtiError> {
        Ok(match self.sampling_time {
            None => -crate::spectral_abscissa(&self.a)?,
            Some(_) => 1.0 - crate::spectral_radius(&self.a)?,
        })
    }

    pub(crate) fn require_stable(&self, what: &str) -> Result<(), LtiError> {
        let size = |p: &Complex| beyond_limit(*p, self.sampling_time.is_some());
        let worst = self
            .poles()?
            .into_iter()
            .max_by(|a, b| size(a).total_cmp(&size(b)));
        match worst {
            Some(pole) if size(&pole) >= 0.0 => Err(LtiError::Unstable {
                what: what.into(),
                pole,
            }),
            _ => Ok(()),
        }
    }

    /// D must be zero; `what` names the system whose D it is.
    pub(crate) fn require_no_feedthrough(&self, what: &str) -> Result<(), LtiError> {
        let value = self.d.amax();
        if value > 0.0 {
            return Err(LtiError::Range {
                what: format!("D of {what}"),
                value,
                expected: "zero",
            });
        }
        Ok(())
    }

    pub(crate) fn require_continuous(&self, what: &'static str) -> Result<(), LtiError> {
        match self.sampling_time {
            None => Ok(()),
            Some(h) => Err(LtiError::TimeDomain {
                what,
                expected: format!("a continuous system; this one is sampled every {h} s"),
            }),
        }
    }

    /// Transfer function matrix, p x m, at a point of the s plane (or of the z plane for a discrete system). Error: the point is a pole.
    pub fn at(&self, s: Complex) -> Result<ComplexMatrix, LtiError> {
        let n = self.order();
        let d = complex(&self.d);
        if n == 0 {
            return Ok(d);
        }
        let shifted = ComplexMatrix::identity(n, n) * s - complex(&self.a);
        let pole = || LtiError::Singular {
            what: format!("s I - A at s = {s}, a pole of the system,"),
        };
        let x = shifted.lu().solve(&complex(&self.b)).ok_or_else(pole)?;
        let value = complex(&self.c) * x + d;
        if value.iter().all(|v| v.re.is_finite() && v.im.is_finite()) {
            Ok(value)
        } else {
            Err(pole())
        }
    }

    /// Frequency response, p x m, at w in rad/s.
    pub fn response(&self, w: f64) -> Result<ComplexMatrix, LtiError> {
        self.at(match self.sampling_time {
            None => Complex::new(0.0, w),
            Some(h) => Complex::from_polar(1.0, w * h),
        })
    }

    /// Singular values of the frequency response at w in rad/s, in descending order.
    pub fn singular_values(&self, w: f64) -> Result<Vec<f64>, LtiError> {
        singular_values(&self.response(w)?)
    }

    /// Response to a constant input after all transients.
    pub fn dc_gain(&self) -> Result<Matrix, LtiError> {
        let one = if self.sampling_time.is_some() {
            Complex::new(1.0, 0.0)
        } else {
            Complex::new(0.0, 0.0)
        };
        Ok(self.at(one)?.map(|v| v.re))
    }

    fn same_time(&self, other: &Self, what: &'static str) -> Result<Option<f64>, LtiError> {
        if self.order() == 0 {
            return Ok(other.sampling_time);
        }
        if other.order() == 0 || self.sampling_time == other.sampling_time {
            return Ok(self.sampling_time);
        }
        let name =
            |h: Option<f64>| h.map_or("continuous".to_owned(), |h| format!("sampled every {h} s"));
        Err(LtiError::TimeDomain {
            what,
            expected: format!(
                "systems of one kind; one is {}, the other {}",
                name(self.sampling_time),
                name(other.sampling_time)
            ),
        })
    }

    /// `next` after `self`: the outputs of this system are the inputs of the next, `y = next(self(u))`.
    pub fn series(&self, next: &Self) -> Result<Self, LtiError> {
        let sampling_time = self.same_time(next, "a series connection")?;
        shaped(
            "the input matrix of the second system",
            &next.d,
            next.outputs(),
            self.outputs(),
        )?;
        let (n1, n2) = (self.order(), next.order());
        Ok(Self {
            a: blocks(&[
                &[&self.a, &Matrix::zeros(n1, n2)],
                &[&(&next.b * &self.c), &next.a],
            ]),
            b: blocks(&[&[&self.b], &[&(&next.b * &self.d)]]),
            c: blocks(&[&[&(&next.d * &self.c), &next.c]]),
            d: &next.d * &self.d,
            sampling_time,
        })
    }

    /// The same input to both, outputs added.
    pub fn parallel(&self, other: &Self) -> Result<Self, LtiError> {
        let sampling_time = self.same_time(other, "a parallel connection")?;
        shaped(
            "D of the second system",
            &other.d,
            self.outputs(),
            self.inputs(),
        )?;
        let (n1, n2) = (self.order(), other.order());
        Ok(Self {
            a: blocks(&[
                &[&self.a, &Matrix::zeros(n1, n2)],
                &[&Matrix::zeros(n2, n1), &other.a],
            ]),
            b: blocks(&[&[&self.b], &[&other.b]]),
            c: blocks(&[&[&self.c, &other.c]]),
            d: &self.d + &other.d,
            sampling_time,
        })
    }

    /// Both systems next to each other: inputs and outputs stacked.
    pub fn append(&self, other: &Self) -> Result<Self, LtiError> {
        let sampling_time = self.same_time(other, "stacking")?;
        let (n1, n2) = (self.order(), other.order());
        let z = Matrix::zeros;
        Ok(Self {
            a: blocks(&[&[&self.a, &z(n1, n2)], &[&z(n2, n1), &other.a]]),
            b: blocks(&[
                &[&self.b, &z(n1, other.inputs())],
                &[&z(n2, self.inputs()), &other.b],
            ]),
            c: blocks(&[
                &[&self.c, &z(self.outputs(), n2)],
                &[&z(other.outputs(), n1), &other.c],
            ]),
            d: blocks(&[
                &[&self.d, &z(self.outputs(), other.inputs())],
                &[&z(other.outputs(), self.inputs()), &other.d],
            ]),
            sampling_time,
        })
    }

    /// Negative feedback through `back`: `y = self(u - back(y))`. Error: `I + D_back D` is singular (an algebraic loop without solution).
    pub fn feedback(&self, back: &Self) -> Result<Self, LtiError> {
        shaped("D of the feedback", &back.d, self.inputs(), self.outputs())?;
        let (m, p) = (self.inputs(), self.outputs());
        // The generalised plant [u; v] -> [y; y] with the input u + v, closed by v = -back(y).
        let plant = Self {
            a: self.a.clone(),
            b: blocks(&[&[&self.b, &self.b]]),
            c: blocks(&[&[&self.c], &[&self.c]]),
            d: blocks(&[&[&self.d, &self.d], &[&self.d, &self.d]]),
            sampling_time: self.sampling_time,
        };
        plant.lower_lft(&back.negated(), p, m)
    }

    /// Lower linear fractional transformation: the last `measurements` outputs feed `controller`, which drives the last `controls` inputs.
    ///
    /// Errors: sizes, an algebraic loop without solution.
    pub fn lower_lft(
        &self,
        controller: &Self,
        measurements: usize,
        controls: usize,
    ) -> Result<Self, LtiError> {
        let sampling_time = self.same_time(controller, "a feedback connection")?;
        shaped("D of the controller", &controller.d, controls, measurements)?;
        if measurements > self.outputs() || controls > self.inputs() {
            return Err(LtiError::Shape {
                what: "D of the plant".into(),
                rows: self.outputs(),
                cols: self.inputs(),
                expected: format!("at least {measurements} x {controls}"),
            });
        }
        let (n, k) = (self.order(), controller.order());
        let (p1, m1) = (self.outputs() - measurements, self.inputs() - controls);
        let b1 = self.b.columns(0, m1).into_owned();
        let b2 = self.b.columns(m1, controls).into_owned();
        let c1 = self.c.rows(0, p1).into_owned();
        let c2 = self.c.rows(p1, measurements).into_owned();
        let d11 = self.d.view((0, 0), (p1, m1)).into_owned();
        let d12 = self.d.view((0, m1), (p1, controls)).into_owned();
        let d21 = self.d.view((p1, 0), (measurements, m1)).into_owned();
        let d22 = self.d.view((p1, m1), (measurements, controls)).into_owned();
        // u = (I - Dk D22)^-1 (Dk C2 x + Ck xk + Dk D21 w)
        let loop_matrix = identity(controls) - &controller.d * &d22;
        let inverse = solve(
            "the algebraic loop I - D_controller D22",
            &loop_matrix,
            &identity(controls),
        )?;
        let ux = &inverse * &controller.d * &c2;
        let uk = &inverse * &controller.c;
        let uw = &inverse * &controller.d * &d21;
        let (yx, yk, yw) = (&c2 + &d22 * &ux, &d22 * &uk, &d21 + &d22 * &uw);
        let out = Self {
            a: blocks(&[
                &[&(&self.a + &b2 * &ux), &(&b2 * &uk)],
                &[
                    &(&controller.b * &yx),
                    &(&controller.a + &controller.b * &yk),
                ],
            ]),
            b: blocks(&[&[&(b1 + &b2 * &uw)], &[&(&controller.b * &yw)]]),
            c: blocks(&[&[&(c1 + &d12 * &ux), &(&d12 * &uk)]]),
            d: d11 + &d12 * &uw,
            sampling_time,
        };
        debug_assert_eq!(out.order(), n + k);
        Ok(out)
    }

    /// The system with the opposite sign of its outputs.
    pub fn negated(&self) -> Self {
        Self {
            c: -&self.c,
            d: -&self.d,
            ..self.clone()
        }
    }

    /// The system with its states as outputs.
    pub(crate) fn to_states(&self) -> Self {
        Self {
            c: identity(self.order()),
            d: Matrix::zeros(self.order(), self.inputs()),
            ..self.clone()
        }
    }

    /// The dual system: A', C', B', D'.
    pub fn dual(&self) -> Self {
        Self {
            a: self.a.transpose(),
            b: self.c.transpose(),
            c: self.b.transpose(),
            d: self.d.transpose(),
            sampling_time: self.sampling_time,
        }
    }

    /// Inputs multiplied by a matrix before the system: `self * g`.
    pub fn scaled_inputs(&self, g: &Matrix) -> Result<Self, LtiError> {
        shaped("the input scaling", g, self.inputs(), g.ncols())?;
        Ok(Self {
            b: &self.b * g,
            d: &self.d * g,
            ..self.clone()
        })
    }

    /// Outputs multiplied by a matrix after the system: `g * self`.
    pub fn scaled_outputs(&self, g: &Matrix) -> Result<Self, LtiError> {
        shaped("the output scaling", g, g.nrows(), self.outputs())?;
        Ok(Self {
            c: g * &self.c,
            d: g * &self.d,
            ..self.clone()
        })
    }

    /// Only some inputs and outputs, by their indices from 0, in this order. Error: an index that does not exist.
    pub fn select(&self, outputs: &[usize], inputs: &[usize]) -> Result<Self, LtiError> {
        for (what, list, limit) in [
            ("output", outputs, self.outputs()),
            ("input", inputs, self.inputs()),
        ] {
            if let Some(&i) = list.iter().find(|&&i| i >= limit) {
                return Err(LtiError::Range {
                    what: format!("the index of an {what}"),
                    value: i as f64,
                    expected: "below the number of them",
                });
            }
        }
        let b = self.b.select_columns(inputs);
        let c = self.c.select_rows(outputs);
        let d = self.d.select_columns(inputs).select_rows(outputs);
        Ok(Self {
            b,
            c,
            d,
            ..self.clone()
        })
    }
}
