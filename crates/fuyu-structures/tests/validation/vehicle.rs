//! The servicer with two panels: frequencies, poles and zeros in three postures and at two panel angles.

use fuyu_structures::{Attachment, Vehicle, frequencies_hz, kida1993};
use nalgebra::DMatrix;
use serde_json::Value;

use crate::{
    servicer::{attachments, locked, with_panels},
    support::{fixture, matrix, numbers, panel, roots, upper, worst, worst_root},
};

/// Calls `check` for each panel angle and posture of the fixture.
fn every_case(mut check: impl FnMut(f64, &str, &Value)) {
    let expected = fixture("flexible_panels_linear");
    for alpha in ["0.0", "0.6"] {
        for posture in ["A", "B", "C"] {
            check(
                alpha.parse().unwrap(),
                posture,
                &expected["linear"][alpha][posture],
            );
        }
    }
}

/// Attachments with the first six columns: joints locked.
fn on_locked<'a>(list: &[Attachment<'a>]) -> Vec<Attachment<'a>> {
    let part = |a: &Attachment<'a>| Attachment {
        appendage: a.appendage,
        jacobian: a.jacobian.columns(0, 6).into_owned(),
    };
    list.iter().map(part).collect()
}

// Acceptance: base-free frequencies and zeros to 1e-8, N^c to 1e-12. The mass matrix of the file is an input here; the next test computes it.
#[test]
fn frequencies_poles_and_zeros_agree_with_independent_values() {
    let panel = panel(false);
    let mut largest = [0.0_f64; 6];
    every_case(|alpha, posture, expected| {
        let M = matrix(&expected["mass_matrix_base"]);
        let panels = on_locked(&attachments(&panel, alpha));
        let vehicle = Vehicle::new(M.clone(), &panels).unwrap();
        let P = matrix(&expected["P_base"]);
        let coupling = panels.iter().map(|a| a.appendage.coupling() * &a.jacobian);
        let stacked = DMatrix::from_fn(8, 6, |k, j| {
            coupling.clone().nth(k / 4).unwrap()[(k % 4, j)]
        });
        assert!((&stacked - &P).amax() < 1e-8, "{alpha} {posture}");
        // N^c = I - P M_b⁻¹ Pᵀ by another path: the inverse of the modal block of the inverse of the whole mass matrix.
        let [whole, ..] = vehicle.hybrid().matrices();
        let inverse = whole
            .try_inverse()
            .unwrap()
            .view((6, 6), (8, 8))
            .into_owned();
        let identity = (vehicle.hybrid().N_c().unwrap() * inverse - DMatrix::identity(8, 8)).amax();
        assert!(identity < 1e-12, "{alpha} {posture}: {identity:e}");
        largest[0] = largest[0].max(identity);

        let mut check = |place: usize, error: f64, what: &str| {
            assert!(error < 1e-8, "{alpha} {posture} {what}: {error:e}");
            largest[place] = largest[place].max(error);
        };
        let frequencies = numbers(&expected["frequencies_locked_hz"]);
        check(
            1,
            worst(&vehicle.frequencies_hz().unwrap(), &frequencies),
            "frequencies",
        );
        check(
            2,
            worst_root(
                &upper(&vehicle.poles().unwrap()),
                &roots(&expected["poles_locked"]),
            ),
            "poles",
        );
        let zeros = upper(&vehicle.attitude_zeros().unwrap());
        check(
            3,
            worst_root(&zeros, &roots(&expected["zeros_torque3_to_attitude3"])),
            "3 x 3 zeros",
        );
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            let zeros = upper(&vehicle.axis_zeros(axis).unwrap());
            check(
                4,
                worst_root(&zeros, &roots(&expected["zeros_siso"][name])),
                name,
            );
        }
    });
    println!("N^c, frequencies, poles, 3 x 3 zeros, single-axis zeros: {largest:?}");
}

