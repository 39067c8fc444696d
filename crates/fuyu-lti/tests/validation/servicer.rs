//! Attitude control of the servicer with panels: DVDFB and the double H-infinity loop. Fixtures `flexible_dvdfb.json` and `flexible_hinf.json`:
//! computed in Python (SciPy, SLICOT) from the same mass matrices.

use crate::support::servicer::{attitude, base_mass, gains, hybrid, under_torques};
use crate::support::*;
use fuyu_lti::kida1993::double_loop::{
    DoubleLoop, Problem, covering_gain, sampled_step, step, verdict,
};
use fuyu_lti::{
    Matrix, Structure, TransferFunction, loop_at_input, margins, spectral_radius, step_figures,
};
use serde_json::Value;

const POSTURES: [&str; 3] = ["A", "B", "C"];

#[test]
fn frequencies_and_zeros_with_a_free_base() {
    let all = fixture("flexible_panels_linear");
    for angle in ["0.0", "0.6"] {
        for posture in POSTURES {
            let want = &all["linear"][angle][posture];
            let six = hybrid(&all, want, &base_mass(want, false));
            let plant = six.displacement_system().unwrap();
            // The rigid modes have poles at the origin.
            let poles: Vec<_> = plant
                .poles()
                .unwrap()
                .into_iter()
                .filter(|p| p.im > 0.1)
                .collect();
            let worst = matched(&poles, &complex_list(&want["poles_locked"]));
            println!("{angle} {posture}: poles {worst:.1e}");
            assert!(worst < 1e-8, "{angle} {posture}: {worst:e}");

            // The fixture lists zeros with positive imaginary part. With six torques and forces: exactly the modes of the clamped panels.
            // Rigid rotation about the other axes is in poles and zeros at the origin.
            let upper = |z: Vec<fuyu_lti::Complex>| {
                z.into_iter().filter(|z| z.im > 0.1).collect::<Vec<_>>()
            };
            let clamped: Vec<_> = list(&all["frequencies_hz"])
                .iter()
                .flat_map(|f| {
                    let w = f * std::f64::consts::TAU;
                    [fuyu_lti::Complex::new(-0.005 * w, w * (1.0 - 0.005f64.powi(2)).sqrt()); 2]
                })
                .collect();
            let got = upper(plant.zeros().unwrap());
            assert_eq!(got.len(), 8, "{angle} {posture}: {got:?}");
            assert!(
                matched(&got, &clamped) < 1e-8,
                "{angle} {posture}: six by six {:e}",
                matched(&got, &clamped)
            );

            let three = under_torques(&six);
            let got = upper(three.displacement_system().unwrap().zeros().unwrap());
            let expected = complex_list(&want["zeros_torque3_to_attitude3"]);
            assert_eq!(got.len(), expected.len());
            let worst = matched(&got, &expected);
            println!("{angle} {posture}: zeros 3 x 3 {worst:.1e}");
            assert!(worst < 1e-8, "{angle} {posture}: three by three {worst:e}");
            for (i, axis) in ["x", "y", "z"].into_iter().enumerate() {
                let one = three
                    .with_actuators(&[i])
                    .unwrap()
                    .displacement_system()
                    .unwrap();
                let got = upper(one.zeros().unwrap());
                let expected = complex_list(&want["zeros_siso"][axis]);
                assert_eq!(
                    got.len(),
                    expected.len(),
                    "{angle} {posture} {axis}: {got:?}"
                );
                let worst = matched(&got, &expected);
                assert!(worst < 1e-8, "{angle} {posture} {axis}: {worst:e}");
            }
        }
    }
}

