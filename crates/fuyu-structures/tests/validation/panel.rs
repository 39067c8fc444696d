//! The solar panel: finite elements against closed forms, and both against independent values.

use fuyu_structures::{Beam, Cantilever, End, QuadraticRod, Shaft};
use nalgebra::{DMatrix, Matrix6, Vector3};

use crate::support::{fixture, matrix, numbers, panel, strip, worst};

const TAU: f64 = std::f64::consts::TAU;

// Acceptance: 32 elements, frequencies of b1, b2, b3 to 1e-7, 1e-6, 5e-6, coupling to 1e-7; the error falls with h^4. A wrong entry of an
// element matrix changes the rate, not only the error.
#[test]
fn finite_elements_converge_with_the_fourth_power_to_the_closed_form() {
    let exact = panel(false);
    let (exact_w, exact_P) = (exact.frequencies().unwrap(), exact.coupling());
    let mut last: Option<Vec<f64>> = None;
    for elements in [4, 8, 16, 32] {
        let fem = strip(false).finite_elements("panel", elements).unwrap();
        let w = fem.frequencies().unwrap();
        // Ascending: b1, t1, b2, b3.
        let errors: Vec<f64> = (0..4).map(|k| (w[k] / exact_w[k] - 1.0).abs()).collect();
        let P_error = (fem.coupling() - &exact_P).amax() / exact_P.amax();
        println!("{elements} elements: frequencies {errors:?}, P {P_error:.2e}");
        if let Some(last) = last {
            for (k, (before, now)) in last.iter().zip(&errors).enumerate() {
                let rate = (before / now).log2();
                println!("  rate {k} {rate:.3}");
                // A mesh must resolve a mode before its error follows h^4. At 32 elements the error of b1 is 8e-9, of which rounding
                // is some 1e-10.
                if elements >= 16 {
                    let limit = if elements == 16 { 0.15 } else { 0.06 };
                    assert!(
                        (rate - 4.0).abs() < limit,
                        "mode {k} at {elements} elements: h^{rate}"
                    );
                }
            }
        }
        if elements == 32 {
            for (error, limit) in errors.iter().zip([1e-7, 1e-7, 1e-6, 5e-6]) {
                assert!(error < &limit, "{error:e}");
            }
            let relative = exact_P.zip_map(&fem.coupling(), |a, b| {
                if a.abs() > 1e-9 {
                    (b / a - 1.0).abs()
                } else {
                    b.abs()
                }
            });
            assert!(relative.amax() < 1e-7, "{:e}", relative.amax());
        }
        last = Some(errors);
    }
}

#[test]
fn closed_forms_agree_with_the_independent_values() {
    let expected = fixture("flexible_panels_linear");
    let beam = Cantilever::new(8.0, 6.0, 3000.0).unwrap();
    let shaft = Shaft::new(8.0, 2.0, 800.0).unwrap();
    let six = |f: &dyn Fn(usize) -> f64| (0..6).map(f).collect::<Vec<_>>();
    let checks = [
        (
            six(&|k| beam.frequency(k) / TAU),
            "exact_first_six_bending_hz",
        ),
        (six(&|k| beam.integral(k)), "exact_int_phi_six"),
        (six(&|k| beam.first_moment(k)), "exact_int_s_phi_six"),
        (
            six(&|k| beam.effective_mass_fraction(k)),
            "effective_mass_fraction",
        ),
        (six(&|k| beam.modal_centre(k)), "modal_centre_over_L"),
        (
            (0..3).map(|k| shaft.frequency(k) / TAU).collect(),
            "exact_three_torsion_hz",
        ),
    ];
    for (found, name) in checks {
        // The file's sixth values have errors of some 1e-12 from cosh - sinh.
        let error = worst(&found, &numbers(&expected[name]));
        println!("{name}: {error:.1e}");
        assert!(error < 1e-11, "{name}: {error:e}");
    }
    assert!((beam.shape(0, 8.0).value - 2.0 / 48.0_f64.sqrt()).abs() < 1e-14);
    assert!((shaft.shape(0, 8.0).0 - 2.0_f64.sqrt() / 4.0).abs() < 1e-14);
}

