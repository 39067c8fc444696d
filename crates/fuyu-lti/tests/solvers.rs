//! The solvers against closed forms, second formulations and each other; and what they refuse.

mod support;

use fuyu_lti::{
    Complex, LtiError, Matrix, StateSpace, TransferFunction, balanced_truncation, care, care_with_cross_weight, controllability_gramian, dare, dare_with_cross_weight,
    discrete_lyapunov, eigenvalues, hankel_singular_values, hinf_controller, hinf_optimal, is_controllable, is_observable, lqg, lqr, lyapunov, margins, modal_split, observability_gramian,
    observer_based, spectral_abscissa, spectral_radius, steady_kalman,
};
use support::*;

fn one(v: f64) -> Matrix {
    Matrix::from_element(1, 1, v)
}

fn eye(n: usize) -> Matrix {
    Matrix::identity(n, n)
}

fn random_stable(random: &mut Random, n: usize, m: usize, p: usize) -> StateSpace {
    let a = random.matrix(n, n) * 2.0;
    let a = &a - eye(n) * (spectral_abscissa(&a).unwrap() + random.log_uniform(0.02, 1.0));
    StateSpace::new(a, random.matrix(n, m), random.matrix(p, n), random.matrix(p, m) * 0.1).unwrap()
}

/// A X + X A' + Q = 0 as n^2 linear equations: the second formulation.
fn kronecker_lyapunov(a: &Matrix, q: &Matrix, discrete: bool) -> Matrix {
    let n = a.nrows();
    let system = if discrete { a.kronecker(a) - eye(n * n) } else { eye(n).kronecker(a) + a.kronecker(&eye(n)) };
    let x = system.lu().solve(&-Matrix::from_column_slice(n * n, 1, q.as_slice())).unwrap();
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
            assert!(relative(&s.x, &kronecker_lyapunov(&a, &q, false)) < 1e-8, "case {i}");
        }
        let a = &a * (random.log_uniform(0.2, 2.0) / spectral_radius(&a).unwrap());
        let s = discrete_lyapunov(&a, &q).unwrap();
        worst = worst.max(s.residual);
        if n <= 5 {
            assert!(relative(&s.x, &kronecker_lyapunov(&a, &q, true)) < 1e-8, "case {i}");
        }
    }
    println!("Lyapunov: largest residual {worst:.1e}");
    assert!(worst < 1e-12);
    // Eigenvalues +1 and -1, or of modulus 1.
    let mirror = Matrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, -1.0]);
    assert!(matches!(lyapunov(&mirror, &eye(2)), Err(LtiError::MirrorEigenvalues { .. })));
    assert!(matches!(discrete_lyapunov(&eye(2), &eye(2)), Err(LtiError::MirrorEigenvalues { .. })));
    assert!(matches!(lyapunov(&eye(2), &Matrix::from_row_slice(2, 2, &[1.0, 2.0, 0.0, 1.0])), Err(LtiError::NotSymmetric { .. })));
}

