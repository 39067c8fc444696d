//! Model reduction: square-root balanced truncation, modal truncation.

use crate::gramians::{controllability_gramian, observability_gramian, square_root};
use crate::matrix::{Matrix, blocks, full_svd, identity, positive, solve};
use crate::{LtiError, StateSpace};

/// A reduced model with the bound of its error.
#[derive(Debug, Clone)]
pub struct BalancedTruncation {
    /// The model, balanced: both Gramians are diag(hankel[..order]).
    pub system: StateSpace,
    /// Hankel singular values of the full system, in descending order.
    pub hankel: Vec<f64>,
    /// Twice the sum of the dropped Hankel singular values: the H-infinity norm of the error is at most this (Enns 1984; Glover 1984).
    pub error_bound: f64,
}

/// Square-root balanced truncation to `order` states (Tombs & Postlethwaite 1987).
///
/// Errors: unstable, an order above that of the minimal realisation.
pub fn balanced_truncation(sys: &StateSpace, order: usize) -> Result<BalancedTruncation, LtiError> {
    let lp = square_root(&controllability_gramian(sys)?)?;
    let lq = square_root(&observability_gramian(sys)?)?;
    let (u, hankel, v) = full_svd(&(lq.transpose() * &lp))?;
    let largest = hankel.first().copied().unwrap_or(0.0);
    let minimal = hankel.iter().filter(|&&s| s > 1e-13 * largest).count();
    if order > minimal {
        return Err(LtiError::Range {
            what: "the order of the reduced model".into(),
            value: order as f64,
            expected: "at most the order of the minimal realisation",
        });
    }
    let scale = Matrix::from_fn(order, order, |i, j| {
        if i == j {
            hankel[i].sqrt().recip()
        } else {
            0.0
        }
    });
    let left = &scale * u.columns(0, order).transpose() * lq.transpose();
    let right = lp * v.columns(0, order) * &scale;
    let system = StateSpace {
        a: &left * &sys.a * &right,
        b: &left * &sys.b,
        c: &sys.c * &right,
        d: sys.d.clone(),
        sampling_time: sys.sampling_time,
    };
    let error_bound = 2.0 * hankel[order..].iter().sum::<f64>();
    Ok(BalancedTruncation {
        system,
        hankel,
        error_bound,
    })
}

/// The part of a continuous system whose poles have a modulus below `limit` in rad/s, and the rest: `sys = slow + fast`, D with the slow part.
///
/// The two invariant subspaces come from the matrix sign function of `(A - limit I)^-1 (A + limit I)`, so rigid-body modes with double
/// poles at 0 are no difficulty. Modal truncation keeps the slow part alone. Error: a pole on the circle.
pub fn modal_split(sys: &StateSpace, limit: f64) -> Result<(StateSpace, StateSpace), LtiError> {
    sys.require_continuous("modal truncation")?;
    positive("the frequency limit", limit)?;
    let n = sys.order();
    let poles = sys.poles()?;
    let count = poles.iter().filter(|p| p.norm() < limit).count();
    if poles
        .iter()
        .any(|p| (p.norm() - limit).abs() < 1e-6 * limit)
    {
        return Err(LtiError::Range {
            what: "the frequency limit".into(),
            value: limit,
            expected: "different from the modulus of every pole",
        });
    }
    let one = identity(n);
    let moved = solve(
        "A - limit I",
        &(&sys.a - &one * limit),
        &(&sys.a + &one * limit),
    )?;
    let sign = crate::riccati::sign_function(&moved).ok_or(LtiError::NotConverged {
        what: "the matrix sign function",
        iterations: 100,
    })?;
    // Poles inside of the circle go to the left half plane: the projector onto their subspace is (I - sign) / 2.
    let slow_basis = full_svd(&(&one - &sign))?.0.columns(0, count).into_owned();
    let fast_basis = full_svd(&(&one + &sign))?
        .0
        .columns(0, n - count)
        .into_owned();
    let t = blocks(&[&[&slow_basis, &fast_basis]]);
    let ab = solve("the modal basis", &t, &blocks(&[&[&(&sys.a * &t), &sys.b]]))?;
    let c = &sys.c * &t;
    let part = |from: usize, size: usize, d: Matrix| StateSpace {
        a: ab.view((from, from), (size, size)).into_owned(),
        b: ab.view((from, n), (size, sys.inputs())).into_owned(),
        c: c.columns(from, size).into_owned(),
        d,
        sampling_time: None,
    };
    Ok((
        part(0, count, sys.d.clone()),
        part(count, n - count, Matrix::zeros(sys.outputs(), sys.inputs())),
    ))
}