#[test]
fn the_panel_has_the_independent_mass_properties_and_couplings() {
    let expected = fixture("flexible_panels_linear");
    let panel = panel(false);
    let P = matrix(&expected["P_attachment"]);
    let error = (panel.coupling() - &P).amax();
    println!("P {error:.1e}");
    assert!(error < 1e-11, "{}", panel.coupling());
    let inertia = matrix(&expected["inertia_attachment"]);
    let found = panel.invariants.inertia();
    assert!(
        (found - nalgebra::Matrix3::from_fn(|i, j| inertia[(i, j)])).amax() < 1e-9,
        "{found}"
    );
    assert!((panel.invariants.mass() - 48.0).abs() < 1e-12);
    assert!((panel.invariants.first(0) - Vector3::new(192.0, 0.0, 0.0)).amax() < 1e-11);
    let hz: Vec<f64> = (0..4)
        .map(|k| panel.modal_stiffness[(k, k)].sqrt() / TAU)
        .collect();
    assert!(worst(&hz, &numbers(&expected["frequencies_hz"])) < 1e-12);
    // Modal masses by quadrature are those of the normalisation.
    let trace = DMatrix::from_fn(4, 4, |k, l| panel.invariants.second(1 + k, 1 + l).trace());
    assert!((trace - DMatrix::identity(4, 4)).amax() < 1e-12);
    let tip = &panel.outputs[0];
    for (k, value) in numbers(&expected["mode_tip_value"]).into_iter().enumerate() {
        assert!(
            (tip.translation[k].z - value).abs() < 1e-11,
            "sign convention: positive at the tip"
        );
    }
    assert!((tip.rotation[3].x - 0.353_553_390_593_273_8).abs() < 1e-14);
}

#[test]
fn finite_elements_agree_with_an_independent_code() {
    let expected = fixture("flexible_panels_linear");
    for elements in [4_usize, 8, 16, 32] {
        let reference = &expected["fem"][elements.to_string()];
        let fem = strip(false).finite_elements("panel", elements).unwrap();
        let w: Vec<f64> = (0..3).map(|k| fem.modal_stiffness[(k, k)].sqrt()).collect();
        let P = fem.coupling();
        let column = |j: usize, sign: f64| (0..3).map(|k| sign * P[(k, j)]).collect::<Vec<_>>();
        let errors = [
            worst(&w, &numbers(&reference["w_bend"])),
            worst(&column(2, 1.0), &numbers(&reference["int_phi"])),
            worst(&column(4, -1.0), &numbers(&reference["int_s_phi"])),
            worst(
                &[fem.modal_stiffness[(3, 3)].sqrt()],
                &numbers(&reference["w_tors"]),
            ),
            worst(&[P[(3, 3)]], &numbers(&reference["int_y2_theta"])),
        ];
        println!("{elements}: {errors:?}");
        // Rounding of the stiffness grows with the fourth power of the number of elements.
        let rounding = 1e-15 * (elements as f64).powi(4);
        assert!(
            errors[..3].iter().all(|e| *e < rounding.max(1e-11)),
            "{elements}: {errors:?}"
        );
        assert!(
            errors[3..].iter().all(|e| *e < 1e-12),
            "{elements}: {errors:?}"
        );
    }
}

// Closed forms of other ends than clamped and free: βL of Blevins 1979, table 8-1.
#[test]
fn beams_with_other_ends_have_the_frequencies_of_the_closed_forms() {
    let beam = Beam::uniform(2.0, 3.0, 5.0, 24);
    let pi = std::f64::consts::PI;
    for (root, tip, beta, rigid) in [
        (End::Pinned, End::Pinned, [pi, 2.0 * pi], 0),
        (
            End::Clamped,
            End::Clamped,
            [4.730_040_744_862_704, 7.853_204_624_095_838],
            0,
        ),
        (
            End::Clamped,
            End::Pinned,
            [3.926_602_312_047_919, 7.068_582_745_628_732],
            0,
        ),
        (
            End::Clamped,
            End::Guided,
            [2.365_020_372_431_352, 5.497_803_919_000_836],
            0,
        ),
        (
            End::Free,
            End::Free,
            [4.730_040_744_862_704, 7.853_204_624_095_838],
            2,
        ),
        (
            End::Free,
            End::Pinned,
            [3.926_602_312_047_919, 7.068_582_745_628_732],
            1,
        ),
    ] {
        let modes = beam.modes(root, tip, 2 + rigid).unwrap();
        for k in 0..rigid {
            assert_eq!(modes.frequencies[k], 0.0, "{root:?} {tip:?}");
        }
        for (k, beta) in beta.into_iter().enumerate() {
            let exact = (beta / 2.0).powi(2) * (5.0_f64 / 3.0).sqrt();
            let error = (modes.frequencies[rigid + k] / exact - 1.0).abs();
            assert!(error < 1e-5, "{root:?} {tip:?} {k}: {error:e}");
        }
    }
}