// A lost Newton step leaves residuals of 1e-10 and more.
#[test]
fn riccati_equations() {
    let mut random = Random::new(2);
    let mut worst: (f64, f64) = (0.0, 0.0);
    for i in 0..200 {
        let (n, m) = (1 + i % 12, 1 + i % 3);
        let a = random.matrix(n, n) * random.log_uniform(0.1, 10.0);
        let b = random.matrix(n, m);
        let c = random.matrix(1 + i % n.min(3), n);
        let (q, r) = (c.transpose() * &c, random.definite(m, 0.1) * random.log_uniform(1e-4, 1e2));
        let s = care(&a, &b, &q, &r).unwrap();
        worst.0 = worst.0.max(s.residual);
        assert!(s.closed_loop_poles.iter().all(|p| p.re < 0.0), "case {i}");
        // Another path to the closed-loop poles: the stable eigenvalues of the Hamiltonian.
        let g = &b * r.clone().try_inverse().unwrap() * b.transpose();
        let mut h = Matrix::zeros(2 * n, 2 * n);
        h.view_mut((0, 0), (n, n)).copy_from(&a);
        h.view_mut((0, n), (n, n)).copy_from(&-g);
        h.view_mut((n, 0), (n, n)).copy_from(&-&q);
        h.view_mut((n, n), (n, n)).copy_from(&-a.transpose());
        let stable: Vec<_> = eigenvalues(&h).unwrap().into_iter().filter(|l| l.re < 0.0).collect();
        let size = stable.iter().map(|p| p.norm()).fold(0.0, f64::max);
        assert_eq!(stable.len(), n);
        assert!(matched(&s.closed_loop_poles, &stable) < 1e-6 * size, "case {i}: {:?} {stable:?} {:e}", s.closed_loop_poles, s.residual);
        // Optimal cost of the closed loop: x'Xx is the integral of x'(Q + K'RK)x, a Lyapunov equation.
        let closed = &a - &b * &s.gain;
        let cost = lyapunov(&closed.transpose(), &(&q + s.gain.transpose() * &r * &s.gain)).unwrap();
        assert!(relative(&cost.x, &s.x) < 1e-7, "case {i}: {:e}", relative(&cost.x, &s.x));

        let a = &a * (random.log_uniform(0.3, 1.5) / spectral_radius(&a).unwrap());
        let d = dare(&a, &b, &q, &r).unwrap();
        worst.1 = worst.1.max(d.residual);
        assert!(d.closed_loop_poles.iter().all(|p| p.norm() < 1.0), "case {i}");
        let closed = &a - &b * &d.gain;
        let cost = discrete_lyapunov(&closed.transpose(), &(&q + d.gain.transpose() * &r * &d.gain)).unwrap();
        assert!(relative(&cost.x, &d.x) < 1e-7, "case {i}: discrete {:e}", relative(&cost.x, &d.x));
    }
    println!("residuals: continuous {:.1e}, discrete {:.1e}", worst.0, worst.1);
    assert!(worst.0 < 1e-12 && worst.1 < 1e-12);
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
    let with = care_with_cross_weight(&a, &b, &eye(2), &one(1.0), &cross).unwrap();
    let shifted = care(&(&a - &b * cross.transpose()), &b, &(eye(2) - &cross * cross.transpose()), &one(1.0)).unwrap();
    assert!(relative(&with.gain, &(shifted.gain + cross.transpose())) < 1e-13);
    let with = dare_with_cross_weight(&a, &b, &eye(2), &one(1.0), &cross).unwrap();
    let shifted = dare(&(&a - &b * cross.transpose()), &b, &(eye(2) - &cross * cross.transpose()), &one(1.0)).unwrap();
    assert!(relative(&with.gain, &(shifted.gain + cross.transpose())) < 1e-13);
    // As the sampling time falls, the discrete regulator tends to the continuous one.
    let plant = StateSpace::new(a, b, eye(2), Matrix::zeros(2, 1)).unwrap();
    let continuous = lqr(&plant, &eye(2), &one(1.0)).unwrap().gain;
    let h = 1e-4;
    let sampled = lqr(&plant.zero_order_hold(h).unwrap(), &(eye(2) * h), &one(h)).unwrap().gain;
    assert!(relative(&sampled, &continuous) < 3e-4);
}

