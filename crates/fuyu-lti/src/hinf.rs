//! H-infinity control: the central controller of Glover & Doyle.

use crate::matrix::{
    Matrix, blocks, full_svd, identity, positive, smallest_eigenvalue, solve, symmetric_part,
};
use crate::modes::{require_detectable, require_stabilizable};
use crate::riccati::stabilizing_solution;
use crate::{HinfNorm, LtiError, StateSpace, spectral_radius};

/// A controller that meets an H-infinity bound.
#[derive(Debug, Clone)]
pub struct HinfDesign {
    /// The controller, `u = K y`; positive feedback, as is usual in this theory.
    pub controller: StateSpace,
    /// The bound that it was designed for.
    pub gamma: f64,
    /// Norm of the closed loop, computed from the closed loop.
    pub norm: HinfNorm,
    /// Largest relative residual of the two Riccati equations.
    pub residual: f64,
    /// Largest eigenvalue of X Y over gamma squared; below 1.
    pub coupling: f64,
}

/// Central controller with `||closed loop|| < gamma` for a continuous generalised plant, whose last `measurements` outputs are measured
/// and whose last `controls` inputs are controlled.
///
/// Glover & Doyle, Systems & Control Letters 11 (1988), for any D11 and D22: two Riccati equations with indefinite quadratic terms. The
/// closed loop is formed, and the design refused unless it is stable and its norm, from the Hamiltonian matrix and from a frequency sweep, is below gamma.
/// Next to the smallest possible gamma rounding may let it exceed gamma by up to 1e-6 of it.
///
/// Errors: (A, B2) not stabilisable, (C2, A) not detectable, a control without weight (D12 without full column rank), a measurement without
/// noise (D21 without full row rank), zeros on the imaginary axis, and [`LtiError::NoController`] with the condition that fails if gamma is too small.
pub fn hinf_controller(
    plant: &StateSpace,
    measurements: usize,
    controls: usize,
    gamma: f64,
) -> Result<HinfDesign, LtiError> {
    plant.require_continuous("H-infinity design")?;
    positive("gamma", gamma)?;
    examined(plant, &normalized(plant, measurements, controls)?, gamma)
}

/// The central controller, refused unless its closed loop keeps the bound.
fn examined(plant: &StateSpace, problem: &Normalized, gamma: f64) -> Result<HinfDesign, LtiError> {
    let Central {
        controller,
        residual,
        coupling,
    } = central(problem, gamma)?;
    let closed = plant.lower_lft(&controller, problem.c2.nrows(), problem.b2.ncols())?;
    let refused = |reason: String| LtiError::NoController { gamma, reason };
    let norm = closed.hinf_norm().map_err(|e| {
        refused(format!(
            "the central controller fails on the closed loop: {e}"
        ))
    })?;
    if norm.norm.max(norm.swept) > gamma * (1.0 + 1e-6) {
        return Err(refused(format!(
            "the closed loop of the central controller has the norm {}; the problem is too badly conditioned",
            norm.norm
        )));
    }
    Ok(HinfDesign {
        controller,
        gamma,
        norm,
        residual,
        coupling,
    })
}

/// A central controller whose closed loop has not been examined.
struct Central {
    controller: StateSpace,
    residual: f64,
    coupling: f64,
}

/// The smallest gamma that a controller reaches, by bisection to the relative `tolerance`, and the design for the gamma found.
///
/// Errors as in [`hinf_controller`]; [`LtiError::NoController`] if no gamma up to 1e12 suffices.
pub fn hinf_optimal(
    plant: &StateSpace,
    measurements: usize,
    controls: usize,
    tolerance: f64,
) -> Result<HinfDesign, LtiError> {
    positive("the tolerance of gamma", tolerance)?;
    plant.require_continuous("H-infinity design")?;
    let problem = normalized(plant, measurements, controls)?;
    let mut best: Option<HinfDesign> = None;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..200 {
        let found = best.is_some();
        if found && high - low <= tolerance.max(1e-12) * high {
            break;
        }
        let gamma = if !found {
            high
        } else if low == 0.0 {
            0.1 * high
        } else {
            0.5 * (low + high)
        };
        match examined(plant, &problem, gamma) {
            Ok(design) => {
                (best, high) = (Some(design), gamma);
                if gamma < 1e-12 {
                    break;
                }
            }
            Err(e) if e.depends_on_gamma() => {
                if !found {
                    if high > 1e12 {
                        return Err(e);
                    }
                    high *= 10.0;
                }
                low = gamma;
            }
            Err(e) => return Err(e),
        }
    }
    best.ok_or(LtiError::NoController {
        gamma: high,
        reason: "the search ended".into(),
    })
}

/// Plant with D12 = [0; I], D21 = [0 I], D22 = 0, and what turns its controller into one for the original plant.
struct Normalized {
    a: Matrix,
    b1: Matrix,
    b2: Matrix,
    c1: Matrix,
    c2: Matrix,
    d11: Matrix,
    control: Matrix,
    measurement: Matrix,
    d22: Matrix,
}

