//! The air table of Kida 1993 section 3.4: hybrid model, designs 1 to 5. Fixture `flexible_airtable.json`: computed in Python (SciPy, refined Riccati solutions), nothing of which is used here.

use crate::support::*;
use fuyu_lti::kida1993::air_table::{
    FREQUENCIES_HZ, SHAPES, TORQUE_LIMIT, hybrid, structure, table_3_1,
};
use fuyu_lti::kida1993::designs::{DESIGNS, Design, design, filter_change};
use serde_json::Value;

// A wrong sign or order of the modes, or a damping matrix transformed with the wrong basis, shows in the tenth digit and above.
#[test]
fn the_air_table_is_a_base_with_one_appendage() {
    let want = &fixture("flexible_airtable")["hybrid"];
    let model = hybrid().unwrap();
    assert_close("J", model.inertia, number(&want["J"]), 1e-12);
    for (i, (f, p)) in list(&want["constrained_hz"])
        .into_iter()
        .zip(list(&want["coupling_p"]))
        .enumerate()
    {
        assert_close(
            "constrained frequency",
            model.constrained_hz[i],
            f,
            1e-12 * f,
        );
        assert_close("coupling", model.coupling[i], p, 1e-11 * p.max(0.1));
    }
    assert!(relative(&model.damping, &matrix(&want["damping_matrix"])) < 1e-11);
}

#[test]
fn the_hybrid_model_has_the_modes_of_table_3_1() {
    let rows = table_3_1(&hybrid().unwrap()).unwrap();
    for (i, row) in rows.iter().enumerate() {
        assert_close(
            "frequency",
            row.frequency_hz,
            FREQUENCIES_HZ[i],
            1e-12 * FREQUENCIES_HZ[i],
        );
        assert_close("shape", row.shape, SHAPES[i], 1e-12);
    }
    // The constrained frequencies are the zeros of the transfer function from torque to angle (Theorem 2.4): another algorithm.
    let undamped = fuyu_lti::Structure::new(
        structure(7).unwrap().mass().clone(),
        fuyu_lti::Matrix::zeros(7, 7),
        structure(7).unwrap().stiffness().clone(),
        structure(7).unwrap().input().clone(),
    )
    .unwrap();
    let mut zeros: Vec<f64> = undamped
        .displacement_system()
        .unwrap()
        .zeros()
        .unwrap()
        .iter()
        .filter(|z| z.im > 0.0)
        .map(|z| z.im / std::f64::consts::TAU)
        .collect();
    zeros.sort_by(f64::total_cmp);
    assert_eq!(zeros.len(), 6);
    for (z, f) in zeros.iter().zip(hybrid().unwrap().constrained_hz) {
        assert_close("zero", *z, f, 1e-9 * f);
    }
}

fn five() -> Vec<(Design, Value)> {
    let all = fixture("flexible_airtable");
    DESIGNS
        .iter()
        .enumerate()
        .map(|(i, c)| (design(c).unwrap(), all[format!("design{}", i + 1)].clone()))
        .collect()
}

// SciPy's unrefined solver is wrong by 3e-8 in design 4's observer, so a missing Newton step fails here.
#[test]
fn gains_of_designs_1_to_5() {
    for (d, want) in five() {
        let name = d.config.name;
        let difference = |got: &fuyu_lti::Matrix, key: &str| {
            let e = relative(got, &matrix(&want[key]));
            println!("{name} {key}: {e:.1e}");
            assert!(e < 1e-9, "{name} {key}: {e:e}");
        };
        difference(&d.gain, "K");
        difference(&d.observer_gain, "L");
        difference(&d.compensator.a, "F");
        difference(&d.compensator.b, "G");
        difference(&d.compensator.c, "H");
        if d.config.shaping.is_some() {
            difference(&d.filter_gain, "K0");
        }
        println!("{name} residual {:.1e}", d.residual);
        assert!(d.residual < 1e-12, "{name}: {:e}", d.residual);
    }
}