#[test]
fn unsolvable_equations_are_refused_with_the_reason() {
    let a = Matrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, -0.1]);
    let (b1, b2) = (Matrix::from_row_slice(2, 1, &[1.0, 0.0]), Matrix::from_row_slice(2, 1, &[0.0, 1.0]));
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
    assert!(matches!(care(&oscillator, &b2, &Matrix::zeros(2, 2), &one(1.0)), Err(LtiError::NotDetectable { .. })));
    assert!(matches!(care(&oscillator, &Matrix::zeros(2, 1), &eye(2), &one(1.0)), Err(LtiError::NotStabilizable { .. })));
    // A rigid body that no torque reaches, with the double pole at the origin.
    let rigid = Matrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]);
    assert!(matches!(care(&rigid, &Matrix::zeros(2, 1), &eye(2), &one(1.0)), Err(LtiError::NotStabilizable { .. })));
    assert!(matches!(care(&rigid, &b2, &Matrix::from_row_slice(2, 2, &[0.0, 0.0, 0.0, 1.0]), &one(1.0)), Err(LtiError::NotDetectable { .. })));
    // The filter's errors have the filter's names.
    let plant = StateSpace::new(&a * 2.0, b1.clone(), Matrix::from_row_slice(1, 2, &[0.0, 1.0]), one(0.0)).unwrap();
    assert!(matches!(steady_kalman(&plant, &eye(2), &one(1.0)), Err(LtiError::NotDetectable { .. })));
    let e = text(steady_kalman(&plant, &eye(2), &one(-1.0)).unwrap_err());
    assert!(e.starts_with("the intensity V of the measurement noise is not positive definite"), "{e}");
}

// Closed forms for 1/(s^2 + 2 z w s + w^2): peak 1/(2 z sqrt(1 - z^2)) / w^2, H2 norm squared 1/(4 z w^3).
#[test]
fn norms_of_a_resonance() {
    for (w, z) in [(1.0, 0.5), (3.0, 0.005), (200.0, 1e-4), (0.01, 0.3)] {
        let g = TransferFunction::new(&[1.0], &[1.0, 2.0 * z * w, w * w]).unwrap().to_state_space().unwrap();
        let n = g.hinf_norm().unwrap();
        let peak = 1.0 / (2.0 * z * (1.0f64 - z * z).sqrt()) / (w * w);
        assert_close("peak", n.norm / peak, 1.0, 3e-9);
        assert_close("peak of the sweep", n.swept / peak, 1.0, 1e-8);
        assert_close("place", n.frequency / (w * (1.0 - 2.0 * z * z).sqrt()), 1.0, 1e-4);
        assert_close("H2", g.h2_norm().unwrap() / (1.0 / (4.0 * z * w * w * w)).sqrt(), 1.0, 1e-9);
    }
    // High-pass: the norm is reached at infinite frequency. A gain has its singular value.
    let high = TransferFunction::new(&[3.0, 0.0], &[1.0, 1.0]).unwrap().to_state_space().unwrap();
    assert_close("high-pass", high.hinf_norm().unwrap().norm, 3.0, 1e-8);
    assert_close("gain", StateSpace::gain(eye(2) * 2.0).hinf_norm().unwrap().norm, 2.0, 1e-8);
    assert!(matches!(high.h2_norm(), Err(LtiError::Range { .. })));
    let unstable = TransferFunction::new(&[1.0], &[1.0, -1.0]).unwrap().to_state_space().unwrap();
    assert!(matches!(unstable.hinf_norm(), Err(LtiError::Unstable { .. })) && matches!(unstable.h2_norm(), Err(LtiError::Unstable { .. })));
}

#[test]
fn norms_of_random_systems_by_two_methods() {
    let mut random = Random::new(4);
    for i in 0..60 {
        let g = random_stable(&mut random, 1 + i % 8, 1 + i % 3, 1 + i % 2);
        let n = g.hinf_norm().unwrap();
        assert!(n.norm >= n.swept * (1.0 - 1e-12) && n.norm < n.swept * (1.0 + 1e-6), "case {i}: {n:?}");
        let at_peak = if n.frequency.is_finite() { g.singular_values(n.frequency).unwrap()[0] } else { g.singular_values(1e9).unwrap()[0] };
        assert_close("gain at the peak", at_peak / n.norm, 1.0, 1e-6);
        // The bilinear transformation keeps the norm; zero-order hold at a high rate nearly does.
        let sampled = g.tustin(0.01).unwrap();
        assert_close("Tustin", sampled.hinf_norm().unwrap().norm / n.norm, 1.0, 1e-6);
        // H2 by the other Gramian.
        let proper = StateSpace { d: &g.d * 0.0, ..g.clone() };
        let other = (proper.b.transpose() * observability_gramian(&proper).unwrap() * &proper.b).trace().sqrt();
        assert_close("H2", proper.h2_norm().unwrap() / other, 1.0, 1e-8);
    }
}