fn normalized(plant: &StateSpace, p2: usize, m2: usize) -> Result<Normalized, LtiError> {
    let (p, m) = (plant.outputs(), plant.inputs());
    if p2 == 0 || m2 == 0 || p2 >= p || m2 >= m {
        return Err(LtiError::Shape {
            what: "D of the generalised plant".into(),
            rows: p,
            cols: m,
            expected: format!(
                "larger than {p2} x {m2}, with at least one measurement and one control"
            ),
        });
    }
    let (p1, m1) = (p - p2, m - m2);
    let (b1, b2) = (
        plant.b.columns(0, m1).into_owned(),
        plant.b.columns(m1, m2).into_owned(),
    );
    let (c1, c2) = (
        plant.c.rows(0, p1).into_owned(),
        plant.c.rows(p1, p2).into_owned(),
    );
    require_stabilizable(&plant.a, &b2, false)?;
    require_detectable(&plant.a, &c2, false)?;
    let d11 = plant.d.view((0, 0), (p1, m1)).into_owned();
    let d12 = plant.d.view((0, m1), (p1, m2)).into_owned();
    let d21 = plant.d.view((p1, 0), (p2, m1)).into_owned();
    let d22 = plant.d.view((p1, m1), (p2, m2)).into_owned();
    // z' = [U2 U1]' z and u = V S^-1 u' make D12' = [0; I].
    let (u, s, v) = svd_of_rank("D12'D12 (every control needs a weight)", &d12, m2)?;
    let z_rows: Vec<usize> = (m2..p1).chain(0..m2).collect();
    let z = u.select_columns(&z_rows).transpose();
    let control = Matrix::from_fn(m2, m2, |i, j| v[(i, j)] / s[j]);
    // w = [V2 V1] w' and y' = S^-1 U' y make D21' = [0 I].
    let (u, s, v) = svd_of_rank("D21 D21' (every measurement needs noise)", &d21, p2)?;
    let w_columns: Vec<usize> = (p2..m1).chain(0..p2).collect();
    let w = v.select_columns(&w_columns);
    let measurement = Matrix::from_fn(p2, p2, |i, j| u[(j, i)] / s[i]);
    Ok(Normalized {
        a: plant.a.clone(),
        b1: b1 * &w,
        b2: b2 * &control,
        c1: &z * c1,
        c2: &measurement * c2,
        d11: z * d11 * w,
        control,
        measurement,
        d22,
    })
}

/// Full singular value decomposition. Error, with the name of the singular product: the rank is below `rank`.
fn svd_of_rank(
    product: &str,
    m: &Matrix,
    rank: usize,
) -> Result<(Matrix, Vec<f64>, Matrix), LtiError> {
    let (u, s, v) = full_svd(m)?;
    if s.len() < rank
        || s.last()
            .is_none_or(|&last| last <= 1e-13 * s[0].max(1e-300))
    {
        return Err(LtiError::Singular {
            what: product.into(),
        });
    }
    Ok((u, s, v))
}

/// Zero where a product of the size of `factor` squared has cancelled to rounding: a noise-free problem, such as pure feed-forward, has Y = 0.
fn without_rounding(m: Matrix, factor: &Matrix) -> Matrix {
    let limit = 1e-14 * factor.norm_squared();
    let m = symmetric_part(&m);
    if m.norm() <= limit { m * 0.0 } else { m }
}

