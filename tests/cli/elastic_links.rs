//! Elastic links in scenarios: frequencies and a motion against an independent program, and wrong input.

use serde_json::Value;

use super::excitations::of_joints;
use super::flexible::{POSTURES, SERVICER, damped, difference, numbers, run, with};

const BEAM: &str =
    include_str!("../../crates/fuyu-physics/tests/flexible/fixtures/flexible_beam.json");

/// The servicer with links 2 and 3 as beams with this many modes in addition to the static shapes.
fn scenario(clamped_modes: usize, lines: &str) -> String {
    let link = |name: &str| {
        format!(
            "      {name}:\n        length: 2.5\n        linear_mass: 20.0\n        EI: 2.0e5\n        radius_of_gyration: 0.07071\n        clamped_modes: {clamped_modes}\n"
        )
    };
    // Clamped modes are at 500 Hz.
    let step = if clamped_modes == 0 { 0.005 } else { 0.001 };
    format!(
        "dynamics:\n  ros__parameters:\n    urdf: robot.urdf\n    initial_joint_positions: [0.3, 0.8, -1.4, 0.6, 0.4, 0.0]\n    integrator: dop8\n    time_step: {step}\n    state_rate: 100.0\n    duration: 10.0\n    links:\n{}{}{lines}",
        link("link2"),
        link("link3")
    )
}

// Three postures, base free. With four functions in each plane they are converged to 1e-5.
#[test]
fn frequencies_with_elastic_links_are_those_of_the_independent_program() {
    let fixture: Value = serde_json::from_str(BEAM).unwrap();
    let fixture = &fixture["flexible_links"];
    let [statics, four] = [scenario(0, ""), scenario(2, "")];
    for (name, q) in POSTURES {
        let named = (1..=6).map(|j| format!("joint{j}={:?}", q[j - 1]));
        let q = format!("--q={}", named.collect::<Vec<_>>().join(","));
        for (scenario, key, against) in [
            (&statics, "2+2", "2+2"),
            (&four, "4+4", "4+4"),
            (&four, "4+4", "6+6"),
        ] {
            let report = run("modes", scenario, SERVICER, &[&q, "--json"]).json();
            let expected = &fixture[format!("{name} static+Ritz {against}")]["base_free_hz"];
            let found = numbers(&report["frequencies"]);
            let relative: Vec<_> = (found.iter().zip(&numbers(expected)).take(2))
                .map(|(a, b)| a / b)
                .collect();
            let error = difference(&relative, &[1.0, 1.0]);
            println!("{name} {key} against {against}: {error:.1e}");
            assert!(error < 1e-5, "{name} {key} {against}: {error:e}");
            let modes = &report["appendages"]["link2"]["modes"];
            let count = if key == "2+2" { 4 } else { 8 };
            assert_eq!(modes.as_array().unwrap().len(), count);
        }
    }
}

// Ten seconds under the fixtures' efforts: joints, attitude, and energy.
#[test]
fn an_arm_with_elastic_links_moves_as_in_the_independent_run() {
    let fixture: Value = serde_json::from_str(BEAM).unwrap();
    let fixture = &fixture["flexible_links"]["run"];
    let scenario = scenario(0, &of_joints(1.0));
    let report = run("simulate", &scenario, &damped(), &["--json"]).json();
    let found = &report["final"];
    let last = |key: &str| numbers(fixture[key].as_array().unwrap().last().unwrap());
    let names = (1..=6).map(|j| format!("joint{j}"));
    let q: Vec<f64> = names
        .map(|name| found["q"][&name].as_f64().unwrap())
        .collect();
    let joints = difference(&q, &last("q"));
    let attitude = difference(&numbers(&found["base_orientation"]), &last("quat"));
    println!("joints {joints:.1e}, attitude {attitude:.1e}");
    assert!(joints < 1e-7 && attitude < 1e-8, "{joints:e} {attitude:e}");
    // The links bend.
    let mu = numbers(&found["appendages"]["link2"]["mu"]);
    assert!(mu[0].abs() + mu[2].abs() > 1e-5, "{mu:?}");
    assert!(report["momentum_residual"]["angular"].as_f64().unwrap() < 1e-12);
    assert!(report["energy_residual"].as_f64().unwrap() < 1e-9);
}

// A tip displacement w without slope stores 6 EI w^2 / L^3. Would break if the coordinates were scaled to unit mass, or
// in another order: a slope of .002 rad stores more.
#[test]
fn a_bent_link_begins_with_its_strain_energy() {
    let text = with(
        &scenario(0, ""),
        "        clamped_modes: 0\n      link3",
        "        clamped_modes: 0\n        initial_mu: [0.0, 0.0, 0.002, 0.0]\n      link3",
    );
    let text = with(&text, "state_rate: 100.0", "state_rate: 1000.0");
    let options = ["--json", "--duration", "0.001"];
    let report = run("simulate", &text, SERVICER, &options).json();
    let stored = 6.0 * 2e5 * 0.002_f64.powi(2) / 2.5_f64.powi(3);
    let number = |key: &str| report["final"][key].as_f64().unwrap();
    let (strain, kinetic) = (number("strain_energy"), number("kinetic_energy"));
    println!("{strain} + {kinetic} of {stored} J");
    assert!(((strain + kinetic) / stored - 1.0).abs() < 1e-6);
    assert!(strain > 0.5 * stored, "{strain} {stored}");
}

#[test]
fn wrong_elastic_links_are_refused_with_the_reason() {
    for (from, to, says) in [
        (
            "linear_mass: 20.0",
            "linear_mass: 2.0",
            "kg, but link link2 has 50.000 kg with all that is fixed to it; they must agree to 1 %",
        ),
        (
            "EI: 2.0e5",
            "EI: -2.0e5",
            "links.link2.EI of /dynamics: -200000 is out of range, expected a number above 0.0",
        ),
        (
            "      link2:",
            "      forearm:",
            "link forearm is not moved by a joint of the robot; it must be one of link1",
        ),
        (
            "        length: 2.5\n",
            "",
            "parameter links.link2.length is not given",
        ),
        (
            "clamped_modes: 0",
            "clamped_modes: 0\n        initial_mu: [0.1]",
            "links.link2.initial_mu has 1 values; the appendage has 4 modes: y_tip, y_slope, z_tip, z_slope",
        ),
        (
            "clamped_modes: 0",
            "clamped_mode: 0",
            "did you mean links.link2.clamped_modes?",
        ),
        (
            "time_step: 0.005\n    state_rate: 100.0",
            "time_step: 0.1\n    state_rate: 10.0",
            "parameter time_step is 0.1: the step of 0.1 s is above the stability limit",
        ),
    ] {
        let text = with(&scenario(0, ""), from, to);
        let run = run("simulate", &text, SERVICER, &["--duration", "0.1"]);
        assert_eq!(
            (run.code, run.stdout.as_str()),
            (2, ""),
            "{to}: {}",
            run.stderr
        );
        assert!(run.stderr.contains(says), "{to}: {}", run.stderr);
    }
}