// The gains of a wheel with its inertia in the plant, or of a posture with another's mass matrix, are off in the third digit.
#[test]
fn direct_feedback_in_three_postures() {
    let all = fixture("flexible_dvdfb");
    let (p, d) = gains(60.0, 900.0);
    for posture in POSTURES {
        let want = &all[posture];
        let s = attitude(posture, "0.0");
        s.certify(&p, &d).unwrap();
        let poles = s.direct_feedback(&p, &d).unwrap().poles().unwrap();
        let largest = poles.iter().fold(f64::NEG_INFINITY, |m, p| m.max(p.re));
        assert_close(posture, largest, number(&want["max_re"]), 1e-9);
        let upper: Vec<_> = poles.iter().copied().filter(|p| p.im >= 0.0).collect();
        let expected = complex_list(&want["poles"]);
        assert_eq!(upper.len(), expected.len());
        let worst = matched(&upper, &expected);
        println!("{posture}: largest real part {largest:.9}, poles {worst:.1e}");
        assert!(worst < 1e-6, "{posture}: {worst:e}");
        let damping = poles
            .iter()
            .map(|p| -p.re / p.norm())
            .fold(f64::INFINITY, f64::min);
        assert_close(
            "smallest damping ratio",
            damping,
            number(&want["min_damping"]),
            1e-9,
        );

        let plant = s.displacement_and_rate_system().unwrap();
        let controller = fuyu_lti::StateSpace::gain(Matrix::from_fn(3, 6, |i, j| {
            if j < 3 { p[(i, j)] } else { d[(i, j - 3)] }
        }));
        for (i, axis) in ["x", "y", "z"].into_iter().enumerate() {
            let m = margins(&loop_at_input(&plant, &controller, i).unwrap()).unwrap();
            let phase = &want["margins"][axis]["phase"];
            assert_crossovers(
                &format!("{posture} {axis}"),
                phase_margins(&m),
                phase,
                |_| 1e-6,
                0.01,
            );
            assert!(m.gain.is_empty(), "{posture} {axis}: {:?}", m.gain);
            assert_close(
                axis,
                m.min_return_difference.min(1.0),
                number(&want["margins"][axis]["min_return_difference"]).min(1.0),
                1e-4,
            );
        }
    }
}

// With one sample of delay and .5 s the verdict depends on the posture: unstable in A and B, stable in C.
#[test]
fn sampling_and_delay_verdicts() {
    let all = fixture("flexible_dvdfb");
    let (p, d) = gains(60.0, 900.0);
    let controller = fuyu_lti::StateSpace::gain(Matrix::from_fn(3, 6, |i, j| {
        if j < 3 { p[(i, j)] } else { d[(i, j - 3)] }
    }));
    for posture in POSTURES {
        let plant = attitude(posture, "0.0")
            .displacement_and_rate_system()
            .unwrap();
        for (key, want) in all[posture]["discrete_radius_nodelay_and_one_sample"]
            .as_object()
            .unwrap()
        {
            let step: f64 = key.parse().unwrap();
            for (delay, want) in [(0.0, number(&want[0])), (step, number(&want[1]))] {
                let closed = plant
                    .zero_order_hold_delayed(step, delay)
                    .unwrap()
                    .feedback(&controller)
                    .unwrap();
                let radius = spectral_radius(&closed.a).unwrap();
                assert_close(
                    &format!("{posture}, {step} s, delay {delay} s"),
                    radius,
                    want,
                    1e-6,
                );
                if step == 0.5 && delay > 0.0 {
                    assert_eq!(radius < 1.0, posture == "C");
                }
            }
        }
    }
}

/// The servicer's base and panels with an arm of random mass distribution: the mass matrix of a random set of points is added to that of posture C less most of its arm.
fn random_posture(random: &mut Random, all: &Value) -> Structure {
    let linear = &all["linear"]["0.0"]["C"];
    let mut base = base_mass(linear, true);
    for _ in 0..4 {
        let mass = random.log_uniform(5.0, 60.0);
        let r = [
            3.0 * random.signed(),
            3.0 * random.signed(),
            1.5 * random.signed(),
        ];
        let cross = Matrix::from_row_slice(
            3,
            3,
            &[0.0, -r[2], r[1], r[2], 0.0, -r[0], -r[1], r[0], 0.0],
        );
        let mut jacobian = Matrix::zeros(3, 6);
        jacobian
            .view_mut((0, 0), (3, 3))
            .copy_from(&Matrix::identity(3, 3));
        jacobian.view_mut((0, 3), (3, 3)).copy_from(&-cross);
        base += jacobian.transpose() * jacobian * mass;
    }
    under_torques(&hybrid(all, linear, &base))
}