fn central(g: &Normalized, gamma: f64) -> Result<Central, LtiError> {
    let n = g.a.nrows();
    let (m1, p1) = (g.b1.ncols(), g.c1.nrows());
    let (m2, p2) = (g.b2.ncols(), g.c2.nrows());
    let square = gamma * gamma;
    let refused = |reason: &str| LtiError::NoController {
        gamma,
        reason: reason.into(),
    };
    let zeros = Matrix::zeros;

    // D11 in blocks: rows p1 - m2 and m2, columns m1 - p2 and p2.
    let (r1, k1) = (p1 - m2, m1 - p2);
    let d1111 = g.d11.view((0, 0), (r1, k1)).into_owned();
    let d1112 = g.d11.view((0, k1), (r1, p2)).into_owned();
    let d1121 = g.d11.view((r1, 0), (m2, k1)).into_owned();
    let d1122 = g.d11.view((r1, k1), (m2, p2)).into_owned();
    let below = |m: &Matrix| -> Result<bool, LtiError> {
        Ok(full_svd(m)?.1.first().is_none_or(|&s| s < gamma))
    };
    if !below(&g.d11.rows(0, r1).into_owned())? || !below(&g.d11.columns(0, k1).into_owned())? {
        return Err(refused(
            "the direct transmission D11 alone reaches the bound",
        ));
    }

    let d12 = blocks(&[&[&zeros(r1, m2)], &[&identity(m2)]]);
    let d21 = blocks(&[&[&zeros(p2, k1), &identity(p2)]]);
    let b = blocks(&[&[&g.b1, &g.b2]]);
    let c = blocks(&[&[&g.c1], &[&g.c2]]);
    let row = blocks(&[&[&g.d11, &d12]]);
    let column = blocks(&[&[&g.d11], &[&d21]]);
    let mut r = row.transpose() * &row;
    let mut rt = &column * column.transpose();
    for i in 0..m1 {
        r[(i, i)] -= square;
    }
    for i in 0..p1 {
        rt[(i, i)] -= square;
    }
    let r_inv = solve("R of the control Riccati equation", &r, &identity(m1 + m2))?;
    let rt_inv = solve("R of the filter Riccati equation", &rt, &identity(p1 + p2))?;

    let x_a = &g.a - &b * &r_inv * row.transpose() * &g.c1;
    let x_g = &b * &r_inv * b.transpose();
    let x_q = without_rounding(
        g.c1.transpose() * (identity(p1) - &row * &r_inv * row.transpose()) * &g.c1,
        &g.c1,
    );
    let unsolved = |e: LtiError, name: &str| LtiError::NoController {
        gamma,
        reason: format!("the {name} Riccati equation is unsolvable: {e}"),
    };
    let (x, x_residual) =
        stabilizing_solution(&x_a, &x_g, &x_q, "H-infinity control Riccati equation")
            .map_err(|e| unsolved(e, "control"))?;
    let y_a = g.a.transpose() - c.transpose() * &rt_inv * &column * g.b1.transpose();
    let y_g = c.transpose() * &rt_inv * &c;
    let y_q = without_rounding(
        &g.b1 * (identity(m1) - column.transpose() * &rt_inv * &column) * g.b1.transpose(),
        &g.b1,
    );
    let (y, y_residual) =
        stabilizing_solution(&y_a, &y_g, &y_q, "H-infinity filter Riccati equation")
            .map_err(|e| unsolved(e, "filter"))?;
    for (m, name) in [
        (
            &x,
            "the solution of the control Riccati equation is not positive semidefinite",
        ),
        (
            &y,
            "the solution of the filter Riccati equation is not positive semidefinite",
        ),
    ] {
        if smallest_eigenvalue(m)? < -1e-7 * m.amax() {
            return Err(refused(name));
        }
    }
    let coupling = spectral_radius(&(&x * &y))? / square;
    if coupling >= 1.0 {
        return Err(refused(
            "the spectral radius of X Y is not below gamma squared",
        ));
    }

    let f = -&r_inv * (row.transpose() * &g.c1 + b.transpose() * &x);
    let l = -(&g.b1 * column.transpose() + &y * c.transpose()) * &rt_inv;
    let f12 = f.rows(k1, p2).into_owned();
    let f2 = f.rows(m1, m2).into_owned();
    let l12 = l.columns(r1, m2).into_owned();
    let l2 = l.columns(p1, p2).into_owned();

    // (gamma^2 I - D1111 D1111')^-1 and its mirror.
    let left = solve(
        "gamma^2 I - D1111 D1111'",
        &(identity(r1) * square - &d1111 * d1111.transpose()),
        &identity(r1),
    )?;
    let right = solve(
        "gamma^2 I - D1111'D1111",
        &(identity(k1) * square - d1111.transpose() * &d1111),
        &identity(k1),
    )?;
    let hat11 = -&d1121 * d1111.transpose() * &left * &d1112 - d1122;
    let square12 = identity(m2) - &d1121 * &right * d1121.transpose();
    let square21 = identity(p2) - d1112.transpose() * &left * &d1112;
    let factor = |m: Matrix| {
        nalgebra::Cholesky::new(symmetric_part(&m))
            .map(|c| c.l())
            .ok_or_else(|| refused("the direct transmission D11 alone reaches the bound"))
    };
    let hat12 = factor(square12)?;
    let hat21 = factor(square21)?.transpose();
    let z = solve(
        "I - Y X / gamma^2",
        &(identity(n) - &y * &x / square),
        &identity(n),
    )?;
    let b2_hat = &z * (&g.b2 + l12) * &hat12;
    let c2_hat = -&hat21 * (&g.c2 + f12);
    let hat12_inv = solve("D12 of the controller", &hat12, &hat11)?;
    let b1_hat = -&z * l2 + &b2_hat * hat12_inv;
    let through = solve("D21 of the controller", &hat21, &c2_hat)?;
    let c1_hat = f2 + &hat11 * &through;
    let a_hat = &g.a + &b * &f + &b1_hat * through;

    let normal = StateSpace::new(
        a_hat,
        b1_hat * &g.measurement,
        &g.control * c1_hat,
        &g.control * hat11 * &g.measurement,
    )?;
    // y = y0 + D22 u, and the controller above is for y0.
    let controller = if g.d22.amax() > 0.0 {
        normal.feedback(&StateSpace::gain(g.d22.clone()))?
    } else {
        normal
    };
    Ok(Central {
        controller,
        residual: x_residual.max(y_residual),
        coupling,
    })
}