#[test]
fn zeros_of_known_systems() {
    // Zeros of the numerator, also when poles are far away or a zero is in the right half plane.
    for (zeros, poles) in [(vec![-1.0, 2.0], vec![-3.0, -4.0, -5.0]), (vec![-0.01], vec![-1.0, -100.0, -1000.0]), (vec![-1.0, -2.0, -3.0], vec![-4.0, -5.0, -6.0])] {
        let polynomial = |roots: &[f64]| roots.iter().fold(vec![1.0], |p, r| {
            let mut q = p.clone();
            q.push(0.0);
            p.iter().enumerate().for_each(|(i, c)| q[i + 1] -= r * c);
            q
        });
        let g = TransferFunction::new(&polynomial(&zeros), &polynomial(&poles)).unwrap().to_state_space().unwrap();
        let want: Vec<_> = zeros.iter().map(|&z| Complex::new(z, 0.0)).collect();
        let got = g.zeros().unwrap();
        assert_eq!(got.len(), want.len());
        assert!(matched(&got, &want) < 1e-10, "{got:?}");
    }
    // Several inputs: zeros of the determinant. diag(1/(s+1), (s-2)/(s+3)^2...) coupled by constant matrices.
    let first = TransferFunction::new(&[1.0, 4.0], &[1.0, 3.0, 2.0]).unwrap().to_state_space().unwrap();
    let second = TransferFunction::new(&[1.0, -2.0], &[1.0, 6.0, 9.0]).unwrap().to_state_space().unwrap();
    let mix = Matrix::from_row_slice(2, 2, &[1.0, 2.0, -0.5, 3.0]);
    let g = first.append(&second).unwrap().scaled_inputs(&mix).unwrap().scaled_outputs(&mix.transpose()).unwrap();
    assert!(matched(&g.zeros().unwrap(), &[Complex::new(-4.0, 0.0), Complex::new(2.0, 0.0)]) < 1e-10);
    assert_eq!(g.zeros().unwrap().len(), 2);
    // Not square: two outputs of one input share a zero only if both have it.
    let both = StateSpace::new(first.a.clone(), first.b.clone(), Matrix::from_rows(&[first.c.row(0), first.c.row(0)]), Matrix::zeros(2, 1)).unwrap();
    assert!(matched(&both.zeros().unwrap(), &[Complex::new(-4.0, 0.0)]) < 1e-9);
    let random = StateSpace::new(first.a.clone(), first.b.clone(), eye(2), Matrix::zeros(2, 1)).unwrap();
    assert!(random.zeros().unwrap().is_empty());
    // A mode that the input does not move is an invariant zero. A gain has none.
    let a = Matrix::from_row_slice(2, 2, &[-7.0, 0.0, 0.0, -1.0]);
    let idle = StateSpace::new(a, Matrix::from_row_slice(2, 1, &[0.0, 1.0]), Matrix::from_row_slice(1, 2, &[1.0, 1.0]), one(0.0)).unwrap();
    assert!(matched(&idle.zeros().unwrap(), &[Complex::new(-7.0, 0.0)]) < 1e-12);
    assert!(StateSpace::gain(eye(2)).zeros().unwrap().is_empty());
}

// Zeros are the poles with the outputs held by high gain, and where the response is singular: a check that uses no pencil.
#[test]
fn zeros_of_random_systems_make_the_response_singular() {
    let mut random = Random::new(5);
    let mut count = 0;
    for i in 0..100 {
        let m = 1 + i % 3;
        let mut g = random_stable(&mut random, m + 1 + i % 6, m, m);
        if i % 2 == 0 {
            g.d *= 0.0;
        }
        for z in g.zeros().unwrap() {
            count += 1;
            let Ok(h) = g.at(z) else { continue };
            let s = h.svd(false, false).singular_values;
            let typical = g.response(1.0).unwrap().svd(false, false).singular_values.max();
            assert!(s.min() < 1e-7 * typical.max(s.max()), "case {i}: zero {z}, {s:?}");
        }
    }
    assert!(count > 200, "{count}");
}

