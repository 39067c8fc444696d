//! Chapter 3 of Kida 1993: Theorems 3.1 to 3.6 as properties of random systems, the loop-shaping examples, the truss.

use crate::support::*;
use fuyu_lti::kida1993::loop_shaping::{Cost, Shapes, examples, shapes};
use fuyu_lti::kida1993::truss::{self, Weights};
use fuyu_lti::kida1993::{air_table, designs};
use fuyu_lti::{
    Complex, Matrix, ShapedWeights, StateSpace, Structure, TransferFunction, is_controllable,
    is_observable, recovery_observer, shaped_lqr,
};

/// A random structure with one rigid and some lightly damped modes, actuator and sensor collocated.
fn random_structure(random: &mut Random, modes: usize, actuators: usize) -> Structure {
    let mut frequencies: Vec<f64> = (0..modes).map(|_| random.log_uniform(0.3, 30.0)).collect();
    frequencies[0] = 0.0;
    let shapes = random
        .matrix(modes, actuators)
        .map(|v| v + 0.3 * v.signum());
    let damping: Vec<f64> = frequencies
        .iter()
        .map(|_| random.log_uniform(1e-3, 0.05))
        .collect();
    Structure::modal(&frequencies, &damping, &shapes).unwrap()
}

struct Case {
    plant: StateSpace,
    filter: (f64, f64),
    weights: ShapedWeights,
}

fn random_case(random: &mut Random) -> Case {
    let modes = 1 + (4.0 * (0.5 + 0.5 * random.signed())) as usize;
    let plant = random_structure(random, modes, 1)
        .displacement_system()
        .unwrap();
    let filter = (random.log_uniform(0.3, 20.0), random.log_uniform(0.2, 2.0));
    let companion = TransferFunction::second_order_lowpass(filter.0, filter.1)
        .unwrap()
        .to_state_space()
        .unwrap();
    // The realisation of eq. (3.9), so that the gains are k1 and k2 of the thesis.
    let gain = companion.c[(0, 0)];
    let inverse = StateSpace {
        b: &companion.b * gain,
        c: &companion.c / gain,
        ..companion
    };
    let weights = ShapedWeights {
        controlled: plant.c.clone(),
        output_weight: None,
        inverse_input_weight: Some(inverse),
        rho: random.log_uniform(1e-5, 10.0),
    };
    Case {
        plant,
        filter,
        weights,
    }
}

#[test]
fn theorems_3_1_to_3_4_on_random_systems() {
    let mut random = Random::new(3);
    for i in 0..100 {
        let case = random_case(&mut random);
        let r = case.weights.inverse_input_weight.as_ref().unwrap();
        // Theorem 3.1: the extended system keeps controllability and observability.
        let extended = r.series(&case.plant).unwrap();
        assert_eq!(
            is_controllable(&case.plant.a, &case.plant.b).unwrap(),
            is_controllable(&extended.a, &extended.b).unwrap(),
            "case {i}"
        );
        assert_eq!(
            is_observable(&case.plant.a, &case.plant.c).unwrap(),
            is_observable(&extended.a, &extended.c).unwrap(),
            "case {i}"
        );
        let regulator = shaped_lqr(&case.plant, &case.weights).unwrap();
        assert!(regulator.residual < 1e-12);
        // Theorem 3.2: the realised filter is stable.
        let realized = regulator.realized_filter().unwrap();
        assert!(realized.is_stable().unwrap(), "case {i}");
        // Theorem 3.3: higher cut-off, damping ratio nearer to 1/sqrt 2.
        let (w, z) = case.filter;
        let (k1, k2) = (regulator.gain_r[(0, 0)], regulator.gain_r[(0, 1)]);
        assert!(k1 > 0.0 && k2 > 0.0, "case {i}: {k1} {k2}");
        let new_w = w * (1.0 + k1).sqrt();
        let new_z = (2.0 * z * w + w * w * k2) / (2.0 * new_w);
        let limit = std::f64::consts::FRAC_1_SQRT_2;
        assert!(
            if z >= limit {
                new_z <= z + 1e-9 && new_z >= limit - 1e-9
            } else {
                new_z > z - 1e-9 && new_z < limit + 1e-9
            },
            "case {i}: {z} -> {new_z}"
        );
        // The poles of the realised filter are those: its own eigenvalues, not the formula.
        let square: f64 = realized.poles().unwrap().iter().map(|p| p.norm()).product();
        assert!((square.sqrt() / new_w - 1.0).abs() < 1e-8, "case {i}");
        // Theorem 3.4 (a): the loop falls with the third power of the frequency at least (its CB term may vanish).
        let l = regulator.state_loop().unwrap();
        let fastest = l
            .poles()
            .unwrap()
            .iter()
            .map(|p| p.norm())
            .fold(0.0, f64::max);
        let at = |w: f64| l.response(w).unwrap()[(0, 0)].norm();
        let slope = (at(1e3 * fastest) / at(1e4 * fastest)).log10();
        assert!(slope > 2.99, "case {i}: slope {slope}");
        // Theorem 3.4 (b): |1 + l| >= 1 / |1 + k_o (jw - A_o)^-1 b_o|.
        let own = StateSpace::new(
            r.a.clone(),
            r.b.clone(),
            regulator.gain_r.clone(),
            Matrix::zeros(1, 1),
        )
        .unwrap();
        for w in l.frequency_grid(fastest * 1e-4, fastest * 1e2, 15).unwrap() {
            let (Ok(l), Ok(f)) = (l.response(w), own.response(w)) else {
                continue;
            };
            assert!(
                (l[(0, 0)] + 1.0).norm() * (f[(0, 0)] + 1.0).norm() >= 1.0 - 1e-7,
                "case {i} at {w}"
            );
        }
    }
}

