//! Lyapunov and Riccati equations, regulators and filters against closed forms and second formulations; and what they refuse.

use fuyu_lti::{
    LtiError, LyapunovSolution, Matrix, RiccatiSolution, StateSpace, care, care_with_cross_weight,
    dare, dare_with_cross_weight, discrete_lyapunov, eigenvalues, is_controllable, is_observable,
    lqg, lqr, lyapunov, observer_based, spectral_radius, steady_kalman,
};

use crate::support::*;

/// A X + X A' + Q = 0 as n^2 linear equations: the second formulation.
fn kronecker_lyapunov(a: &Matrix, q: &Matrix, discrete: bool) -> Matrix {
    let n = a.nrows();
    let system = if discrete {
        a.kronecker(a) - eye(n * n)
    } else {
        eye(n).kronecker(a) + a.kronecker(&eye(n))
    };
    let x = system
        .lu()
        .solve(&-Matrix::from_column_slice(n * n, 1, q.as_slice()))
        .unwrap();
    Matrix::from_column_slice(n, n, x.as_slice())
}

#[test]
fn lyapunov_equations() {
    let mut random = Random::new(1);
    let mut worst: f64 = 0.0;
    for i in 0..200 {
        let n = 1 + i % 9;
        let a = random.matrix(n, n) * 3.0 - eye(n) * 0.3;
        let q = random.matrix(n, n);
        let q = &q + q.transpose();
        let s = lyapunov(&a, &q).unwrap();
        worst = worst.max(s.residual);
        if n <= 5 {
            assert!(
                relative(&s.x, &kronecker_lyapunov(&a, &q, false)) < 1e-8,
                "case {i}"
            );
        }
        let a = &a * (random.log_uniform(0.2, 2.0) / spectral_radius(&a).unwrap());
        let s = discrete_lyapunov(&a, &q).unwrap();
        worst = worst.max(s.residual);
        if n <= 5 {
            assert!(
                relative(&s.x, &kronecker_lyapunov(&a, &q, true)) < 1e-8,
                "case {i}"
            );
        }
    }
    println!("Lyapunov: largest residual {worst:.1e}");
    assert!(worst < 1e-12);
    // Eigenvalues +1 and -1, or of modulus 1.
    let mirror = Matrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, -1.0]);
    assert!(matches!(
        lyapunov(&mirror, &eye(2)),
        Err(LtiError::MirrorEigenvalues { .. })
    ));
    assert!(matches!(
        discrete_lyapunov(&eye(2), &eye(2)),
        Err(LtiError::MirrorEigenvalues { .. })
    ));
    assert!(matches!(
        lyapunov(
            &eye(2),
            &Matrix::from_row_slice(2, 2, &[1.0, 2.0, 0.0, 1.0])
        ),
        Err(LtiError::NotSymmetric { .. })
    ));
}

/// The optimal cost x'Xx is the integral (or the sum) of x'(Q + K'RK)x over the closed loop, a Lyapunov equation: its solution's relative difference from X.
fn cost_error(
    s: &RiccatiSolution,
    [a, b, q, r]: [&Matrix; 4],
    lyapunov: fn(&Matrix, &Matrix) -> Result<LyapunovSolution, LtiError>,
) -> f64 {
    let closed = a - b * &s.gain;
    let cost = q + s.gain.transpose() * r * &s.gain;
    relative(&lyapunov(&closed.transpose(), &cost).unwrap().x, &s.x)
}