#[test]
fn verdicts_on_the_seven_mode_plant() {
    let printed = [0.124, -0.041, -0.121, -0.025, -0.114];
    for ((d, want), printed) in five().into_iter().zip(printed) {
        let name = d.config.name;
        assert_close(name, d.largest_real_part, number(&want["max_re"]), 1e-8);
        assert_close(name, d.largest_real_part, printed, 6e-4);
        assert_eq!(
            d.largest_real_part < 0.0,
            d.config.stable_in_thesis,
            "{name}"
        );
        // Every pole, relative to the fastest.
        let worst = matched(&d.poles, &complex_list(&want["eig"]));
        println!(
            "{name}: largest real part {:.10}, poles differ by {worst:.1e}",
            d.largest_real_part
        );
        assert!(worst < 1e-6, "{name}: {worst:e}");
        // Theorem 3.5: the design model is stable, also where the plant is not.
        assert!(d.nominal_poles.iter().all(|p| p.re < 0.0), "{name}");
    }
    // Design 1 is unstable at the first vibration mode: spillover.
    let unstable = five()[0]
        .0
        .poles
        .iter()
        .find(|p| p.re > 0.0)
        .unwrap()
        .im
        .abs()
        / std::f64::consts::TAU;
    assert_close("frequency of the instability in Hz", unstable, 1.168, 1e-3);
}

#[test]
fn margins_of_designs_1_to_5() {
    for (d, want) in five() {
        let name = d.config.name;
        let want = &want["margins"];
        let gain = d.margins.gain.iter().map(|g| (g.frequency, g.decibel));
        assert_crossovers(
            name,
            phase_margins(&d.margins),
            &want["phase"],
            |w| 1e-6 * w,
            0.01,
        );
        assert_crossovers(name, gain, &want["gain"], |w| 1e-6 * w, 1e-3);
        let m = number(&want["min_return_difference"]);
        assert_close(name, d.margins.min_return_difference, m, 1e-4);
    }
}

// Without the hold's exact discretisation or with the limit after the wrong sample the curves part within a second.
#[test]
fn step_responses_of_the_sampled_designs() {
    for (d, want) in five() {
        for (key, limit) in [
            ("step_errorfeedback_satNone", f64::INFINITY),
            ("step_errorfeedback_sat0.37", TORQUE_LIMIT),
        ] {
            let angle = list(&want[key]["theta_deg"]);
            let torque = list(&want[key]["torque"]);
            let run = d.step(0.5 * (angle.len() - 1) as f64, limit).unwrap();
            let mut worst = (0.0_f64, 0.0_f64);
            for i in 0..angle.len() {
                worst.0 = worst
                    .0
                    .max((run.output[50 * i][0].to_degrees() - angle[i]).abs());
                worst.1 = worst.1.max((run.command[50 * i][0] - torque[i]).abs());
            }
            println!(
                "{} {key}: {:.1e} deg, {:.1e} N m",
                d.config.name, worst.0, worst.1
            );
            assert!(
                worst.0 < 1e-6 && worst.1 < 1e-6,
                "{} {key}: {worst:?}",
                d.config.name
            );
        }
    }
}

// Theorem 3.3: the feedback raises the filter's cut-off and brings its damping ratio closer to 1/sqrt 2.
#[test]
fn theorem_3_3_on_designs_2_to_5() {
    for (d, _) in five() {
        let Some(change) = filter_change(&d) else {
            continue;
        };
        assert!(change.realized.0 > change.designed.0);
        let limit = std::f64::consts::FRAC_1_SQRT_2;
        assert!(change.designed.1 < change.realized.1 && change.realized.1 < limit);
        // The relation in the proof (appendix 3B).
        let left = change.realized.1.powi(2) - 0.5;
        let right = (change.designed.1.powi(2) - 0.5) / (1.0 + d.filter_gain[(0, 0)]);
        assert_close("damping", left, right, 1e-12);
    }
}
