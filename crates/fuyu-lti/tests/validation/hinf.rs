//! H-infinity controllers of random plants, problems without solution, and matrices on which iterations stand still.

use fuyu_lti::{
    LtiError, Matrix, StateSpace, care, dare, discrete_lyapunov, eigenvalues, hinf_controller,
    hinf_optimal, lyapunov, margins, modal_split,
};

use crate::support::*;

// Generalised plants with direct transmissions of all kinds: the norm of the closed loop, by two methods, is below gamma; and for large gamma it tends to the H2-optimal controller's.
#[test]
fn hinf_controllers_of_random_plants() {
    let mut random = Random::new(10);
    for i in 0..30 {
        let (n, p2, m2) = (2 + i % 4, 1 + i % 2, 1 + (i / 2) % 2);
        let (p1, m1) = (m2 + 1, p2 + 1);
        let mut d = random.matrix(p1 + p2, m1 + m2);
        d.view_mut((0, 0), (p1, m1))
            .scale_mut(if i % 3 == 0 { 0.0 } else { 0.3 });
        d.view_mut((p1, m1), (p2, m2))
            .scale_mut(if i % 4 == 0 { 0.0 } else { 0.3 });
        let plant = StateSpace::new(
            random.matrix(n, n),
            random.matrix(n, m1 + m2),
            random.matrix(p1 + p2, n),
            d,
        )
        .unwrap();
        let best = hinf_optimal(&plant, p2, m2, 1e-3).unwrap_or_else(|e| panic!("case {i}: {e}"));
        assert!(
            best.norm.norm <= best.gamma * (1.0 + 1e-6) && best.norm.swept <= best.norm.norm,
            "case {i}"
        );
        assert!(
            best.coupling < 1.0 && best.residual < 1e-9,
            "case {i}: {}",
            best.residual
        );
        // The optimum is tight: the central controller's norm is near the smallest gamma.
        assert!(
            best.norm.norm > 0.9 * best.gamma,
            "case {i}: {} {}",
            best.norm.norm,
            best.gamma
        );
        let e = hinf_controller(&plant, p2, m2, 0.98 * best.gamma).unwrap_err();
        assert!(
            matches!(
                e,
                LtiError::NoController { .. } | LtiError::Inaccurate { .. }
            ),
            "case {i}: {e}"
        );
    }
}

#[test]
fn hinf_problems_without_solution() {
    // A control without weight, a measurement without noise, an unstable mode out of reach.
    let a = one(1.0);
    let b = Matrix::from_row_slice(1, 2, &[1.0, 1.0]);
    let c = Matrix::from_row_slice(2, 1, &[1.0, 1.0]);
    let zero = StateSpace::new(a.clone(), b.clone(), c.clone(), Matrix::zeros(2, 2)).unwrap();
    let e = hinf_controller(&zero, 1, 1, 10.0).unwrap_err().to_string();
    assert!(e.contains("every control needs a weight"), "{e}");
    let blind = StateSpace::new(
        a.clone(),
        b.clone(),
        c.clone(),
        Matrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]),
    )
    .unwrap();
    let e = hinf_controller(&blind, 1, 1, 10.0).unwrap_err().to_string();
    assert!(e.contains("every measurement needs noise"), "{e}");
    let out_of_reach = StateSpace::new(
        a,
        Matrix::from_row_slice(1, 2, &[1.0, 0.0]),
        c,
        Matrix::from_row_slice(2, 2, &[0.0, 1.0, 1.0, 0.0]),
    )
    .unwrap();
    assert!(matches!(
        hinf_controller(&out_of_reach, 1, 1, 10.0),
        Err(LtiError::NotStabilizable { .. })
    ));
    assert!(matches!(
        hinf_optimal(&out_of_reach, 1, 1, 1e-3),
        Err(LtiError::NotStabilizable { .. })
    ));
    assert!(
        hinf_controller(&zero, 2, 1, 10.0).is_err()
            && hinf_controller(&zero, 1, 1, f64::NAN).is_err()
    );
}

// Matrices on which unbounded iterations are known to stand still, and extremes: an answer or an error, within the iteration limits.
#[test]
fn every_routine_ends_on_difficult_matrices() {
    let n = 6;
    let cyclic = Matrix::from_fn(n, n, |i, j| f64::from((i + 1) % n == j));
    let jordan = Matrix::from_fn(n, n, |i, j| f64::from(i + 1 == j));
    let mut random = Random::new(11);
    let graded = Matrix::from_fn(n, n, |i, j| {
        10f64.powi(5 * (i as i32 - j as i32)) * random.signed()
    });
    let companion = Matrix::from_fn(n, n, |i, j| {
        if i == 0 {
            -1e10f64.powi(j as i32 % 2)
        } else {
            f64::from(i == j + 1)
        }
    });
    for a in [
        cyclic,
        jordan,
        graded,
        companion,
        Matrix::zeros(n, n),
        eye(n) * 1e150,
        eye(n) * 1e-150,
        Matrix::from_element(n, n, 1e300),
    ] {
        let b = Matrix::from_fn(n, 1, |i, _| 1.0 + i as f64);
        let g = StateSpace::new(a.clone(), b.clone(), b.transpose(), one(0.0)).unwrap();
        if let Ok(values) = eigenvalues(&a) {
            assert_eq!(values.len(), n);
        }
        let finite = |m: &Matrix| m.iter().all(|v| v.is_finite());
        for s in [
            care(&a, &b, &eye(n), &one(1.0)),
            dare(&a, &b, &eye(n), &one(1.0)),
        ]
        .into_iter()
        .flatten()
        {
            assert!(finite(&s.x) && finite(&s.gain));
        }
        for s in [lyapunov(&a, &eye(n)), discrete_lyapunov(&a, &eye(n))]
            .into_iter()
            .flatten()
        {
            assert!(finite(&s.x));
        }
        let _ = g.zeros();
        let _ = g.hinf_norm();
        let _ = g.h2_norm();
        let _ = margins(&g);
        let _ = g.zero_order_hold(0.1);
        let _ = modal_split(&g, 0.5);
        let _ = hinf_optimal(
            &StateSpace::new(
                a.clone(),
                Matrix::from_columns(&[b.column(0), b.column(0)]),
                Matrix::from_rows(&[b.transpose().row(0), b.transpose().row(0)]),
                Matrix::from_row_slice(2, 2, &[0.0, 1.0, 1.0, 0.0]),
            )
            .unwrap(),
            1,
            1,
            1e-2,
        );
    }
}