// A lost Newton step leaves residuals of 1e-10 and more.
#[test]
fn riccati_equations() {
    let mut random = Random::new(2);
    let mut worst: (f64, f64) = (0.0, 0.0);
    let (mut inaccurate, mut backward) = (0, 0.0_f64);
    for i in 0..200 {
        let (n, m) = (1 + i % 12, 1 + i % 3);
        // Unstable, but not so much that one input can hardly hold all modes: then no double precision solver has twelve digits.
        let a = (random.matrix(n, n) - eye(n) * (0.4 * (n as f64).sqrt()))
            * random.log_uniform(0.1, 10.0);
        let b = random.matrix(n, m);
        let c = random.matrix(1 + i % n.min(3), n);
        let (q, r) = (
            c.transpose() * &c,
            random.definite(m, 0.1) * random.log_uniform(1e-4, 1e2),
        );
        let s = care(&a, &b, &q, &r).unwrap();
        inaccurate += usize::from(s.residual > 1e-12);
        worst.0 = worst.0.max(s.residual);
        assert!(s.closed_loop_poles.iter().all(|p| p.re < 0.0), "case {i}");
        // Backward error, relative to the products of the norms.
        let (x, size) = (&s.x, s.x.norm());
        let rest = a.transpose() * x + x * &a - x * &b * &s.gain + &q;
        let product = 2.0 * a.norm() * size + size * size * b.norm().powi(2) / r.norm() + q.norm();
        backward = backward.max(rest.norm() / product);
        // Another path to the closed-loop poles: the stable eigenvalues of the Hamiltonian.
        let g = &b * r.clone().try_inverse().unwrap() * b.transpose();
        let mut h = Matrix::zeros(2 * n, 2 * n);
        h.view_mut((0, 0), (n, n)).copy_from(&a);
        h.view_mut((0, n), (n, n)).copy_from(&-g);
        h.view_mut((n, 0), (n, n)).copy_from(&-&q);
        h.view_mut((n, n), (n, n)).copy_from(&-a.transpose());
        let stable: Vec<_> = eigenvalues(&h)
            .unwrap()
            .into_iter()
            .filter(|l| l.re < 0.0)
            .collect();
        let size = stable.iter().map(|p| p.norm()).fold(0.0, f64::max);
        assert_eq!(stable.len(), n);
        assert!(
            matched(&s.closed_loop_poles, &stable) < 1e-6 * size,
            "case {i}: {:?} {stable:?} {:e}",
            s.closed_loop_poles,
            s.residual
        );
        // Some of these systems are barely stabilisable, which costs digits in both.
        let e = cost_error(&s, [&a, &b, &q, &r], lyapunov);
        assert!(e < 1e-5, "case {i}: {e:e}");

        let a = &a * (random.log_uniform(0.3, 1.5) / spectral_radius(&a).unwrap());
        let d = dare(&a, &b, &q, &r).unwrap();
        worst.1 = worst.1.max(d.residual);
        assert!(
            d.closed_loop_poles.iter().all(|p| p.norm() < 1.0),
            "case {i}"
        );
        let e = cost_error(&d, [&a, &b, &q, &r], discrete_lyapunov);
        assert!(e < 1e-5, "case {i}: discrete {e:e}");
    }
    println!(
        "residuals: continuous {:.1e}, discrete {:.1e}",
        worst.0, worst.1
    );
    println!("backward error {backward:.1e}, {inaccurate} residuals above 1e-12");
    assert!(backward < 1e-12 && worst.1 < 1e-12);
    // Relative to the terms themselves a few residuals are larger: where X B is far smaller than the norms of X and B, rounding of X shows in X B.
    // SciPy's steps from the same start end there too.
    assert!(inaccurate <= 12 && worst.0 < 1e-9, "{inaccurate}");
}

