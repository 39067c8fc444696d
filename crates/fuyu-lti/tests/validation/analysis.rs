//! Norms, zeros and margins against closed forms, and each by two methods.

use fuyu_lti::{
    Complex, LtiError, Matrix, StateSpace, TransferFunction, margins, observability_gramian,
};

use crate::support::*;

// Closed forms for 1/(s^2 + 2 z w s + w^2): peak 1/(2 z sqrt(1 - z^2)) / w^2, H2 norm squared 1/(4 z w^3).
#[test]
fn norms_of_a_resonance() {
    for (w, z) in [(1.0, 0.5), (3.0, 0.005), (200.0, 1e-4), (0.01, 0.3)] {
        let g = TransferFunction::new(&[1.0], &[1.0, 2.0 * z * w, w * w])
            .unwrap()
            .to_state_space()
            .unwrap();
        let n = g.hinf_norm().unwrap();
        let peak = 1.0 / (2.0 * z * (1.0f64 - z * z).sqrt()) / (w * w);
        assert_close("peak", n.norm / peak, 1.0, 3e-9);
        assert_close("peak of the sweep", n.swept / peak, 1.0, 1e-8);
        assert_close(
            "place",
            n.frequency / (w * (1.0 - 2.0 * z * z).sqrt()),
            1.0,
            1e-4,
        );
        assert_close(
            "H2",
            g.h2_norm().unwrap() / (1.0 / (4.0 * z * w * w * w)).sqrt(),
            1.0,
            1e-9,
        );
    }
    // High-pass: the norm is reached at infinite frequency. A gain has its singular value.
    let high = TransferFunction::new(&[3.0, 0.0], &[1.0, 1.0])
        .unwrap()
        .to_state_space()
        .unwrap();
    assert_close("high-pass", high.hinf_norm().unwrap().norm, 3.0, 1e-8);
    assert_close(
        "gain",
        StateSpace::gain(eye(2) * 2.0).hinf_norm().unwrap().norm,
        2.0,
        1e-8,
    );
    assert!(matches!(high.h2_norm(), Err(LtiError::Range { .. })));
    let unstable = TransferFunction::new(&[1.0], &[1.0, -1.0])
        .unwrap()
        .to_state_space()
        .unwrap();
    assert!(
        matches!(unstable.hinf_norm(), Err(LtiError::Unstable { .. }))
            && matches!(unstable.h2_norm(), Err(LtiError::Unstable { .. }))
    );
}

#[test]
fn norms_of_random_systems_by_two_methods() {
    let mut random = Random::new(4);
    for i in 0..60 {
        let g = random_stable(&mut random, 1 + i % 8, 1 + i % 3, 1 + i % 2);
        let n = g.hinf_norm().unwrap();
        assert!(
            n.norm >= n.swept * (1.0 - 1e-12) && n.norm < n.swept * (1.0 + 1e-6),
            "case {i}: {n:?}"
        );
        let at_peak = if n.frequency.is_finite() {
            g.singular_values(n.frequency).unwrap()[0]
        } else {
            g.singular_values(1e9).unwrap()[0]
        };
        assert_close("gain at the peak", at_peak / n.norm, 1.0, 1e-6);
        // The bilinear transformation keeps the norm; zero-order hold at a high rate nearly does.
        let sampled = g.tustin(0.01).unwrap();
        assert_close(
            "Tustin",
            sampled.hinf_norm().unwrap().norm / n.norm,
            1.0,
            1e-6,
        );
        // H2 by the other Gramian.
        let proper = StateSpace {
            d: &g.d * 0.0,
            ..g.clone()
        };
        let other = (proper.b.transpose() * observability_gramian(&proper).unwrap() * &proper.b)
            .trace()
            .sqrt();
        assert_close("H2", proper.h2_norm().unwrap() / other, 1.0, 1e-8);
    }
}