// Theorem 3.5: poles of plant and compensator are those of the regulator and those of the observer.
#[test]
fn theorem_3_5_separation_on_random_systems() {
    let mut random = Random::new(35);
    for i in 0..50 {
        let case = random_case(&mut random);
        let regulator = shaped_lqr(&case.plant, &case.weights).unwrap();
        let observer = recovery_observer(&case.plant, random.log_uniform(1e-4, 1.0)).unwrap();
        let closed = case
            .plant
            .feedback(&regulator.compensator(&observer.gain).unwrap())
            .unwrap();
        let states = StateSpace::new(
            case.plant.a.clone(),
            case.plant.b.clone(),
            Matrix::identity(case.plant.order(), case.plant.order()),
            Matrix::zeros(case.plant.order(), 1),
        )
        .unwrap();
        let mut separate = states
            .feedback(&regulator.state_feedback)
            .unwrap()
            .poles()
            .unwrap();
        separate.extend(
            fuyu_lti::eigenvalues(&(&case.plant.a - &observer.gain * &case.plant.c)).unwrap(),
        );
        let got = closed.poles().unwrap();
        let size = got.iter().map(|p| p.norm()).fold(0.0, f64::max);
        // Clusters of poles are known to fewer digits.
        assert!(
            matched(&got, &separate) < 1e-5 * size,
            "case {i}: {:e}",
            matched(&got, &separate) / size
        );
        assert!(closed.is_stable().unwrap());
    }
}

/// Largest distance of the output loop from the state loop relative to the state loop, below `limit` in rad/s.
fn distance(plant: &StateSpace, mu: f64, weights: &ShapedWeights, limit: f64) -> f64 {
    let regulator = shaped_lqr(plant, weights).unwrap();
    let compensator = regulator
        .compensator(&recovery_observer(plant, mu).unwrap().gain)
        .unwrap();
    let l = regulator.state_loop().unwrap();
    let output = plant.series(&compensator).unwrap();
    (0..60)
        .map(|i| limit * 10f64.powf(-3.0 * i as f64 / 59.0))
        .map(|w| {
            let (a, b): (Complex, Complex) = (
                l.response(w).unwrap()[(0, 0)],
                output.response(w).unwrap()[(0, 0)],
            );
            (a - b).norm() / (1.0 + a.norm())
        })
        .fold(0.0, f64::max)
}