// Double integrator: X = [sqrt(3) 1; 1 sqrt(3)] for Q = I, R = 1.
#[test]
fn riccati_closed_forms() {
    let a = Matrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]);
    let b = Matrix::from_row_slice(2, 1, &[0.0, 1.0]);
    let s = care(&a, &b, &eye(2), &one(1.0)).unwrap();
    let root = 3f64.sqrt();
    assert!(relative(&s.x, &Matrix::from_row_slice(2, 2, &[root, 1.0, 1.0, root])) < 1e-14);
    // A cross weight is the same as a shift of the input: u = v - R^-1 S' x.
    let cross = Matrix::from_row_slice(2, 1, &[0.1, 0.2]);
    let shifted_a = &a - &b * cross.transpose();
    let shifted_q = eye(2) - &cross * cross.transpose();
    for (with_cross, plain) in [
        (
            care_with_cross_weight(&a, &b, &eye(2), &one(1.0), &cross),
            care(&shifted_a, &b, &shifted_q, &one(1.0)),
        ),
        (
            dare_with_cross_weight(&a, &b, &eye(2), &one(1.0), &cross),
            dare(&shifted_a, &b, &shifted_q, &one(1.0)),
        ),
    ] {
        let want = plain.unwrap().gain + cross.transpose();
        assert!(relative(&with_cross.unwrap().gain, &want) < 1e-13);
    }
    // As the sampling time falls, the discrete regulator tends to the continuous one.
    let plant = StateSpace::new(a, b, eye(2), Matrix::zeros(2, 1)).unwrap();
    let continuous = lqr(&plant, &eye(2), &one(1.0)).unwrap().gain;
    let h = 1e-4;
    let sampled = lqr(&plant.zero_order_hold(h).unwrap(), &(eye(2) * h), &one(h))
        .unwrap()
        .gain;
    assert!(relative(&sampled, &continuous) < 3e-4);
}

#[test]
fn unsolvable_equations_are_refused_with_the_reason() {
    let a = Matrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, -0.1]);
    let (b1, b2) = (
        Matrix::from_row_slice(2, 1, &[1.0, 0.0]),
        Matrix::from_row_slice(2, 1, &[0.0, 1.0]),
    );
    let text = |e: LtiError| e.to_string();
    for solve in [care, dare] {
        assert!(solve(&a, &b1, &eye(2), &one(1.0)).is_ok());
        let unstable = &a * 2.0;
        let e = text(solve(&unstable, &b2, &eye(2), &one(1.0)).unwrap_err());
        assert!(e.contains("not stabilisable") && e.contains('2'), "{e}");
        let seen_stable = Matrix::from_row_slice(2, 2, &[0.0, 0.0, 0.0, 1.0]);
        let e = text(solve(&unstable, &b1, &seen_stable, &one(1.0)).unwrap_err());
        assert!(e.contains("not detectable"), "{e}");
        let e = text(solve(&a, &b1, &eye(2), &one(-1.0)).unwrap_err());
        assert!(e.starts_with("R is not positive definite"), "{e}");
        let e = text(solve(&a, &b1, &eye(2), &one(0.0)).unwrap_err());
        assert!(e.starts_with("R is not positive definite"), "{e}");
        let e = text(solve(&a, &b1, &-eye(2), &one(1.0)).unwrap_err());
        assert!(e.contains("not positive semidefinite"), "{e}");
        let e = text(solve(&a, &eye(3), &eye(2), &one(1.0)).unwrap_err());
        assert_eq!(e, "B is 3 x 3; it must be 2 x 3");
        let e = text(solve(&(&a * f64::NAN), &b1, &eye(2), &one(1.0)).unwrap_err());
        assert!(e.contains("NaN") && e.contains("row 0"), "{e}");
    }
    // An undamped oscillator that is not weighted: its modes stay on the stability limit.
    let oscillator = Matrix::from_row_slice(2, 2, &[0.0, 1.0, -4.0, 0.0]);
    assert!(matches!(
        care(&oscillator, &b2, &Matrix::zeros(2, 2), &one(1.0)),
        Err(LtiError::NotDetectable { .. })
    ));
    assert!(matches!(
        care(&oscillator, &Matrix::zeros(2, 1), &eye(2), &one(1.0)),
        Err(LtiError::NotStabilizable { .. })
    ));
    // A rigid body that no torque reaches, with the double pole at the origin.
    let rigid = Matrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]);
    assert!(matches!(
        care(&rigid, &Matrix::zeros(2, 1), &eye(2), &one(1.0)),
        Err(LtiError::NotStabilizable { .. })
    ));
    assert!(matches!(
        care(
            &rigid,
            &b2,
            &Matrix::from_row_slice(2, 2, &[0.0, 0.0, 0.0, 1.0]),
            &one(1.0)
        ),
        Err(LtiError::NotDetectable { .. })
    ));
    // The filter's errors have the filter's names.
    let plant = StateSpace::new(
        &a * 2.0,
        b1.clone(),
        Matrix::from_row_slice(1, 2, &[0.0, 1.0]),
        one(0.0),
    )
    .unwrap();
    assert!(matches!(
        steady_kalman(&plant, &eye(2), &one(1.0)),
        Err(LtiError::NotDetectable { .. })
    ));
    let e = text(steady_kalman(&plant, &eye(2), &one(-1.0)).unwrap_err());
    assert!(
        e.starts_with("the intensity V of the measurement noise is not positive definite"),
        "{e}"
    );
}