#[test]
fn mass_matrices_and_frequencies_with_free_joints_agree_with_independent_values() {
    let panel = panel(false);
    let mut largest = [0.0_f64; 2];
    every_case(|alpha, posture, expected| {
        let q = numbers(&expected["q"]);
        let panels = attachments(&panel, alpha);
        let M = with_panels(&q, &panels);
        let base = matrix(&expected["mass_matrix_base"]);
        let difference = (locked(&M) - &base).amax() / base.amax();
        assert!(difference < 1e-13, "{alpha} {posture}: {difference:e}");
        let vehicle = Vehicle::new(M, &panels).unwrap();
        let error = worst(
            &vehicle.frequencies_hz().unwrap(),
            &numbers(&expected["frequencies_free_joints_hz"]),
        );
        assert!(error < 1e-8, "{alpha} {posture}: {error:e}");
        largest = [largest[0].max(difference), largest[1].max(error)];
    });
    println!("mass matrix, frequencies with free joints: {largest:?}");
}

// Acceptance: the 3 x 3 zeros are equal in every posture, and the 6 x 6 ones are the cantilever's poles, to 1e-10. They would not be if
// the moment of inertia or the joints entered.
#[test]
fn zeros_from_torques_to_attitude_do_not_move_with_the_posture() {
    let panel = panel(false);
    let mut all = Vec::new();
    every_case(|alpha, _, expected| {
        let panels = attachments(&panel, alpha);
        let M = with_panels(&numbers(&expected["q"]), &panels);
        let vehicle = Vehicle::new(locked(&M), &on_locked(&panels)).unwrap();
        all.push((
            vehicle.attitude_zeros().unwrap(),
            vehicle.wrench_zeros().unwrap(),
        ));
    });
    let cantilever: Vec<f64> = (0..4)
        .flat_map(|k| [panel.modal_stiffness[(k, k)].sqrt() / std::f64::consts::TAU; 2])
        .collect();
    let mut sorted = cantilever.clone();
    sorted.sort_by(f64::total_cmp);
    let mut largest = [0.0_f64; 2];
    for (attitude, wrench) in &all {
        let error = worst_root(&upper(attitude), &upper(&all[0].0));
        assert!(error < 1e-10, "{error:e}");
        let clamped = worst(&frequencies_hz(wrench), &sorted);
        assert!(clamped < 1e-10, "{clamped:e}");
        assert!(
            wrench
                .iter()
                .all(|s| (s.re / s.norm() + 0.005).abs() < 1e-10),
            "damping ratio .005: {wrench:?}"
        );
        largest = [largest[0].max(error), largest[1].max(clamped)];
    }
    println!(
        "3 x 3 zeros between postures {:.1e}, 6 x 6 zeros against the cantilever {:.1e}",
        largest[0], largest[1]
    );
    // The first of the 3 x 3 zeros is that of one panel, the second one higher: translation is free.
    let hz = frequencies_hz(&all[0].0);
    for (found, expected) in hz.iter().zip([
        0.195513, 0.198138, 0.625, 0.625, 1.225260, 1.230379, 3.430763, 3.435717,
    ]) {
        assert!((found - expected).abs() < 1e-6, "{hz:?}");
    }
}

// Collocated position and rate feedback. The wheels turn freely under their motors, so their inertia is not part of the base's.
#[test]
fn attitude_feedback_has_the_independent_closed_loop_poles() {
    let panel = panel(false);
    let expected = fixture("flexible_dvdfb");
    let linear = fixture("flexible_panels_linear");
    for posture in ["A", "B", "C"] {
        let mut M = matrix(&linear["linear"]["0.0"][posture]["mass_matrix_base"]);
        (3..6).for_each(|i| M[(i, i)] -= 0.2);
        let vehicle = Vehicle::new(M, &on_locked(&attachments(&panel, 0.0))).unwrap();
        let (P, D) = (matrix(&expected["P"]), matrix(&expected["D"]));
        let poles = vehicle.attitude_feedback_poles(&P, &D).unwrap();
        assert_eq!(poles.len(), 22);
        let listed: Vec<_> = poles.iter().copied().filter(|s| s.im >= 0.0).collect();
        let error = worst_root(&listed, &roots(&expected[posture]["poles"]));
        println!("{posture}: {error:.1e}");
        assert!(error < 1e-8, "{posture}: {error:e}");
        let largest = poles.iter().map(|s| s.re).fold(f64::NEG_INFINITY, f64::max);
        assert!((largest - expected[posture]["max_re"].as_f64().unwrap()).abs() < 1e-9);
    }
}