// Theorem 3.6: the loop tends to the state loop as mu falls, for a minimum-phase plant; with a zero in the right half plane it does not.
#[test]
fn theorem_3_6_loop_transfer_recovery() {
    let config = designs::DESIGNS[3];
    let weights_for = |plant: &StateSpace| ShapedWeights {
        controlled: plant.c.clone(),
        output_weight: None,
        inverse_input_weight: Some(
            TransferFunction::second_order_lowpass(10.0, 0.7)
                .unwrap()
                .to_state_space()
                .unwrap(),
        ),
        rho: config.rho,
    };
    let plant = air_table::plant(2).unwrap();
    let levels: Vec<f64> = [1e-6, 1e-9, 1e-12, 1e-15]
        .iter()
        .map(|&mu| distance(&plant, mu, &weights_for(&plant), 30.0))
        .collect();
    println!("distance from the state loop {levels:?}");
    assert!(levels.windows(2).all(|w| w[1] < 0.5 * w[0]), "{levels:?}");
    assert!(levels[3] < 0.1);
    // The sensor is moved to where the first mode has the opposite sign: not collocated, with a zero in the right half plane.
    let elsewhere = StateSpace {
        c: Matrix::from_row_slice(1, 4, &[0.309, 0.371, 0.0, 0.0]),
        ..plant.clone()
    };
    assert!(elsewhere.zeros().unwrap().iter().any(|z| z.re > 1e-3));
    assert!(
        distance(&elsewhere, 1e-9, &weights_for(&elsewhere), 30.0) > 0.3,
        "{}",
        distance(&elsewhere, 1e-9, &weights_for(&elsewhere), 30.0)
    );
}

fn magnitude(s: &StateSpace, w: f64) -> f64 {
    s.response(w).unwrap()[(0, 0)].norm()
}

fn designed(number: usize) -> Vec<(&'static str, Shapes)> {
    let example = examples().unwrap().remove(number - 1);
    example
        .costs
        .iter()
        .map(|(name, cost)| (*name, shapes(cost).unwrap()))
        .collect()
}

// The figures' claims; the thesis prints no numbers for them. Crossover of the standard design: about 2 rad/s, as the text says.
#[test]
fn loop_shaping_examples_1_to_3() {
    for number in 1..=3 {
        let all = designed(number);
        let [(_, j1), (_, j2), (_, standard)] = &all[..] else {
            panic!()
        };
        for (name, s) in &all {
            assert!(s.residual < 1e-12, "{name}");
            // s + t = 1 and t = l s.
            for w in [0.01, 1.0, 100.0] {
                let (a, t) = (
                    s.sensitivity.response(w).unwrap()[(0, 0)],
                    s.complementary.response(w).unwrap()[(0, 0)],
                );
                assert!((a + t - 1.0).norm() < 1e-9, "{name}");
            }
            assert!(s.complementary.is_stable().unwrap(), "{name}");
        }
        // Property 3.3: slopes at high frequency, with the relative degree of 1/r.
        let extra = if number == 3 { 0.0 } else { 1.0 };
        let slope = |s: &Shapes| {
            (magnitude(&s.complementary, 1e5) / magnitude(&s.complementary, 1e6)).log10()
        };
        assert!(
            (slope(j1) - 1.0 - extra).abs() < 0.02,
            "example {number}: {}",
            slope(j1)
        );
        assert!((slope(j2) - 1.0).abs() < 0.02 && (slope(standard) - 1.0).abs() < 0.02);
        // Property 3.4: |s2| <= 1 everywhere; |s1| exceeds 1 somewhere.
        let grid: Vec<f64> = (0..400)
            .map(|i| 1e-3 * 10f64.powf(7.0 * i as f64 / 399.0))
            .collect();
        assert!(
            grid.iter()
                .all(|&w| magnitude(&j2.sensitivity, w) <= 1.0 + 1e-9)
        );
        if number != 3 {
            assert!(
                grid.iter()
                    .any(|&w| magnitude(&j1.sensitivity, w) > 1.0 + 1e-4),
                "example {number}"
            );
        }
        match number {
            // Only t1 is lower at high frequency; s and m are alike at low frequency.
            1 => {
                assert!(
                    magnitude(&j1.complementary, 1e4)
                        < 0.05 * magnitude(&standard.complementary, 1e4)
                );
                assert!(
                    (magnitude(&j1.disturbance, 0.01) / magnitude(&standard.disturbance, 0.01)
                        - 1.0)
                        .abs()
                        < 0.1
                );
            }
            // J2 improves s and m at low frequency and leaves t at high frequency; J1 does not improve the low frequencies.
            _ => {
                assert!(
                    magnitude(&j2.disturbance, 0.01) < 0.3 * magnitude(&standard.disturbance, 0.01),
                    "example {number}"
                );
                assert!(
                    magnitude(&j2.sensitivity, 0.01) < 0.3 * magnitude(&standard.sensitivity, 0.01),
                    "example {number}"
                );
                assert!(
                    magnitude(&j1.disturbance, 0.1) > 0.5 * magnitude(&standard.disturbance, 0.1),
                    "example {number}"
                );
            }
        }
    }
    let standard = shapes(&Cost::Standard).unwrap();
    let crossover = fuyu_lti::margins(&standard.open_loop).unwrap().phase[0].frequency;
    assert!((1.5..4.0).contains(&crossover), "{crossover}");
    // The circle criterion of the standard regulator.
    assert!(fuyu_lti::margins(&standard.open_loop).unwrap().phase[0].degrees > 60.0);
}