// The compensator's closed loop has the poles of regulator and filter; its H2 norm is the optimal cost.
#[test]
fn lqg_is_optimal() {
    let mut random = Random::new(9);
    let plant = StateSpace {
        d: Matrix::zeros(1, 1),
        ..random_stable(&mut random, 4, 1, 1)
    };
    let unstable = StateSpace {
        a: &plant.a + eye(4) * 1.5,
        ..plant
    };
    let (q, r, v) = (unstable.c.transpose() * &unstable.c, one(0.3), one(0.2));
    let w = &unstable.b * unstable.b.transpose();
    let design = lqg(&unstable, &q, &r, &w, &v).unwrap();
    let cost = |k: &Matrix, l: &Matrix| -> f64 {
        let c = observer_based(&unstable, k, l).unwrap();
        // Inputs [process noise; measurement noise], outputs [y; sqrt(r) u].
        let scale = Matrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, 0.2f64.sqrt()]);
        let weight = Matrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, 0.3f64.sqrt()]);
        fuyu_lti::closed_loop(&unstable, &c)
            .unwrap()
            .scaled_inputs(&scale)
            .unwrap()
            .scaled_outputs(&weight)
            .unwrap()
            .h2_norm()
            .unwrap()
    };
    let best = cost(&design.regulator.gain, &design.filter.gain);
    // tr(X W) + tr(P K'RK), the separation formula.
    let k = &design.regulator.gain;
    let formula = (&design.regulator.x * &w).trace()
        + (&design.filter.covariance * k.transpose() * &r * k).trace();
    assert_close("cost", best * best / formula, 1.0, 1e-8);
    for _ in 0..20 {
        let k = design
            .regulator
            .gain
            .map(|v| v * (1.0 + 0.05 * random.signed()));
        let l = design
            .filter
            .gain
            .map(|v| v * (1.0 + 0.05 * random.signed()));
        assert!(cost(&k, &l) >= best * (1.0 - 1e-9));
    }
}

#[test]
fn controllability_and_observability() {
    let a = Matrix::from_row_slice(3, 3, &[-1.0, 0.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0, -2.0]);
    let b = Matrix::from_row_slice(3, 1, &[1.0, 1.0, 1.0]);
    // One input cannot move two equal modes apart; two inputs can.
    assert!(!is_controllable(&a, &b).unwrap());
    assert!(
        is_controllable(
            &a,
            &Matrix::from_row_slice(3, 2, &[1.0, 0.0, 1.0, 0.0, 0.0, 1.0])
        )
        .unwrap()
    );
    assert!(!is_observable(&a, &b.transpose()).unwrap());
    // Badly scaled: a spacecraft of 1e7 kg m2.
    let rigid = Matrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]);
    assert!(is_controllable(&rigid, &Matrix::from_row_slice(2, 1, &[0.0, 1e-7])).unwrap());
    assert!(!is_controllable(&rigid, &Matrix::zeros(2, 1)).unwrap());
}