#[test]
fn balanced_truncation_keeps_the_hankel_bound() {
    let mut random = Random::new(6);
    for i in 0..40 {
        let g = random_stable(&mut random, 3 + i % 7, 1 + i % 2, 1 + i % 3);
        let sigma = hankel_singular_values(&g).unwrap();
        for order in 1..g.order().min(5) {
            if sigma[order - 1] < 1e-9 * sigma[0] {
                break;
            }
            let r = balanced_truncation(&g, order).unwrap();
            assert!(r.system.is_stable().unwrap());
            let error = g.parallel(&r.system.negated()).unwrap().hinf_norm().unwrap().norm;
            assert!(error <= r.error_bound * (1.0 + 1e-6) + 1e-9 * sigma[0], "case {i}, order {order}: {error} > {}", r.error_bound);
            // At least the first dropped value (Glover): a bound that is too generous would show here.
            assert!(error >= sigma[order] * (1.0 - 1e-6), "case {i}, order {order}");
            let (p, q) = (controllability_gramian(&r.system).unwrap(), observability_gramian(&r.system).unwrap());
            for k in 0..order {
                assert_close("balanced", p[(k, k)] / sigma[k], 1.0, 1e-4);
                assert_close("balanced", q[(k, k)] / sigma[k], 1.0, 1e-4);
            }
        }
    }
    // b c / (2 a) for one state.
    let g = TransferFunction::new(&[6.0], &[1.0, 3.0]).unwrap().to_state_space().unwrap();
    assert_close("Hankel", hankel_singular_values(&g).unwrap()[0], 1.0, 1e-14);
    assert!(balanced_truncation(&g, 2).is_err());
}

#[test]
fn modal_truncation_splits_a_free_structure() {
    // Two rigid modes with double poles at the origin, two slow and two fast vibration modes.
    let shapes = Matrix::from_row_slice(5, 2, &[0.3, 0.1, -0.2, 0.4, 0.5, -0.6, 0.7, 0.2, -0.1, 0.9]);
    let s = fuyu_lti::Structure::modal(&[0.0, 0.0, 1.0, 10.0, 12.0], &[0.0, 0.0, 0.01, 0.01, 0.02], &shapes).unwrap().displacement_system().unwrap();
    let (slow, fast) = modal_split(&s, 4.0).unwrap();
    assert_eq!((slow.order(), fast.order()), (6, 4));
    assert!(fast.is_stable().unwrap() && slow.poles().unwrap().iter().all(|p| p.norm() < 4.0));
    for w in [0.3, 1.0, 5.0, 10.0, 50.0] {
        let difference = slow.parallel(&fast).unwrap().response(w).unwrap() - s.response(w).unwrap();
        assert!(difference.camax() < 1e-9 * s.response(w).unwrap().camax());
    }
    assert!(matches!(modal_split(&s, 10.0), Err(LtiError::Range { .. })));
}

#[test]
fn zero_order_hold_with_delay_against_small_steps() {
    let mut random = Random::new(7);
    for delay in [0.0, 0.03, 0.1, 0.17, 0.2, 0.35] {
        let g = StateSpace { d: one(0.0), ..random_stable(&mut random, 4, 1, 1) };
        let (h, fine) = (0.1, 100);
        let input: Vec<f64> = (0..40).map(|_| random.signed()).collect();
        let late = g.zero_order_hold_delayed(h, delay).unwrap();
        let got = late.simulate(40, |k| nalgebra::DVector::from_element(1, input[k])).unwrap();
        let small = g.zero_order_hold(h / fine as f64).unwrap();
        let shift = (delay / h * fine as f64).round() as usize;
        let want = small.simulate(40 * fine, |k| nalgebra::DVector::from_element(1, if k < shift { 0.0 } else { input[(k - shift) / fine] })).unwrap();
        for k in 0..40 {
            assert_close("output", got[k][0], want[k * fine][0], 1e-11);
        }
    }
    let g = TransferFunction::new(&[1.0], &[1.0, -1.0]).unwrap().to_state_space().unwrap();
    assert!(matches!(g.zero_order_hold(1e6), Err(LtiError::Range { .. })));
    assert!(g.zero_order_hold(0.0).is_err() && g.zero_order_hold(f64::NAN).is_err() && g.zero_order_hold_delayed(0.1, -1.0).is_err());
    assert!(matches!(g.zero_order_hold(0.1).unwrap().zero_order_hold(0.1), Err(LtiError::TimeDomain { .. })));
}