// Example 4 with the correction: better at low and at high frequency than the standard regulator.
#[test]
fn loop_shaping_example_4() {
    let all = designed(4);
    let [(_, both), (_, standard)] = &all[..] else {
        panic!()
    };
    assert!(magnitude(&both.disturbance, 0.01) < 0.3 * magnitude(&standard.disturbance, 0.01));
    assert!(magnitude(&both.sensitivity, 0.01) < 0.3 * magnitude(&standard.sensitivity, 0.01));
    assert!(magnitude(&both.complementary, 1e4) < 0.1 * magnitude(&standard.complementary, 1e4));
    // As printed, q = 1 and 1/r = 1/(s+.05), it is example 2's J1, which is not better at low frequency.
    let printed = shapes(&Cost::Control(
        TransferFunction::new(&[1.0], &[1.0, 0.05]).unwrap(),
    ))
    .unwrap();
    assert!(magnitude(&printed.disturbance, 0.1) > 0.5 * magnitude(&standard.disturbance, 0.1));
}

#[test]
fn the_truss_with_three_inputs_and_outputs() {
    assert_eq!(truss::size(), (45, 99, 90));
    let all: Vec<_> = Weights::ALL
        .iter()
        .map(|&w| truss::design(w).unwrap())
        .collect();
    for d in &all {
        println!(
            "{:?}: robustness {:.4}, largest real part {:.4}, static deviation {:.4}",
            d.weights, d.robustness, d.largest_real_part, d.static_deviation
        );
    }
    let poles: Vec<f64> = truss::plant(15)
        .unwrap()
        .poles()
        .unwrap()
        .iter()
        .filter(|p| p.im > 0.1)
        .map(|p| p.norm())
        .collect();
    println!("modes rad/s {poles:?}");
    let [standard, control, both] = &all[..] else {
        panic!()
    };
    // Figs. 3.20 (d), 3.21: the standard design violates the condition and is unstable on 15 modes.
    assert!(standard.robustness > 1.0 && standard.largest_real_part > 0.0);
    // Figs. 3.22 (d), 3.24 (d): the shaped ones satisfy it, so they are stable (small gain).
    for d in [control, both] {
        assert!(
            d.robustness < 1.0 && d.largest_real_part < 0.0,
            "{:?}",
            d.weights
        );
    }
    // Fig. 3.25 (b) against 3.23 (b): q reduces the static deviation.
    assert!(both.static_deviation.abs() < 0.2 * control.static_deviation.abs());
    // The last sample of the step response is near that deviation; the impulse response decays.
    let step = both.step(0.02, 3000).unwrap();
    assert_close(
        "static deviation",
        step.last().unwrap().1[0],
        both.static_deviation,
        0.02 * both.static_deviation.abs(),
    );
    let impulse = control.impulse(0.02, 3000).unwrap();
    let late = impulse[2800..]
        .iter()
        .map(|s| s.1[0].abs())
        .fold(0.0, f64::max);
    let early = impulse[..200]
        .iter()
        .map(|s| s.1[0].abs())
        .fold(0.0, f64::max);
    assert!(late < 0.2 * early, "{late} {early}");
    // S + T = I.
    for w in [0.1, 10.0, 100.0] {
        let sum = both.functions[1].response(w).unwrap() + both.functions[2].response(w).unwrap();
        assert!((sum - nalgebra::DMatrix::identity(3, 3)).camax() < 1e-8);
    }
}
