//! Frequency-shaped linear-quadratic regulators (Gupta 1980; Kida 1993 sections 3.3 and 3.5, appendix 3E).

use crate::matrix::{Matrix, blocks, identity, positive, shaped};
use crate::{LtiError, StateSpace, care};

/// Weights of the cost `integral of |q(jw) C x|^2 + rho |r(jw) u|^2 dw`.
#[derive(Debug, Clone)]
pub struct ShapedWeights {
    /// The controlled variables are `y = C x`; C is ny x n.
    pub controlled: Matrix,
    /// q(s), stable and proper, from y. `None`: 1.
    pub output_weight: Option<StateSpace>,
    /// 1/r(s), stable and proper, m x m. `None`: 1.
    pub inverse_input_weight: Option<StateSpace>,
    /// rho, positive.
    pub rho: f64,
}

/// A frequency-shaped regulator.
///
/// The states of the extended system are `[x_r; x; x_q]`: of 1/r, of the plant, of q. The optimal virtual input is
/// `v = -K_r x_r - K x - K_q x_q`, and `u = (1/r) v`.
#[derive(Debug, Clone)]
pub struct ShapedRegulator {
    /// K_r, m x (order of 1/r).
    pub gain_r: Matrix,
    /// K, m x n.
    pub gain: Matrix,
    /// K_q, m x (order of q).
    pub gain_q: Matrix,
    /// Relative residual of the Riccati equation.
    pub residual: f64,
    /// The regulator as a system from x to w, with `u = -w`: k(s) of Kida 1993 eq. (3.12). Its states are `[-x_r; x_q]`.
    pub state_feedback: StateSpace,
    plant: StateSpace,
    filter: StateSpace,
    weight: StateSpace,
    controlled: Matrix,
}

/// Designs the regulator for a continuous, strictly proper plant.
///
/// Appendix 3E prints the blocks of q and 1/r in each other's places and `C C'` for `C'C`; here 1/r precedes the plant and q follows it, as
/// in sections 3.3 and 3.5.
///
/// Errors: unstable weights, an extended system that is not stabilisable or detectable (a pole of 1/r at a zero of the plant, a pole of the plant at a zero of the weights).
pub fn shaped_lqr(
    plant: &StateSpace,
    weights: &ShapedWeights,
) -> Result<ShapedRegulator, LtiError> {
    plant.require_continuous("a frequency-shaped regulator")?;
    plant.require_no_feedthrough("the plant")?;
    positive("rho", weights.rho)?;
    let (n, m) = (plant.order(), plant.inputs());
    let ny = weights.controlled.nrows();
    shaped("C", &weights.controlled, ny, n)?;
    let filter = weights
        .inverse_input_weight
        .clone()
        .unwrap_or_else(|| StateSpace::gain(identity(m)));
    let weight = weights
        .output_weight
        .clone()
        .unwrap_or_else(|| StateSpace::gain(identity(ny)));
    shaped("D of the weight 1/r", &filter.d, m, m)?;
    shaped("D of the weight q", &weight.d, weight.outputs(), ny)?;
    for (name, w) in [("the weight 1/r", &filter), ("the weight q", &weight)] {
        w.require_continuous("a frequency-shaped regulator")?;
        w.require_stable(name)?;
    }
    let (nr, nq) = (filter.order(), weight.order());
    let z = Matrix::zeros;
    let a = blocks(&[
        &[&filter.a, &z(nr, n), &z(nr, nq)],
        &[&(&plant.b * &filter.c), &plant.a, &z(n, nq)],
        &[&z(nq, nr), &(&weight.b * &weights.controlled), &weight.a],
    ]);
    let b = blocks(&[&[&filter.b], &[&(&plant.b * &filter.d)], &[&z(nq, m)]]);
    let c = blocks(&[&[
        &z(weight.outputs(), nr),
        &(&weight.d * &weights.controlled),
        &weight.c,
    ]]);
    let solution = care(&a, &b, &(c.transpose() * &c), &(identity(m) * weights.rho))?;
    let gain_r = solution.gain.columns(0, nr).into_owned();
    let gain = solution.gain.columns(nr, n).into_owned();
    let gain_q = solution.gain.columns(nr + n, nq).into_owned();
    let state_feedback = StateSpace::new(
        blocks(&[
            &[&(&filter.a - &filter.b * &gain_r), &(&filter.b * &gain_q)],
            &[&z(nq, nr), &weight.a],
        ]),
        blocks(&[
            &[&(&filter.b * &gain)],
            &[&(&weight.b * &weights.controlled)],
        ]),
        blocks(&[&[&(&filter.c - &filter.d * &gain_r), &(&filter.d * &gain_q)]]),
        &filter.d * &gain,
    )?;
    Ok(ShapedRegulator {
        gain_r,
        gain,
        gain_q,
        residual: solution.residual,
        state_feedback,
        plant: plant.clone(),
        filter,
        weight,
        controlled: weights.controlled.clone(),
    })
}

