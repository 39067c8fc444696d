//! Connections of systems, sampling and reduction.

use fuyu_lti::{
    Complex, LtiError, Matrix, StateSpace, TransferFunction, balanced_truncation,
    controllability_gramian, hankel_singular_values, modal_split, observability_gramian,
};

use crate::support::*;

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
            let error = g
                .parallel(&r.system.negated())
                .unwrap()
                .hinf_norm()
                .unwrap()
                .norm;
            assert!(
                error <= r.error_bound * (1.0 + 1e-6) + 1e-9 * sigma[0],
                "case {i}, order {order}: {error} > {}",
                r.error_bound
            );
            // At least the first dropped value (Glover): a bound that is too generous would show here.
            assert!(
                error >= sigma[order] * (1.0 - 1e-6),
                "case {i}, order {order}"
            );
            let (p, q) = (
                controllability_gramian(&r.system).unwrap(),
                observability_gramian(&r.system).unwrap(),
            );
            for k in 0..order {
                assert_close("balanced", p[(k, k)] / sigma[k], 1.0, 1e-4);
                assert_close("balanced", q[(k, k)] / sigma[k], 1.0, 1e-4);
            }
        }
    }
    // b c / (2 a) for one state.
    let g = TransferFunction::new(&[6.0], &[1.0, 3.0])
        .unwrap()
        .to_state_space()
        .unwrap();
    assert_close("Hankel", hankel_singular_values(&g).unwrap()[0], 1.0, 1e-14);
    assert!(balanced_truncation(&g, 2).is_err());
    // A gain has no states.
    let gain = StateSpace::gain(one(2.0));
    assert!(hankel_singular_values(&gain).unwrap().is_empty());
    assert_eq!(balanced_truncation(&gain, 0).unwrap().system, gain);
}

#[test]
fn modal_truncation_splits_a_free_structure() {
    // Two rigid modes with double poles at the origin, two slow and two fast vibration modes.
    let shapes =
        Matrix::from_row_slice(5, 2, &[0.3, 0.1, -0.2, 0.4, 0.5, -0.6, 0.7, 0.2, -0.1, 0.9]);
    let s = fuyu_lti::Structure::modal(
        &[0.0, 0.0, 1.0, 10.0, 12.0],
        &[0.0, 0.0, 0.01, 0.01, 0.02],
        &shapes,
    )
    .unwrap()
    .displacement_system()
    .unwrap();
    let (slow, fast) = modal_split(&s, 4.0).unwrap();
    assert_eq!((slow.order(), fast.order()), (6, 4));
    assert!(fast.is_stable().unwrap() && slow.poles().unwrap().iter().all(|p| p.norm() < 4.0));
    for w in [0.3, 1.0, 5.0, 10.0, 50.0] {
        let difference =
            slow.parallel(&fast).unwrap().response(w).unwrap() - s.response(w).unwrap();
        assert!(difference.camax() < 1e-9 * s.response(w).unwrap().camax());
    }
    assert!(matches!(modal_split(&s, 10.0), Err(LtiError::Range { .. })));
}

#[test]
fn zero_order_hold_with_delay_against_small_steps() {
    let mut random = Random::new(7);
    for delay in [0.0, 0.03, 0.1, 0.17, 0.2, 0.35] {
        let g = StateSpace {
            d: one(0.0),
            ..random_stable(&mut random, 4, 1, 1)
        };
        let (h, fine) = (0.1, 100);
        let input: Vec<f64> = (0..40).map(|_| random.signed()).collect();
        let late = g.zero_order_hold_delayed(h, delay).unwrap();
        let got = late
            .simulate(40, |k| nalgebra::DVector::from_element(1, input[k]))
            .unwrap();
        let small = g.zero_order_hold(h / fine as f64).unwrap();
        let shift = (delay / h * fine as f64).round() as usize;
        let want = small
            .simulate(40 * fine, |k| {
                nalgebra::DVector::from_element(
                    1,
                    if k < shift {
                        0.0
                    } else {
                        input[(k - shift) / fine]
                    },
                )
            })
            .unwrap();
        for k in 0..40 {
            assert_close("output", got[k][0], want[k * fine][0], 1e-11);
        }
    }
    let g = TransferFunction::new(&[1.0], &[1.0, -1.0])
        .unwrap()
        .to_state_space()
        .unwrap();
    assert!(matches!(
        g.zero_order_hold(1e6),
        Err(LtiError::Range { .. })
    ));
    assert!(
        g.zero_order_hold(0.0).is_err()
            && g.zero_order_hold(f64::NAN).is_err()
            && g.zero_order_hold_delayed(0.1, -1.0).is_err()
    );
    assert!(matches!(
        g.zero_order_hold(0.1).unwrap().zero_order_hold(0.1),
        Err(LtiError::TimeDomain { .. })
    ));
}

#[test]
fn interconnections_agree_with_arithmetic_of_responses() {
    let mut random = Random::new(8);
    let (g, k) = (
        random_stable(&mut random, 4, 2, 3),
        random_stable(&mut random, 3, 3, 2),
    );
    let s = Complex::new(0.3, 1.7);
    let (gs, ks) = (g.at(s).unwrap(), k.at(s).unwrap());
    let unit = nalgebra::DMatrix::<Complex>::identity(3, 3);
    assert!((g.series(&k).unwrap().at(s).unwrap() - &ks * &gs).camax() < 1e-12);
    assert!(
        (g.parallel(&g).unwrap().at(s).unwrap() - &gs * Complex::new(2.0, 0.0)).camax() < 1e-12
    );
    let closed = (unit + &gs * &ks).try_inverse().unwrap() * &gs;
    assert!((g.feedback(&k).unwrap().at(s).unwrap() - closed).camax() < 1e-11);
    assert!((g.dual().at(s).unwrap() - gs.transpose()).camax() < 1e-12);
    // Lower linear fractional transformation: P11 + P12 K (I - P22 K)^-1 P21.
    let p = random_stable(&mut random, 4, 5, 6);
    let ps = p.at(s).unwrap();
    let part = |i: usize, j: usize, r: usize, c: usize| ps.view((i, j), (r, c)).into_owned();
    let want = part(0, 0, 3, 3)
        + part(0, 3, 3, 2)
            * &ks
            * (nalgebra::DMatrix::<Complex>::identity(3, 3) - part(3, 3, 3, 2) * &ks)
                .try_inverse()
                .unwrap()
            * part(3, 0, 3, 3);
    assert!((p.lower_lft(&k, 3, 2).unwrap().at(s).unwrap() - want).camax() < 1e-11);
    // An algebraic loop without solution, and systems of different kinds.
    let algebraic = StateSpace::gain(one(1.0)).feedback(&StateSpace::gain(one(-1.0)));
    assert!(matches!(algebraic, Err(LtiError::Singular { .. })));
    assert!(matches!(
        g.zero_order_hold(0.1).unwrap().parallel(&g),
        Err(LtiError::TimeDomain { .. })
    ));
    assert!(g.parallel(&k).is_err() && g.select(&[3], &[0]).is_err());
}
