//! Panels and beams that spin: second-order modes against finite elements with centrifugal stiffness, and against independent values.

use fuyu_structures::{Appendage, Beam, End, Kinetics, generalized_eigen};
use nalgebra::{DVector, Vector3};

use crate::support::{boom, fixture, numbers, panel, strip, worst};

/// A beam that is 1 m, 1 kg/m, 1 N m².
fn unit_boom(elements: usize, modes: [usize; 2], second_order: bool) -> Appendage {
    boom(&Beam::uniform(1.0, 1.0, 1.0, elements), modes, second_order)
}

// Acceptance: spin frequencies to 1e-5. The exact values are another program's finite elements.
#[test]
fn the_panels_first_frequency_under_spin_is_that_of_exact_finite_elements() {
    let expected = fixture("flexible_spin");
    let (first, second) = (panel(false), panel(true));
    let mut with_six = strip(true);
    with_six.bending_modes = 6;
    let six = with_six.appendage("panel").unwrap();
    let p = Vector3::new(1.2, 0.0, 0.0); // hub offset .15 L
    let mut largest = [0.0_f64; 3];
    for rate in ["0.02", "0.05", "0.1", "0.2", "0.5"] {
        for (axis, name) in [Vector3::x(), Vector3::y(), Vector3::z()]
            .into_iter()
            .zip(["x", "y", "z"])
        {
            let w = axis * rate.parse::<f64>().unwrap();
            let case = &expected[rate][name];
            let [exact, with, without] =
                ["exact", "second_order", "first_order"].map(|k| case[k].as_f64().unwrap());
            let found = second.spin_frequencies(&w, &p).unwrap()[0];
            let error = (found / exact - 1.0).abs();
            assert!(error < 1e-5, "{rate} {name}: {found} {exact}");
            largest[0] = largest[0].max(error);
            let found = six.spin_frequencies(&w, &p).unwrap()[0];
            largest[1] = largest[1].max((found / with - 1.0).abs());
            largest[2] = largest[2].max((found / exact - 1.0).abs());
            let found = first.spin_frequencies(&w, &p).unwrap()[0];
            assert!(
                (found / without - 1.0).abs() < 1e-9,
                "first order, {rate} {name}: {found} {without}"
            );
            if name != "x" {
                // The coefficient printed in flexible.md: -.715 (Omega/omega_1)².
                let ratio = (w.norm() / 1.228_445).powi(2);
                let coefficient = (without / exact - 1.0) / ratio;
                assert!(
                    w.norm() > 0.1 || (coefficient + 0.715).abs() < 0.01,
                    "{rate} {name}: {coefficient}"
                );
            }
        }
    }
    println!(
        "3 modes {:.1e}, 6 modes {:.1e}, 6 modes of another program {:.1e}",
        largest[0], largest[2], largest[1]
    );
    assert!(largest[1] < 1e-11 && largest[2] < 1e-6, "{largest:?}");
}