// Theorem 4.1: stable for whichever mass distribution the arm has, with the gains of the flight design and with random symmetric positive ones; skew gains
// break the premise. The reference's 400 postures have -.00631 as the worst real part with these gains.
#[test]
fn four_hundred_random_mass_distributions_are_stable() {
    let all = fixture("flexible_panels_linear");
    let mut random = Random::new(14);
    let (p, d) = gains(60.0, 900.0);
    let (mut worst, mut worst_random, mut unstable) = (f64::NEG_INFINITY, f64::NEG_INFINITY, 0);
    for _ in 0..400 {
        let s = random_posture(&mut random, &all);
        let abscissa = |p: &Matrix, d: &Matrix| {
            fuyu_lti::spectral_abscissa(&s.direct_feedback(p, d).unwrap().a).unwrap()
        };
        worst = worst.max(abscissa(&p, &d));
        let (rp, rd) = (
            random.definite(3, 0.05) * 60.0,
            random.definite(3, 0.05) * 900.0,
        );
        s.certify(&rp, &rd).unwrap();
        worst_random = worst_random.max(abscissa(&rp, &rd));
        let v = [random.signed(), random.signed(), random.signed()];
        let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let skew = Matrix::from_row_slice(
            3,
            3,
            &[0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0],
        ) * (600.0 / length);
        let skewed = &p + skew;
        assert!(s.certify(&skewed, &d).is_err());
        unstable += usize::from(abscissa(&skewed, &d) > 0.0);
    }
    println!(
        "largest real part {worst:.5}, with random gains {worst_random:.2e}; {unstable} of 400 unstable with skew gains"
    );
    assert!(worst < -0.006, "{worst}");
    assert!(worst_random < 0.0, "{worst_random}");
    assert_eq!(unstable, 400);
}

fn weight(k: f64) -> TransferFunction {
    TransferFunction::new(&[k, 0.0, 0.0], &[1.0, 2.8 * 0.2, 4.0 * 0.2 * 0.2]).unwrap()
}

fn problem(inertia: f64, rate_gain: f64, k: f64) -> Problem {
    Problem {
        inertia,
        rate_gain,
        robustness: weight(k),
        frequency: 0.2,
        noise: 0.01,
    }
}

fn structures() -> Vec<Structure> {
    POSTURES.iter().map(|p| attitude(p, "0.0")).collect()
}

/// Rotation about y with the other attitudes free to follow.
fn one_axis() -> Vec<Structure> {
    structures()
        .iter()
        .map(|s| {
            s.with_actuators(&[1])
                .unwrap()
                .without_free_coordinates(&[0, 2])
                .unwrap()
        })
        .collect()
}

/// Frequencies of the reference's sweep: from 1e-3 rad/s up, dense at the modes. The model error is largest at its lower end without the inner loop and
/// in posture C, because a constant error of the inertia weighs against W2, which is zero at 0; so that end is part of the definition of k.
fn sweep() -> Vec<f64> {
    let mut grid = structures()[0]
        .with_actuators(&[1])
        .unwrap()
        .displacement_system()
        .unwrap()
        .frequency_grid(1.0001e-3, 100.0, 300)
        .unwrap();
    grid.insert(0, 1e-3);
    grid
}

#[test]
fn the_double_loop_needs_less_cover() {
    let all = fixture("flexible_hinf");
    let inertia = number(&all["J"]);
    // The rigid inertia about y in posture B, with the other attitudes free to move.
    let b = attitude("B", "0.0");
    let rigid = b
        .mass()
        .view((0, 0), (3, 3))
        .into_owned()
        .try_inverse()
        .unwrap();
    assert_close("J", 1.0 / rigid[(1, 1)], inertia, 1e-9 * inertia);
    // The reference covers with a margin of a tenth.
    for (rate_gain, key) in [(900.0, "k_with_dvfb"), (0.0, "k_without")] {
        let k = covering_gain(
            &structures(),
            1,
            &problem(inertia, rate_gain, 1.0),
            &weight(1.0),
            &sweep(),
        )
        .unwrap();
        let want = number(&all[key]);
        assert_close(key, 1.1 * k, want, 1e-6 * want);
    }
}