// Acceptance: the air table as a base with one appendage reproduces Table 3.1 to 1e-12.
#[test]
fn the_air_table_is_a_base_with_one_appendage() {
    let table = kida1993::air_table();
    let expected = &fixture("flexible_airtable")["hybrid"];
    assert!((table.inertia - expected["J"].as_f64().unwrap()).abs() < 1e-12 * table.inertia);
    assert!(worst(&table.constrained_hz, &numbers(&expected["constrained_hz"])) < 1e-12);
    assert!(
        worst(&table.coupling, &numbers(&expected["coupling_p"])) < 1e-9,
        "{:?}",
        table.coupling
    );
    let damping = matrix(&expected["damping_matrix"]);
    let found = DMatrix::from_fn(7, 7, |i, j| table.damping[i][j]);
    // The file's signs of the constrained modes are its own: compare magnitudes.
    let difference = found.abs() - damping.abs();
    assert!(difference.amax() < 1e-10, "{found}{damping}");

    // A base that turns about z, with everything else so heavy that it stays.
    let appendage = table.appendage().unwrap();
    let mut M = DMatrix::from_diagonal_element(6, 6, 1e3);
    M[(5, 5)] = table.inertia;
    let on_base = Attachment::on_base(
        &appendage,
        &nalgebra::Rotation3::identity(),
        &nalgebra::Vector3::new(0.3, 0.0, 0.0),
        6,
    );
    let vehicle = Vehicle::new(M, &[on_base]).unwrap();
    let hz = vehicle.frequencies_hz().unwrap();
    let error = worst(&hz, &table.frequencies_hz[1..]);
    let modes = vehicle.hybrid().unconstrained().unwrap();
    let shapes: Vec<f64> = (0..6).map(|k| modes.Phi_2[(5, k)].abs()).collect();
    let printed: Vec<f64> = table.shapes[1..].iter().map(|v| v.abs()).collect();
    let shape_error = shapes
        .iter()
        .zip(&printed)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    println!("frequencies {error:.1e}, shapes {shape_error:.1e}");
    assert!(
        error < 1e-12 && shape_error < 1e-12,
        "{error:e} {shape_error:e}"
    );
    assert!((modes.Phi_1[(5, 5)].abs() - table.shapes[0]).abs() < 1e-12);
    // Every unconstrained mode has the printed damping ratio, with the full matrix only.
    for k in 0..6 {
        let ratio = modes.damping[(k, k)] / (2.0 * modes.frequencies[k]);
        assert!((ratio - 0.005).abs() < 1e-12, "{ratio}");
    }
}

#[test]
fn a_mass_matrix_without_the_panels_is_rejected() {
    let panel = panel(false);
    let panels = on_locked(&attachments(&panel, 0.0));
    let error = Vehicle::new(DMatrix::from_diagonal_element(6, 6, 30.0), &panels)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("J must include the undeformed flexible parts"),
        "{error}"
    );
    let error = Vehicle::new(DMatrix::identity(4, 4), &panels)
        .unwrap_err()
        .to_string();
    assert!(error.contains("must be from 6 to"), "{error}");
    let M = DMatrix::from_diagonal_element(7, 7, 1e4);
    let error = Vehicle::new(M, &panels).unwrap_err().to_string();
    assert_eq!(
        error,
        "panel, jacobian of the attachment has 6 x 6 entries; it must have 6 x 7"
    );
}