// A cantilever with a tip mass m_t: 1 + cos z cosh z + μ z (cos z sinh z - sin z cosh z) = 0 with μ = m_t/(m L), from the boundary
// conditions. Fails if bodies at nodes do not enter the mass matrix.
#[test]
fn a_tip_mass_lowers_the_frequency_as_the_characteristic_equation_says() {
    let mut beam = Beam::uniform(2.0, 3.0, 5.0, 24);
    beam.bodies.push(fuyu_structures::NodeBody {
        node: 24,
        mass: 3.0,
        inertia: 0.0,
    });
    let equation =
        |z: f64| 1.0 + z.cos() * z.cosh() + 0.5 * z * (z.cos() * z.sinh() - z.sin() * z.cosh());
    let (mut low, mut high) = (0.5, 1.875);
    for _ in 0..60 {
        let z = (low + high) / 2.0;
        if equation(z) > 0.0 { low = z } else { high = z }
    }
    let exact = (low / 2.0_f64).powi(2) * (5.0_f64 / 3.0).sqrt();
    let found = beam.modes(End::Clamped, End::Free, 1).unwrap().frequencies[0];
    assert!((found / exact - 1.0).abs() < 1e-8, "{found} {exact}");
}

#[test]
fn torsion_elements_converge_with_the_fourth_power() {
    let error = |elements| {
        let rod = QuadraticRod {
            length: 8.0,
            mass_per_length: 2.0,
            stiffness: 800.0,
            elements,
        };
        let exact = Shaft::new(8.0, 2.0, 800.0).unwrap();
        rod.modes(2).unwrap().frequencies[1] / exact.frequency(1) - 1.0
    };
    let rate = (error(8) / error(16)).log2();
    assert!((rate - 4.0).abs() < 0.05, "{rate}");
}

#[test]
fn impossible_panels_are_rejected_with_field_and_value() {
    let mut wrong = strip(false);
    wrong.EI = -3.0;
    let message = wrong.appendage("panel").unwrap_err().to_string();
    assert_eq!(message, "EI [N m²] is -3; it must be positive");
    let mut wrong = strip(false);
    wrong.length = f64::NAN;
    assert!(
        wrong
            .appendage("panel")
            .unwrap_err()
            .to_string()
            .contains("length [m] is NaN")
    );
    let mut wrong = strip(false);
    wrong.bending_modes = 13;
    let message = wrong.appendage("panel").unwrap_err().to_string();
    assert_eq!(message, "bending_modes is 13; it must be from 0 to 12");
}

// The modes of the panel carry up to 61 % of its mass along z. With half the modal mass it is 123 %, which no body has.
#[test]
fn modes_that_move_more_mass_than_the_body_has_are_rejected() {
    let mut panel = panel(true);
    panel.check_coupled_mass(&Matrix6::zeros()).unwrap();
    panel.modal_mass *= 0.5;
    let problem = panel
        .check_coupled_mass(&Matrix6::zeros())
        .unwrap_err()
        .to_string();
    assert!(
        problem.contains("mass matrix of body and modes together is not positive semidefinite"),
        "{problem}"
    );
    // A carrier can have the missing mass.
    let carrier = Matrix6::from_diagonal_element(2000.0);
    panel.check_coupled_mass(&carrier).unwrap();
}

// The outline of viewers: edges clamped at the root, and at the tip the output points of the engine.
#[test]
fn the_outline_bends_and_twists_with_the_panel() {
    let panel = panel(false);
    let outline = strip(false).outline(8).unwrap();
    assert!(outline.is_surface && outline.points.len() == 18);
    let mu = [0.3, -0.05, 0.01, 0.2];
    let points = outline.deformed(&mu);
    assert_eq!(points[0], Vector3::new(0.0, 1.0, 0.0));
    assert_eq!(points[17], Vector3::new(0.0, -1.0, 0.0));
    for (point, name) in [(points[8], "tip_left"), (points[9], "tip_right")] {
        let tip = panel.outputs.iter().find(|o| o.name == name).unwrap();
        let expected = tip.position + tip.displacement(&mu);
        assert!((point - expected).norm() < 1e-12, "{point} {expected}");
    }
    // Halfway by the closed forms, twist times half the width.
    let bending = Cantilever::new(8.0, 6.0, 3000.0).unwrap();
    let torsion = Shaft::new(8.0, 2.0, 800.0).unwrap();
    let w: f64 = (0..3).map(|k| mu[k] * bending.shape(k, 4.0).value).sum();
    let twist = mu[3] * torsion.shape(0, 4.0).0;
    assert!((points[4] - Vector3::new(4.0, 1.0, w + twist)).norm() < 1e-12);
    assert!((points[13] - Vector3::new(4.0, -1.0, w - twist)).norm() < 1e-12);
}