#[test]
fn zeros_of_known_systems() {
    // Zeros of the numerator, also when poles are far away or a zero is in the right half plane.
    for (zeros, poles) in [
        (vec![-1.0, 2.0], vec![-3.0, -4.0, -5.0]),
        (vec![-0.01], vec![-1.0, -100.0, -1000.0]),
        (vec![-1.0, -2.0, -3.0], vec![-4.0, -5.0, -6.0]),
    ] {
        let polynomial = |roots: &[f64]| {
            roots.iter().fold(vec![1.0], |p, r| {
                let mut q = p.clone();
                q.push(0.0);
                p.iter().enumerate().for_each(|(i, c)| q[i + 1] -= r * c);
                q
            })
        };
        let g = TransferFunction::new(&polynomial(&zeros), &polynomial(&poles))
            .unwrap()
            .to_state_space()
            .unwrap();
        let want: Vec<_> = zeros.iter().map(|&z| Complex::new(z, 0.0)).collect();
        let got = g.zeros().unwrap();
        assert_eq!(got.len(), want.len());
        assert!(matched(&got, &want) < 1e-10, "{got:?}");
    }
    // Several inputs: zeros of the determinant. diag(1/(s+1), (s-2)/(s+3)^2...) coupled by constant matrices.
    let first = TransferFunction::new(&[1.0, 4.0], &[1.0, 3.0, 2.0])
        .unwrap()
        .to_state_space()
        .unwrap();
    let second = TransferFunction::new(&[1.0, -2.0], &[1.0, 6.0, 9.0])
        .unwrap()
        .to_state_space()
        .unwrap();
    let mix = Matrix::from_row_slice(2, 2, &[1.0, 2.0, -0.5, 3.0]);
    let g = first
        .append(&second)
        .unwrap()
        .scaled_inputs(&mix)
        .unwrap()
        .scaled_outputs(&mix.transpose())
        .unwrap();
    assert!(
        matched(
            &g.zeros().unwrap(),
            &[Complex::new(-4.0, 0.0), Complex::new(2.0, 0.0)]
        ) < 1e-10
    );
    assert_eq!(g.zeros().unwrap().len(), 2);
    // Not square: two outputs of one input share a zero only if both have it.
    let both = StateSpace::new(
        first.a.clone(),
        first.b.clone(),
        Matrix::from_rows(&[first.c.row(0), first.c.row(0)]),
        Matrix::zeros(2, 1),
    )
    .unwrap();
    assert!(matched(&both.zeros().unwrap(), &[Complex::new(-4.0, 0.0)]) < 1e-9);
    let random = StateSpace::new(
        first.a.clone(),
        first.b.clone(),
        eye(2),
        Matrix::zeros(2, 1),
    )
    .unwrap();
    assert!(random.zeros().unwrap().is_empty());
    // A mode that the input does not move is an invariant zero. A gain has none.
    let a = Matrix::from_row_slice(2, 2, &[-7.0, 0.0, 0.0, -1.0]);
    let idle = StateSpace::new(
        a,
        Matrix::from_row_slice(2, 1, &[0.0, 1.0]),
        Matrix::from_row_slice(1, 2, &[1.0, 1.0]),
        one(0.0),
    )
    .unwrap();
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
            let typical = g
                .response(1.0)
                .unwrap()
                .svd(false, false)
                .singular_values
                .max();
            assert!(
                s.min() < 1e-7 * typical.max(s.max()),
                "case {i}: zero {z}, {s:?}"
            );
        }
    }
    assert!(count > 200, "{count}");
}

// Third-order loop k/(s+1)^3: phase crossover at sqrt 3, gain margin 8/k.
#[test]
fn margins_of_a_third_order_lag() {
    let l = TransferFunction::new(&[2.0], &[1.0, 3.0, 3.0, 1.0])
        .unwrap()
        .to_state_space()
        .unwrap();
    let m = margins(&l).unwrap();
    assert_close("phase crossover", m.gain[0].frequency, 3f64.sqrt(), 1e-10);
    assert_close("gain margin", m.gain[0].decibel, 20.0 * 4f64.log10(), 1e-9);
    let w = (2f64.powf(2.0 / 3.0) - 1.0).sqrt();
    assert_close("gain crossover", m.phase[0].frequency, w, 1e-10);
    assert_close(
        "phase margin",
        m.phase[0].degrees,
        180.0 - 3.0 * w.atan().to_degrees(),
        1e-8,
    );
    // At the gain margin the loop is on the stability limit.
    let critical = l
        .scaled_outputs(&one(10f64.powf(m.smallest_gain().unwrap().decibel / 20.0)))
        .unwrap();
    assert!(
        critical
            .feedback(&StateSpace::gain(one(1.0)))
            .unwrap()
            .stability_margin()
            .unwrap()
            .abs()
            < 1e-8
    );
    assert_eq!(m.smallest_phase().unwrap(), m.phase[0]);
}