#[test]
fn interconnections_agree_with_arithmetic_of_responses() {
    let mut random = Random::new(8);
    let (g, k) = (random_stable(&mut random, 4, 2, 3), random_stable(&mut random, 3, 3, 2));
    let s = Complex::new(0.3, 1.7);
    let (gs, ks) = (g.at(s).unwrap(), k.at(s).unwrap());
    let one = nalgebra::DMatrix::<Complex>::identity(3, 3);
    assert!((g.series(&k).unwrap().at(s).unwrap() - &ks * &gs).camax() < 1e-12);
    assert!((g.parallel(&g).unwrap().at(s).unwrap() - &gs * Complex::new(2.0, 0.0)).camax() < 1e-12);
    let closed = (one + &gs * &ks).try_inverse().unwrap() * &gs;
    assert!((g.feedback(&k).unwrap().at(s).unwrap() - closed).camax() < 1e-11);
    assert!((g.dual().at(s).unwrap() - gs.transpose()).camax() < 1e-12);
    // Lower linear fractional transformation: P11 + P12 K (I - P22 K)^-1 P21.
    let p = random_stable(&mut random, 4, 5, 6);
    let ps = p.at(s).unwrap();
    let part = |i: usize, j: usize, r: usize, c: usize| ps.view((i, j), (r, c)).into_owned();
    let want = part(0, 0, 3, 3) + part(0, 3, 3, 2) * &ks * (nalgebra::DMatrix::<Complex>::identity(3, 3) - part(3, 3, 3, 2) * &ks).try_inverse().unwrap() * part(3, 0, 3, 3);
    assert!((p.lower_lft(&k, 3, 2).unwrap().at(s).unwrap() - want).camax() < 1e-11);
    // An algebraic loop without solution, and systems of different kinds.
    let algebraic = StateSpace::gain(one_by_one(1.0)).feedback(&StateSpace::gain(one_by_one(-1.0)));
    assert!(matches!(algebraic, Err(LtiError::Singular { .. })));
    assert!(matches!(g.zero_order_hold(0.1).unwrap().parallel(&g), Err(LtiError::TimeDomain { .. })));
    assert!(g.parallel(&k).is_err() && g.select(&[3], &[0]).is_err());
}

fn one_by_one(v: f64) -> Matrix {
    one(v)
}

// Third-order loop k/(s+1)^3: phase crossover at sqrt 3, gain margin 8/k.
#[test]
fn margins_of_a_third_order_lag() {
    let l = TransferFunction::new(&[2.0], &[1.0, 3.0, 3.0, 1.0]).unwrap().to_state_space().unwrap();
    let m = margins(&l).unwrap();
    assert_close("phase crossover", m.gain[0].frequency, 3f64.sqrt(), 1e-10);
    assert_close("gain margin", m.gain[0].decibel, 20.0 * 4f64.log10(), 1e-9);
    let w = (2f64.powf(2.0 / 3.0) - 1.0).sqrt();
    assert_close("gain crossover", m.phase[0].frequency, w, 1e-10);
    assert_close("phase margin", m.phase[0].degrees, 180.0 - 3.0 * w.atan().to_degrees(), 1e-8);
    // At the gain margin the loop is on the stability limit.
    let critical = l.scaled_outputs(&one(10f64.powf(m.smallest_gain().unwrap().decibel / 20.0))).unwrap();
    assert!(critical.feedback(&StateSpace::gain(one(1.0))).unwrap().stability_margin().unwrap().abs() < 1e-8);
    assert_eq!(m.smallest_phase().unwrap(), m.phase[0]);
}