impl ShapedRegulator {
    /// Loop of the state feedback, cut at the plant input: `l(s) = k(s) (s I - A)^-1 B`.
    pub fn state_loop(&self) -> Result<StateSpace, LtiError> {
        self.plant.to_states().series(&self.state_feedback)
    }

    /// The filter 1/r as the optimal feedback changes it: `C_r' (s I - A_r + B_r K_r)^-1 B_r + D_r` with `C_r' = C_r - D_r K_r` (Kida 1993 eqs. (3.12), (3.27)).
    pub fn realized_filter(&self) -> Result<StateSpace, LtiError> {
        let f = &self.filter;
        StateSpace::new(
            &f.a - &f.b * &self.gain_r,
            f.b.clone(),
            &f.c - &f.d * &self.gain_r,
            f.d.clone(),
        )
    }

    /// Output feedback with an observer of gain L (n x p) for the measurements of the plant: `u = -compensator(z)`, Kida 1993 eq. (3.16) and appendix 3E.
    ///
    /// States `[-x_r; x_q; x^]`.
    pub fn compensator(&self, l: &Matrix) -> Result<StateSpace, LtiError> {
        let (g, f, q) = (&self.plant, &self.filter, &self.weight);
        shaped("the observer gain L", l, g.order(), g.outputs())?;
        let (nr, nq, p) = (f.order(), q.order(), g.outputs());
        let z = Matrix::zeros;
        let out = &f.c - &f.d * &self.gain_r;
        let (dk, dkq) = (&f.d * &self.gain, &f.d * &self.gain_q);
        StateSpace::new(
            blocks(&[
                &[
                    &(&f.a - &f.b * &self.gain_r),
                    &(&f.b * &self.gain_q),
                    &(&f.b * &self.gain),
                ],
                &[&z(nq, nr), &q.a, &(&q.b * &self.controlled)],
                &[
                    &(-&g.b * &out),
                    &(-&g.b * &dkq),
                    &(&g.a - l * &g.c - &g.b * &dk),
                ],
            ]),
            blocks(&[&[&z(nr, p)], &[&z(nq, p)], &[l]]),
            blocks(&[&[&out, &dkq, &dk]]),
            z(g.inputs(), p),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // The extended system has no place for D: a plant with one would be designed for as if it were zero.
    #[test]
    fn a_plant_that_is_not_strictly_proper_is_refused() {
        let one = |x: f64| Matrix::from_element(1, 1, x);
        let weights = ShapedWeights {
            controlled: one(1.0),
            output_weight: None,
            inverse_input_weight: None,
            rho: 1.0,
        };
        let plant = |d: f64| StateSpace::new(one(-1.0), one(1.0), one(1.0), one(d)).unwrap();
        assert!(shaped_lqr(&plant(0.0), &weights).is_ok());
        let error = shaped_lqr(&plant(0.5), &weights).unwrap_err();
        assert!(error.to_string().contains("D of the plant is"), "{error}");
    }
}
