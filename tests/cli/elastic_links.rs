//! Elastic links in scenarios: frequencies and a motion against an independent program, and wrong input.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
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
    format!(
        "dynamics:\n  ros__parameters:\n    urdf: robot.urdf\n    initial_joint_positions: [0.3, 0.8, -1.4, 0.6, 0.4, 0.0]\n    integrator: dop8\n    time_step: 0.005\n    state_rate: 100.0\n    duration: 10.0\n    links:\n{}{}{lines}",
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

// Ten seconds under the fixtures' efforts: joints, attitude, tip, and energy. The tip sags by .75 mm at most, so rigid links would be
// three orders of magnitude outside.
#[test]
fn an_arm_with_elastic_links_moves_as_in_the_independent_run() {
    let fixture: Value = serde_json::from_str(BEAM).unwrap();
    let fixture = &fixture["flexible_links"]["run"];
    let scenario = scenario(0, &of_joints(1.0));
    let report = run("simulate", &scenario, &damped(), &["--json"]).json();
    let found = &report["final"];
    let last = |key: &str| numbers(fixture[key].as_array().unwrap().last().unwrap());
    let names = (1..=6).map(|j| format!("joint{j}"));
    let q: Vec<f64> = names.map(|name| found["q"][&name].as_f64().unwrap()).collect();
    let joints = difference(&q, &last("q"));
    let attitude = difference(&numbers(&found["base_orientation"]), &last("quat"));
    println!("joints {joints:.1e}, attitude {attitude:.1e}");
    assert!(joints < 1e-7 && attitude < 1e-8, "{joints:e} {attitude:e}");
    // The deflection of link 2 in its two planes, from the same coordinates.
    let mu = numbers(&found["appendages"]["link2"]["mu"]);
    assert!(mu[0].abs() + mu[2].abs() > 1e-5, "{mu:?}");
    assert!(report["momentum_residual"]["angular"].as_f64().unwrap() < 1e-12);
    assert!(report["energy_residual"].as_f64().unwrap() < 1e-9);
}

// The frame of an elastic link is at its tip: with a static deflection of its tip by 2 cm at rest, the frames that follow move by so
// much. There is no frame of an attachment with the link's name.
#[test]
fn frames_after_an_elastic_link_move_with_its_tip() {
    let folder = tempfile::tempdir().unwrap();
    let tip_of = |deflection: f64| {
        let start = format!("        initial_mu: [0.0, 0.0, {deflection:?}, 0.0]\n");
        let text = with(
            &scenario(0, ""),
            "        clamped_modes: 0\n      link3",
            &format!("        clamped_modes: 0\n{start}      link3"),
        );
        let name = format!("bag{deflection}");
        let bag = folder.path().join(name);
        let bag = bag.to_str().unwrap();
        let options = ["--json", "--duration", "0.01", "--output", bag];
        let report = run("simulate", &text, SERVICER, &options);
        assert_eq!(report.code, 0, "{}", report.stderr);
        let tf = fuyu::bag::BagReader::open(std::path::Path::new(bag));
        drop(tf);
        report.json()
    };
    let (straight, bent) = (tip_of(0.0), tip_of(0.02));
    let strain = |report: &Value| report["final"]["strain_energy"].as_f64().unwrap();
    // A tip displacement without slope stores 6 EI w^2 / L^3, less what has become motion in 10 ms.
    let stored = 6.0 * 2e5 * 0.02_f64.powi(2) / 2.5_f64.powi(3);
    println!("{} {} of {stored} J", strain(&straight), strain(&bent));
    assert!(strain(&straight) < 1e-12);
    assert!((strain(&bent) / stored - 1.0).abs() < 0.2);
}