// Wright et al. 1982 have 3.68165 and so on from power series; the file has 80 elements.
#[test]
fn the_rotating_cantilever_has_the_tabulated_frequencies() {
    let expected = fixture("flexible_beam");
    let beam = Beam::uniform(1.0, 1.0, 1.0, 40);
    let (matrices, centrifugal) = (
        beam.matrices().unwrap().held(&[0, 1]).unwrap(),
        beam.centrifugal_stiffness(0.0).unwrap(),
    );
    let centrifugal = centrifugal.view((2, 2), (80, 80)).into_owned();
    let series = unit_boom(24, [6, 6], true);
    let mut largest = [0.0_f64; 2];
    for rate in 0..=12 {
        let w = f64::from(rate);
        let flap = &matrices.K + &centrifugal * (w * w);
        let lag = &flap - &matrices.M * (w * w);
        let expected = &expected["rotating_cantilever"][rate.to_string()];
        for (K, name) in [(flap, "flap"), (lag, "lag")] {
            let values = generalized_eigen(&K, &matrices.M).unwrap().values;
            let found: Vec<f64> = (0..3).map(|k| values[k].sqrt()).collect();
            let error = worst(&found, &numbers(&expected[name]));
            assert!(error < 2e-6, "{rate} {name}: {error:e}");
            largest[0] = largest[0].max(error);
        }
        // Six second-order modes: spin about y moves the beam along z in flap and along y in lag.
        let found = series
            .spin_frequencies(&Vector3::new(0.0, 0.0, w), &Vector3::zeros())
            .unwrap();
        let lowest = numbers(&expected["lag"])[0].min(numbers(&expected["flap"])[0]);
        let error = (found[0] / lowest - 1.0).abs();
        assert!(error < 2e-3, "{rate}: {error:e}");
        if rate <= 3 {
            largest[1] = largest[1].max(error);
        }
    }
    println!(
        "finite elements {:.1e}; six second-order modes up to 3 rad/s {:.1e}",
        largest[0], largest[1]
    );
    assert!(largest[1] < 1e-5);
    // Southwell's coefficient: K_11 of the first mode.
    let southwell = |hub: f64| {
        let w = Vector3::new(0.0, 1.0, 0.0);
        let a = w.cross(&w.cross(&Vector3::new(hub, 0.0, 0.0)));
        series.spin_stiffness(&w, &a)[(6, 6)]
    };
    let table = &fixture("flexible_beam")["southwell"];
    // Mode z1 under spin about y bends in the plane of rotation: 1 is subtracted.
    // The file's values, 1.1934 and 1.4307, come from differences of frequencies; these are the derivatives at rest.
    for (hub, key, limit) in [(0.0, "hub0", 2e-4), (0.15, "hub015", 2e-3)] {
        let found = southwell(hub) + 1.0;
        assert!(
            (found - table[key].as_f64().unwrap()).abs() < limit,
            "{hub}: {found}"
        );
        // The same from finite elements, with the tension as a function of the radius.
        let shape = beam
            .modes(End::Clamped, End::Free, 1)
            .unwrap()
            .shapes
            .column(0)
            .into_owned();
        let elements = shape.dot(&(beam.centrifugal_stiffness(hub).unwrap() * &shape));
        assert!((found - elements).abs() < 1e-6, "{hub}: {found} {elements}");
    }
}

// Second-order modes converge with the number of modes; the differences to the exact values are those of another program.
#[test]
fn more_second_order_modes_are_needed_for_faster_spin() {
    let expected = fixture("flexible_beam");
    for (modes, key) in [
        (2, "second_order_2_modes_rel"),
        (4, "second_order_4_modes_rel"),
        (6, "second_order_6_modes_rel"),
    ] {
        let series = unit_boom(32, [0, modes], true);
        for rate in ["1.0", "3.0", "6.0", "12.0"] {
            // The boom bends in the plane of rotation: lag.
            let w = Vector3::y() * rate.parse::<f64>().unwrap();
            let found = series.spin_frequencies(&w, &Vector3::zeros()).unwrap()[0];
            let whole = rate.trim_end_matches(".0");
            let exact = numbers(&expected["rotating_cantilever"][whole]["lag"])[0];
            let error = (found / exact - 1.0).abs();
            let other = expected[key][rate].as_f64().unwrap();
            assert!(
                (error - other).abs() < 1e-3 * other + 2e-8,
                "{modes} modes, {rate} rad/s: {error:e}, {other:e}"
            );
        }
    }
}

/// Spin-up profile of Kane, Ryan and Banerjee 1987: angular rate and acceleration at `t`, 6 rad/s after 15 s.
fn spin_up(t: f64) -> (f64, f64) {
    let (duration, rate, tau) = (15.0, 6.0, std::f64::consts::TAU);
    if t >= duration {
        return (rate, 0.0);
    }
    let phase = tau * t / duration;
    (
        rate / duration * (t - duration / tau * phase.sin()),
        rate / duration * (1.0 - phase.cos()),
    )
}

