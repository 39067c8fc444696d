//! Control with two degrees of freedom: feed-forward that makes the closed loop follow a model (section 4.4.2).

use nalgebra::DVector;

use super::air_table;
use crate::matrix::{Matrix, blocks, identity};
use crate::{HinfDesign, LtiError, StateSpace, Structure, hinf_optimal};

/// Direct feedback `u = v - P angle - D rate` on the air table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// (a), (b) or (c).
    pub name: &'static str,
    /// P in N m/rad.
    pub p: f64,
    /// D in N m s/rad.
    pub d: f64,
}

/// The three cases of Figs. 4.22 to 4.25: lightly damped, damping ratio near .7, overdamped.
pub const CASES: [Case; 3] = [
    Case {
        name: "(a)",
        p: 126.0,
        d: 12.6,
    },
    Case {
        name: "(b)",
        p: 10.0,
        d: 10.0,
    },
    Case {
        name: "(c)",
        p: 1.6,
        d: 8.0,
    },
];

/// A two-degree-of-freedom design.
#[derive(Debug, Clone)]
pub struct ModelMatching {
    /// The feedback.
    pub case: Case,
    /// From the reference to `[v1; v2; v3]`: K_1 and the two rows of K_2, with `v = K_1 r`, `[v2; v3] = K_2 r` (eq. (4.25)).
    pub feed_forward: StateSpace,
    /// Design with its norm.
    pub hinf: HinfDesign,
    /// From r to `[angle; rate]` for the rigid design model: `G_D (K_1 + K_0 K_2)`.
    pub matched: StateSpace,
    /// The same for the seven-mode plant.
    pub achieved: StateSpace,
}

/// Reference model `k / (s^2 + c s + k)` with k = 1/2 and c = sqrt 2, from r to `[angle; rate]`.
///
/// (The thesis writes the second parameter once as c, once as d.)
pub fn reference_model() -> Result<StateSpace, LtiError> {
    let (k, c) = (0.5, 2f64.sqrt());
    StateSpace::new(
        Matrix::from_row_slice(2, 2, &[0.0, 1.0, -k, -c]),
        Matrix::from_row_slice(2, 1, &[0.0, k]),
        identity(2),
        Matrix::zeros(2, 1),
    )
}

/// Closed loop of a structure under the direct feedback of a case, driven as in Fig. 4.21: `u = v1 - K_0 (y - [v2; v3])`, from `[v1; v2; v3]` to `[angle; rate]`.
pub fn driven(structure: &Structure, case: &Case) -> Result<StateSpace, LtiError> {
    let number = |v: f64| Matrix::from_element(1, 1, v);
    structure
        .direct_feedback(&number(case.p), &number(case.d))?
        .scaled_inputs(&Matrix::from_row_slice(1, 3, &[1.0, case.p, case.d]))
}

/// Designs K_1 and K_2 by H-infinity model matching of eqs. (4.23), (4.24) with `W0 = weight`, `W1 = 1`: the H-infinity norm of `[weight (G_M - G_yr); G_vr]` is made as small as possible, to the relative `tolerance`.
///
/// Feed-forward does not change stability. The thesis uses `W0 = 1`, for which the forward signals are hardly allowed; `weight` scales the demand for matching (gamma of the thesis).
pub fn model_matching(case: &Case, weight: f64, tolerance: f64) -> Result<ModelMatching, LtiError> {
    let model = reference_model()?;
    let rigid = driven(&air_table::structure(1)?, case)?;
    let z = Matrix::zeros;
    // Inputs [r; v (3)], outputs [z0 (2); z1 (3); r].
    let generalized = StateSpace::new(
        blocks(&[&[&model.a, &z(2, 2)], &[&z(2, 2), &rigid.a]]),
        blocks(&[&[&model.b, &z(2, 3)], &[&z(2, 1), &rigid.b]]),
        blocks(&[
            &[&(&model.c * weight), &(-&rigid.c * weight)],
            &[&z(3, 2), &z(3, 2)],
            &[&z(1, 2), &z(1, 2)],
        ]),
        blocks(&[
            &[&z(2, 1), &z(2, 3)],
            &[&z(3, 1), &identity(3)],
            &[&identity(1), &z(1, 3)],
        ]),
    )?;
    let hinf = hinf_optimal(&generalized, 1, 3, tolerance)?;
    let feed_forward = hinf.controller.clone();
    Ok(ModelMatching {
        case: *case,
        matched: feed_forward.series(&rigid)?,
        achieved: feed_forward.series(&driven(&air_table::structure(7)?, case)?)?,
        feed_forward,
        hinf,
    })
}

/// Response of the angle in rad to a reference of one degree every `step` s: `system` is from r to `[angle; rate]`.
pub fn step(system: &StateSpace, step: f64, samples: usize) -> Result<Vec<f64>, LtiError> {
    let degree = 1f64.to_radians();
    let outputs = system
        .zero_order_hold(step)?
        .simulate(samples, |_| DVector::from_element(1, degree))?;
    Ok(outputs.into_iter().map(|y| y[0]).collect())
}

/// The direct feedback alone, with the reference in place of the angle: from r to `[angle; rate]` of the seven-mode plant (Fig. 4.23 (a)).
pub fn feedback_only(case: &Case) -> Result<StateSpace, LtiError> {
    driven(&air_table::structure(7)?, case)?.scaled_inputs(&Matrix::from_row_slice(
        3,
        1,
        &[0.0, 1.0, 0.0],
    ))
}

/// Root locus of Fig. 4.22: poles of the seven-mode plant under `k [P D]` for each k.
pub fn root_locus(
    case: &Case,
    factors: &[f64],
) -> Result<Vec<(f64, Vec<crate::Complex>)>, LtiError> {
    let table = air_table::structure(7)?;
    let number = |v: f64| Matrix::from_element(1, 1, v);
    factors
        .iter()
        .map(|&k| {
            Ok((
                k,
                table
                    .direct_feedback(&number(k * case.p), &number(k * case.d))?
                    .poles()?,
            ))
        })
        .collect()
}