// The compensator's closed loop has the poles of regulator and filter; its H2 norm is the optimal cost.
#[test]
fn lqg_is_optimal() {
    let mut random = Random::new(9);
    let plant = StateSpace { d: Matrix::zeros(1, 1), ..random_stable(&mut random, 4, 1, 1) };
    let unstable = StateSpace { a: &plant.a + eye(4) * 1.5, ..plant };
    let (q, r, v) = (unstable.c.transpose() * &unstable.c, one(0.3), one(0.2));
    let w = &unstable.b * unstable.b.transpose();
    let design = lqg(&unstable, &q, &r, &w, &v).unwrap();
    let cost = |k: &Matrix, l: &Matrix| -> f64 {
        let c = observer_based(&unstable, k, l).unwrap();
        // Inputs [process noise; measurement noise], outputs [y; sqrt(r) u].
        let scale = Matrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, 0.2f64.sqrt()]);
        let weight = Matrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, 0.3f64.sqrt()]);
        fuyu_lti::closed_loop(&unstable, &c).unwrap().scaled_inputs(&scale).unwrap().scaled_outputs(&weight).unwrap().h2_norm().unwrap()
    };
    let best = cost(&design.regulator.gain, &design.filter.gain);
    // tr(X W) + tr(P K'RK), the separation formula.
    let k = &design.regulator.gain;
    let formula = (&design.regulator.x * &w).trace() + (&design.filter.covariance * k.transpose() * &r * k).trace();
    assert_close("cost", best * best / formula, 1.0, 1e-8);
    for _ in 0..20 {
        let k = design.regulator.gain.map(|v| v * (1.0 + 0.05 * random.signed()));
        let l = design.filter.gain.map(|v| v * (1.0 + 0.05 * random.signed()));
        assert!(cost(&k, &l) >= best * (1.0 - 1e-9));
    }
}

// Generalised plants with direct transmissions of all kinds: the norm of the closed loop, by two methods, is below gamma; and for large gamma it tends to the H2-optimal controller's.
#[test]
fn hinf_controllers_of_random_plants() {
    let mut random = Random::new(10);
    for i in 0..30 {
        let (n, p2, m2) = (2 + i % 4, 1 + i % 2, 1 + (i / 2) % 2);
        let (p1, m1) = (m2 + 1, p2 + 1);
        let mut d = random.matrix(p1 + p2, m1 + m2);
        d.view_mut((0, 0), (p1, m1)).scale_mut(if i % 3 == 0 { 0.0 } else { 0.3 });
        d.view_mut((p1, m1), (p2, m2)).scale_mut(if i % 4 == 0 { 0.0 } else { 0.3 });
        let plant = StateSpace::new(random.matrix(n, n), random.matrix(n, m1 + m2), random.matrix(p1 + p2, n), d).unwrap();
        let best = hinf_optimal(&plant, p2, m2, 1e-3).unwrap_or_else(|e| panic!("case {i}: {e}"));
        assert!(best.norm.norm <= best.gamma * (1.0 + 1e-6) && best.norm.swept <= best.norm.norm, "case {i}");
        assert!(best.coupling < 1.0 && best.residual < 1e-9, "case {i}: {}", best.residual);
        // The optimum is tight: the central controller's norm is near the smallest gamma.
        assert!(best.norm.norm > 0.9 * best.gamma, "case {i}: {} {}", best.norm.norm, best.gamma);
        let e = hinf_controller(&plant, p2, m2, 0.98 * best.gamma).unwrap_err();
        assert!(matches!(e, LtiError::NoController { .. } | LtiError::Inaccurate { .. }), "case {i}: {e}");
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
    let blind = StateSpace::new(a.clone(), b.clone(), c.clone(), Matrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0])).unwrap();
    let e = hinf_controller(&blind, 1, 1, 10.0).unwrap_err().to_string();
    assert!(e.contains("every measurement needs noise"), "{e}");
    let out_of_reach = StateSpace::new(a, Matrix::from_row_slice(1, 2, &[1.0, 0.0]), c, Matrix::from_row_slice(2, 2, &[0.0, 1.0, 1.0, 0.0])).unwrap();
    assert!(matches!(hinf_controller(&out_of_reach, 1, 1, 10.0), Err(LtiError::NotStabilizable { .. })));
    assert!(matches!(hinf_optimal(&out_of_reach, 1, 1, 1e-3), Err(LtiError::NotStabilizable { .. })));
    assert!(hinf_controller(&zero, 2, 1, 10.0).is_err() && hinf_controller(&zero, 1, 1, f64::NAN).is_err());
}