/// Deflection of the tip along y, every .25 s, of a beam whose root turns about z.
fn spin_up_run(beam: &Appendage, end: f64) -> Vec<f64> {
    let n = beam.modes();
    let mut kinetics = Kinetics::new(beam);
    let mut rates = |t: f64, x: &DVector<f64>| -> DVector<f64> {
        let (rate, acceleration) = spin_up(t);
        let (mu, mu_dot) = (x.rows(0, n).into_owned(), x.rows(n, n).into_owned());
        kinetics.update(
            beam,
            mu.as_slice(),
            mu_dot.as_slice(),
            &Vector3::new(0.0, 0.0, rate),
        );
        let M = kinetics.mass_matrix.view((6, 6), (n, n)).into_owned();
        let from_base = kinetics.mass_matrix.column(5).rows(6, n) * acceleration;
        let force = -(&beam.modal_stiffness * mu) - kinetics.bias.rows(6, n) - from_base;
        let mut derivative = DVector::zeros(2 * n);
        derivative.rows_mut(0, n).copy_from(&mu_dot);
        derivative
            .rows_mut(n, n)
            .copy_from(&M.cholesky().expect("positive definite").solve(&force));
        derivative
    };
    let (h, every) = (0.005, 50);
    let mut x = DVector::zeros(2 * n);
    let mut tips = vec![0.0];
    for step in 0..(end / h).round() as usize {
        let t = step as f64 * h;
        let k1 = rates(t, &x);
        let k2 = rates(t + h / 2.0, &(&x + &k1 * (h / 2.0)));
        let k3 = rates(t + h / 2.0, &(&x + &k2 * (h / 2.0)));
        let k4 = rates(t + h, &(&x + &k3 * h));
        x += (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
        if (step + 1) % every == 0 {
            tips.push(beam.outputs[0].displacement(&x.as_slice()[..n]).y);
        }
    }
    tips
}

// Acceptance: the tip's minimum is -.5758 +- 5e-4 m. First-order modes diverge.
#[test]
fn a_beam_that_spins_up_bends_as_an_independent_program_says() {
    let expected = fixture("flexible_beam");
    let runs = &expected["spin_up"]["runs"];
    let beam = Beam::uniform(10.0, 1.2, 1.4e4, 40);
    for modes in [1, 3] {
        let tips = spin_up_run(&boom(&beam, [modes, 0], true), 8.0);
        let other = numbers(&runs[format!("second order {modes}")]["tip"]);
        let difference = tips
            .iter()
            .zip(&other)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        println!(
            "{modes} modes: {:.6} m at 6.75 s, largest difference {difference:.1e} m",
            tips[27]
        );
        assert!(difference < 1e-5, "{modes} modes: {difference:e}");
        if modes == 3 {
            let least = tips.iter().copied().fold(0.0, f64::min);
            assert!((least + 0.5758).abs() < 5e-4, "{least}");
        }
    }
    let tips = spin_up_run(&boom(&beam, [3, 0], false), 8.0);
    let other = numbers(&runs["first order 3"]["tip"]);
    assert!(
        (tips[27] - other[27]).abs() < 1e-5 && tips[32] < -2.0,
        "{} {}",
        tips[27],
        tips[32]
    );
}

// Statics: a panel of first or second order that is held deflected while its root spins. The force that holds it comes from the potential
// -½ w·J(μ)w, whose exact value for an inextensible beam with finite rotations is known: foreshortening changes it by terms of the fourth power. The
// remainder of the second-order model is thus cubic in the force.
#[test]
fn the_rest_of_the_second_order_model_is_cubic_in_the_amplitude() {
    let body = panel(true);
    let strip = strip(true);
    let shape = fuyu_structures::Cantilever::new(strip.length, 6.0, strip.EI).unwrap();
    let w = Vector3::new(0.0, 0.0, 1.0);
    // ½ w·J w with J of a beam of exact length: sin(slope angle) = w', x = ∫ cos.
    let exact = |mu: f64| {
        let (steps, mut x, mut sum) = (20_000, 0.0, 0.0);
        let h = strip.length / f64::from(steps);
        for i in 0..steps {
            let slope = mu * shape.shape(0, (f64::from(i) + 0.5) * h).slope;
            let along = (1.0 - slope * slope).sqrt() * h;
            let middle = x + along / 2.0;
            sum += 6.0 * h * middle * middle / 2.0;
            x += along;
        }
        sum + 48.0 * strip.width.powi(2) / 24.0
    };
    let model = |mu: f64, body: &Appendage| {
        let mut kinetics = Kinetics::new(body);
        kinetics.update(body, &[mu, 0.0, 0.0, 0.0], &[0.0; 4], &w);
        -kinetics.bias[6] // ∂/∂μ of ½ w·J w
    };
    let force = |mu: f64| (exact(mu + 1e-3) - exact(mu - 1e-3)) / 2e-3;
    let error = |mu: f64| (model(mu, &body) - force(mu)).abs();
    let ratio = error(4.0) / error(2.0);
    println!(
        "errors {:.3e}, {:.3e}: ratio {ratio:.3}",
        error(2.0),
        error(4.0)
    );
    assert!(
        (ratio - 8.0).abs() < 0.5,
        "doubled amplitude, {ratio}-fold remainder"
    );
    let first = body.first_order();
    let linear = (model(4.0, &first) - force(4.0)).abs() / (model(2.0, &first) - force(2.0)).abs();
    assert!(
        (linear - 2.0).abs() < 0.1,
        "first order lacks a term that is linear in the amplitude: {linear}"
    );
}

// A panel that is only turned at its axis keeps its moment of inertia: torsion changes nothing for spin about x. Without the term -½ y θ² the
// frequency would fall by Ω².
#[test]
fn torsion_keeps_its_frequency_in_a_frame_that_spins_about_the_panels_axis() {
    let body = panel(true).selected(&[3]).unwrap();
    let still = body.frequencies().unwrap()[0];
    let spinning = body
        .spin_frequencies(&Vector3::new(0.5, 0.0, 0.0), &Vector3::zeros())
        .unwrap()[0];
    assert!((spinning / still - 1.0).abs() < 1e-12, "{still} {spinning}");
    let first = body
        .first_order()
        .spin_frequencies(&Vector3::new(0.5, 0.0, 0.0), &Vector3::zeros())
        .unwrap()[0];
    assert!((first * first - (still * still - 0.25)).abs() < 1e-9);
}

#[test]
fn a_rate_at_which_first_order_modes_diverge_is_an_error() {
    let error =
        panel(false).spin_frequencies(&Vector3::new(0.0, 0.0, 20.0), &Vector3::new(1.2, 0.0, 0.0));
    // Out-of-plane bending does not soften under spin about z; about x it does.
    assert!(error.is_ok());
    let error = panel(false)
        .spin_frequencies(&Vector3::new(1.3, 0.0, 0.0), &Vector3::zeros())
        .unwrap_err()
        .to_string();
    assert!(error.contains("diverges at this rate"), "{error}");
}

// The closed form of the pinned hub with a beam: 7.9987, 25.034, 67.068 rad/s; modes converge with about n^-7.
#[test]
fn a_free_hub_with_a_beam_has_the_exact_frequencies() {
    let expected = &fixture("flexible_beam")["free_hub_beam"];
    let exact = numbers(&expected["exact_rad_s"]);
    let hub = expected["Jh"].as_f64().unwrap();
    let mut last = 1.0;
    for modes in [3, 6, 12] {
        // Beam of the spin-up: 10 m, 1.2 kg/m, 1.4e4 N m².
        let beam = fuyu_structures::Cantilever::new(10.0, 1.2, 1.4e4).unwrap();
        let J = nalgebra::DMatrix::from_element(1, 1, hub + 1.2 * 1000.0 / 3.0);
        let P = nalgebra::DMatrix::from_fn(modes, 1, |k, _| beam.first_moment(k));
        let w: Vec<f64> = (0..modes).map(|k| beam.frequency(k)).collect();
        let model = fuyu_structures::HybridModel::new(J, P, &w, &vec![0.0; modes]).unwrap();
        let error = worst(&model.frequencies().unwrap()[..1], &exact[..1]);
        println!("{modes} modes: {error:.1e}");
        assert!(error < last / 20.0, "{modes} modes: {error:e}");
        last = error;
    }
    assert!(last < 1e-9);
    // The same as finite elements with the hub as a body at the pinned root: all three frequencies.
    let mut beam = Beam::uniform(10.0, 1.2, 1.4e4, 64);
    beam.bodies.push(fuyu_structures::NodeBody {
        node: 0,
        mass: 0.0,
        inertia: hub,
    });
    let modes = beam.modes(End::Pinned, End::Free, 4).unwrap();
    assert!(
        worst(&modes.frequencies.as_slice()[1..], &exact) < 1e-6,
        "{}",
        modes.frequencies
    );
}

// The limits at which the dynamics warns: a tenth of the first frequency costs .7 % of it, .03 L of deflection.
#[test]
fn first_order_modes_suffice_up_to_stated_limits() {
    let body = panel(false);
    let limits = body.first_order_limits().unwrap();
    assert!((limits.rate - 0.122_844_518).abs() < 1e-8, "{limits:?}");
    // The farthest points are the corners of the tip.
    assert!(
        (limits.deflection - 0.03 * 65.0_f64.sqrt()).abs() < 1e-12,
        "{limits:?}"
    );
    let w = Vector3::new(0.0, limits.rate, 0.0);
    let hub = Vector3::new(1.2, 0.0, 0.0);
    let [first, second] = [false, true].map(|o| panel(o).spin_frequencies(&w, &hub).unwrap()[0]);
    assert!(
        (1.0 - first / second - 0.00715).abs() < 1e-4,
        "{first} {second}"
    );
}