fn check(design: &DoubleLoop, key: &str) {
    let all = fixture("flexible_hinf");
    let want = &all[key];
    let name = key;
    println!(
        "{name}: gamma_max {:.10}, norm {:.10} (swept {:.10}), residual {:.1e}",
        design.gamma_max, design.hinf.norm.norm, design.hinf.norm.swept, design.hinf.residual
    );
    assert_close(
        name,
        design.gamma_max,
        number(&want["gamma_max"]),
        1e-4 * design.gamma_max,
    );
    assert_close(
        name,
        design.gamma,
        number(&want["gamma"]),
        1e-4 * design.gamma,
    );
    // Two methods: Hamiltonian and sweep; and the reference's two, its sweep and SLICOT's AB13DD.
    assert!(design.hinf.norm.norm < 1.0 && design.hinf.norm.swept < 1.0);
    assert_close(name, design.hinf.norm.norm, design.hinf.norm.swept, 1e-7);
    assert_close(
        name,
        design.hinf.norm.norm,
        number(&want["norm_ab13dd"]),
        1e-5,
    );
    assert_close(name, design.hinf.norm.norm, number(&want["norm"]), 1e-5);
    // The controller as a transfer function, whichever its coordinates.
    let reference = fuyu_lti::StateSpace::new(
        matrix(&want["K"]["A"]),
        matrix(&want["K"]["B"]),
        matrix(&want["K"]["C"]),
        Matrix::zeros(1, 2),
    )
    .unwrap();
    for w in [0.001, 0.01, 0.1, 0.2, 1.0, 10.0] {
        // The fixture's second input is the rate in rad/s, scaled by 1/w0 already in its B; its output is in N m.
        let got = design.outer.response(w).unwrap();
        let expected = reference.response(w).unwrap();
        for j in 0..2 {
            let e = (got[(0, j)] - expected[(0, j)]).norm() / expected[(0, j)].norm();
            assert!(e < 1e-4, "{name}, {w} rad/s, input {j}: {e:e}");
        }
    }
    for (posture, structure) in POSTURES.iter().zip(one_axis()) {
        let v = verdict(&structure, 0, &design.controller).unwrap();
        assert_close(
            posture,
            v.largest_real_part,
            number(&want[posture]["max_re"]),
            1e-8,
        );
        let phase = &want[posture]["margins"]["phase"];
        assert_crossovers(posture, phase_margins(&v.margins), phase, |_| 1e-4, 0.05);
        assert!(v.margins.gain.is_empty());
    }
}

#[test]
fn the_double_loop_on_the_servicer() {
    let all = fixture("flexible_hinf");
    let (inertia, k) = (number(&all["J"]), number(&all["k_with_dvfb"]));
    check(&problem(inertia, 900.0, k).solve(0.9).unwrap(), "DVFB+Hinf");
    check(
        &problem(inertia, 0.0, k).solve(0.9).unwrap(),
        "Hinf alone, same W2",
    );
    // With a weight that covers the error of the plant without the inner loop there is no controller.
    assert!(
        problem(inertia, 0.0, number(&all["k_without"]))
            .solve(0.9)
            .is_err()
    );
}

// The continuous loop in posture B; the figures come from samples every half second, as in the fixture.
#[test]
fn step_responses_of_the_double_loop() {
    let all = fixture("flexible_hinf");
    let (inertia, k) = (number(&all["J"]), number(&all["k_with_dvfb"]));
    for (rate_gain, key) in [(900.0, "DVFB+Hinf"), (0.0, "Hinf alone, same W2")] {
        let want = &all[key];
        let design = problem(inertia, rate_gain, k).solve(0.9).unwrap();
        let run = step(&one_axis()[1], 0, &design.controller, 0.5, 601).unwrap();
        let angle: Vec<f64> = run.iter().map(|v| v.0.to_degrees()).collect();
        let mut worst = (0.0_f64, 0.0_f64);
        for (i, (a, u)) in list(&want["step_deg"])
            .iter()
            .zip(list(&want["step_torque"]))
            .enumerate()
        {
            worst = (
                worst.0.max((a - angle[10 * i]).abs()),
                worst.1.max((u - run[10 * i].1).abs()),
            );
        }
        let figures = step_figures(&angle, 0.5, 1.0, 0.05);
        let torque = run.iter().map(|v| v.1.abs()).fold(0.0, f64::max);
        println!(
            "{key}: {figures:?}, torque {torque:.6}; differs by {:.1e} deg, {:.1e} N m",
            worst.0, worst.1
        );
        assert!(worst.0 < 1e-6 && worst.1 < 1e-6, "{worst:?}");
        assert_close(
            "overshoot",
            figures.overshoot_percent,
            number(&want["overshoot_pct"]),
            0.05,
        );
        assert_close(
            "settling",
            figures.settling,
            number(&want["settle5_s"]),
            0.5,
        );
        assert_close("torque", torque, number(&want["max_torque"]), 1e-4);
        // A controller sampled at 10 Hz does nearly the same.
        let sampled = sampled_step(&one_axis()[1], 0, &design.controller, 0.1, 100.0).unwrap();
        assert!(
            (0..20).all(|i| (sampled.output[50 * i][0].to_degrees() - angle[10 * i]).abs() < 2e-3)
        );
    }
}