#[test]
fn controllability_and_observability() {
    let a = Matrix::from_row_slice(3, 3, &[-1.0, 0.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0, -2.0]);
    let b = Matrix::from_row_slice(3, 1, &[1.0, 1.0, 1.0]);
    // One input cannot move two equal modes apart; two inputs can.
    assert!(!is_controllable(&a, &b).unwrap());
    assert!(is_controllable(&a, &Matrix::from_row_slice(3, 2, &[1.0, 0.0, 1.0, 0.0, 0.0, 1.0])).unwrap());
    assert!(!is_observable(&a, &b.transpose()).unwrap());
    // Badly scaled: a spacecraft of 1e7 kg m2.
    let rigid = Matrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]);
    assert!(is_controllable(&rigid, &Matrix::from_row_slice(2, 1, &[0.0, 1e-7])).unwrap());
    assert!(!is_controllable(&rigid, &Matrix::zeros(2, 1)).unwrap());
}

// Matrices on which unbounded iterations are known to stand still, and extremes: an answer or an error, within the iteration limits.
#[test]
fn every_routine_ends_on_difficult_matrices() {
    let n = 6;
    let cyclic = Matrix::from_fn(n, n, |i, j| f64::from((i + 1) % n == j));
    let jordan = Matrix::from_fn(n, n, |i, j| f64::from(i + 1 == j));
    let mut random = Random::new(11);
    let graded = Matrix::from_fn(n, n, |i, j| 10f64.powi(5 * (i as i32 - j as i32)) * random.signed());
    let companion = Matrix::from_fn(n, n, |i, j| if i == 0 { -1e10f64.powi(j as i32 % 2) } else { f64::from(i == j + 1) });
    for a in [cyclic, jordan, graded, companion, Matrix::zeros(n, n), eye(n) * 1e150, eye(n) * 1e-150, Matrix::from_element(n, n, 1e300)] {
        let b = Matrix::from_fn(n, 1, |i, _| 1.0 + i as f64);
        let g = StateSpace::new(a.clone(), b.clone(), b.transpose(), one(0.0)).unwrap();
        if let Ok(values) = eigenvalues(&a) {
            assert_eq!(values.len(), n);
        }
        let finite = |m: &Matrix| m.iter().all(|v| v.is_finite());
        for s in [care(&a, &b, &eye(n), &one(1.0)), dare(&a, &b, &eye(n), &one(1.0))].into_iter().flatten() {
            assert!(finite(&s.x) && finite(&s.gain));
        }
        for s in [lyapunov(&a, &eye(n)), discrete_lyapunov(&a, &eye(n))].into_iter().flatten() {
            assert!(finite(&s.x));
        }
        let _ = g.zeros();
        let _ = g.hinf_norm();
        let _ = g.h2_norm();
        let _ = margins(&g);
        let _ = g.zero_order_hold(0.1);
        let _ = modal_split(&g, 0.5);
        let _ = hinf_optimal(&StateSpace::new(a.clone(), Matrix::from_columns(&[b.column(0), b.column(0)]), Matrix::from_rows(&[b.transpose().row(0), b.transpose().row(0)]), Matrix::from_row_slice(2, 2, &[0.0, 1.0, 1.0, 0.0])).unwrap(), 1, 1, 1e-2);
    }
}
