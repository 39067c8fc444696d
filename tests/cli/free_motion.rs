//! Scenarios without a controller: springs, closed loops, and how wrong ones are refused.

use serde_json::Value;

use super::fuyu::{file, fuyu};

fn simulated(config: &str, duration: &str) -> Value {
    fuyu(&["simulate", config, "--duration", duration, "--json"]).json()
}

fn number(run: &Value, key: &str) -> f64 {
    run[key].as_f64().unwrap_or_else(|| panic!("{key}: {run}"))
}

/// The summary of a free motion: base motion, momentum and energy, and nothing of a tip.
#[test]
fn the_chain_of_tr942_moves_by_its_springs() {
    let run = simulated("config/tr942_chain.yaml", "8");
    for key in [
        "tip_position_error",
        "tip_attitude_error",
        "time_to_1cm",
        "max_tip_speed",
        "loop_gap",
    ] {
        assert_eq!(run[key], Value::Null, "{key}");
    }
    assert_eq!(number(&run, "duration"), 8.0);
    assert!(number(&run["momentum_residual"], "angular") < 1e-13);
    assert!(number(&run, "energy_residual") < 1e-9);
    assert!(number(&run, "max_base_angular_acceleration") > 1e-3);
    // Another formulation, the same motion.
    let chain = include_str!("../../config/tr942_chain.yaml");
    let by = |formulation: &str| {
        let parameter = format!("    formulation: {formulation}\n    time_step:");
        let (folder, path) = file("chain.yaml", chain.replace("    time_step:", &parameter));
        let run = fuyu(&["simulate".as_ref(), path.as_os_str(), "--json".as_ref()]);
        drop(folder);
        run
    };
    for formulation in ["reduced", "kane", "newton_euler"] {
        let other = by(formulation).json();
        assert_ne!(other["base_displacement"], run["base_displacement"]);
        for axis in 0..3 {
            let [a, b] = [&run, &other].map(|r| r["base_displacement"][axis].as_f64().unwrap());
            assert!((a - b).abs() < 1e-10, "{formulation}: {a} {b}");
        }
    }
    let wrong = by("lagrange");
    assert!(
        wrong
            .refusal()
            .contains("'lagrange' is not one of articulated_body, reduced, kane, newton_euler")
    );

    let text = fuyu(&["simulate", "config/tr942_chain.yaml"]);
    assert_eq!(text.code, 0);
    assert!(text.stdout.contains("energy residual"));
    assert!(!text.stdout.contains("tip"), "{}", text.stdout);
}

/// Base position and attitude on the exact branch after 40 s and four passages of the singular state
/// (tests/validation/fixtures/tr942_pantograph_branch.json), and a bag whose physics holds.
#[test]
fn the_pantograph_of_tr942_unfolds_through_its_singular_states() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let bag = bag.to_str().unwrap();
    let config = "config/tr942_pantograph.yaml";
    let run = fuyu(&["simulate", config, "--json", "--output", bag]).json();
    let base: Vec<f64> = serde_json::from_value(run["base_displacement"].clone()).unwrap();
    let attitude: Vec<f64> = serde_json::from_value(run["base_attitude_rpy"].clone()).unwrap();
    assert!((base[0] + 0.3339585319793273).abs() < 1e-6, "{base:?}");
    assert!((base[1] - 0.01215617031696594).abs() < 1e-6, "{base:?}");
    assert!(
        (attitude[2] + 0.02794130806824172).abs() < 1e-6,
        "{attitude:?}"
    );
    assert!(number(&run, "loop_gap") < 1e-10);
    assert!(number(&run["momentum_residual"], "linear") < 1e-12);
    assert!(number(&run["momentum_residual"], "angular") < 1e-12);
    assert!(number(&run, "energy_residual") < 1e-6);

    // The pins need no links of their own.
    let posed = include_str!("../../config/tr942_pantograph.yaml").replace(
        "frame_a: pin6_2",
        "frame_a: body2\n      frame_a_xyz: [1.0, 0.0, 0.0]\n      frame_a_rpy: [0.0, 0.0, 0.5]",
    );
    let (_folder, path) = file("posed.yaml", posed);
    let other = fuyu(&["simulate", path.to_str().unwrap(), "--json"]).json();
    let other: Vec<f64> = serde_json::from_value(other["base_displacement"].clone()).unwrap();
    for (a, b) in base.iter().zip(&other) {
        assert!((a - b).abs() < 1e-8, "{base:?} {other:?}");
    }

    // Springs and dampers account for all of the energy: without either the balance would be off by much.
    let check = fuyu(&["bag", "check", bag, "--json"]).json();
    let lines = check["checks"].as_array();
    let energy = (lines.expect("lines").iter())
        .find(|line| line.to_string().contains("energy balance"))
        .unwrap();
    assert!(energy.to_string().contains("passed"), "{energy}");
}

/// The pantograph's scenario with the first `from` replaced must be refused with a line that says all of
/// `says`, by `simulate` and `launch` alike, before anything runs.
#[track_caller]
fn refused(from: &str, to: &str, says: &[&str]) {
    let good = include_str!("../../config/tr942_pantograph.yaml");
    assert!(good.contains(from), "the scenario has no {from}");
    let (_folder, path) = file("loop.yaml", good.replacen(from, to, 1));
    for command in ["simulate", "launch"] {
        let run = fuyu(&[command, path.to_str().unwrap()]);
        let message = run.refusal();
        for part in ["loop.yaml", "dynamics"].iter().chain(says) {
            assert!(
                message.contains(part),
                "{command}: no {part:?} in: {message}"
            );
        }
    }
}

#[test]
fn loop_closures_that_cannot_be() {
    refused(
        "frame_b: pin6_3",
        "frame_b: pin6_33",
        &["'h6'", "no link 'pin6_33'", "base_link, carriage2"],
    );
    refused(
        "frame_b: pin6_3",
        "frame_b: body2",
        &["'h6'", "same body 'body2'"],
    );
    refused(
        "      frame_b: pin6_3\n",
        "",
        &["h6.frame_b is not given", "second end"],
    );
    refused(
        "constrained: [along_x, along_y, along_z, about_x, about_y]",
        "constrained: []",
        &["'h6' constrains no direction"],
    );
    refused(
        "constrained: [along_x, along_y, along_z, about_x, about_y]",
        "constrained: [along_x, why]",
        &["h6.constrained", "'why' is not one of", "about_z"],
    );
    refused(
        "constrained: [along_x, along_y, along_z, about_x, about_y]",
        "constrained: [along_x, along_y, along_x]",
        &["h6.constrained", "'along_x' is given twice"],
    );
    refused(
        "loop_closures: [h6, h7]",
        "loop_closures: [h6, h7, h6]",
        &["loop_closures", "'h6' is given twice"],
    );
    refused(
        "1.53588974175501, -3.0717",
        "1.4, -3.0717",
        &["'h7' is open by 0.136", "up to 0.001 m"],
    );
    refused(
        "    loop_closures:",
        "    formulation: articulated_body\n    loop_closures:",
        &[
            "'articulated_body', which does not support closed loops",
            "'reduced'",
        ],
    );
    refused(
        "    loop_closures:",
        "    initial_joint_velocities: [0.0, 0.3, 0.0, 0.0, 0.0, 0.0]\n    loop_closures:",
        &["opens at 0.3", "m/s"],
    );
    refused(
        "frame_a: pin6_2",
        "frame_a: pin6_2\n      frame_a_xyz: [1.0, 0.0]",
        &["h6.frame_a_xyz", "3 finite numbers"],
    );
}

/// A robot next to its scenario, in a package, and one that needs repairs.
#[test]
fn robots_are_found_next_to_their_scenario_and_in_packages() {
    let scenario = |urdf: &str, more: &str| {
        let chain = include_str!("../../config/tr942_chain.yaml");
        let chain = chain.replace("package://fuyu/urdf/tr942_chain.urdf", urdf);
        chain.replace("    duration: 8.0\n", &format!("    duration: 0.1\n{more}"))
    };
    let (folder, path) = file("near.yaml", scenario("robots/chain.urdf", ""));
    let robots = folder.path().join("robots");
    std::fs::create_dir(&robots).unwrap();
    let chain = include_str!("../../urdf/tr942_chain.urdf");
    std::fs::write(robots.join("chain.urdf"), chain).unwrap();
    let simulate = |name: &str, text: Option<String>| {
        let path = path.with_file_name(name);
        if let Some(text) = text {
            std::fs::write(&path, text).unwrap();
        }
        fuyu(&["simulate".as_ref(), path.as_os_str(), "--json".as_ref()])
    };
    simulate("near.yaml", None).json();
    let in_package = |more: &str| scenario("package://robots/chain.urdf", more);
    let folders = format!("    package_folders: [{:?}]\n", folder.path());
    simulate("package.yaml", Some(in_package(&folders))).json();
    let lost = simulate("lost.yaml", Some(in_package("")));
    assert!(lost.refusal().contains("package://robots/chain.urdf"));

    let unknown = chain.replace("</robot>", "<loop_joint/></robot>");
    std::fs::write(robots.join("chain.urdf"), unknown).unwrap();
    let repaired = simulate("near.yaml", None);
    assert_eq!(repaired.code, 0, "{}", repaired.stderr);
    assert!(
        repaired.stderr.contains("<loop_joint> in <robot>"),
        "{}",
        repaired.stderr
    );
    let strict = scenario("robots/chain.urdf", "    strict: true\n");
    assert_eq!(
        simulate("strict.yaml", Some(strict)).code,
        0,
        "strict mode ignores it as before"
    );
    let long = chain.replacen("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 2\"/>", 1);
    assert_ne!(long, chain);
    std::fs::write(robots.join("chain.urdf"), long).unwrap();
    assert_eq!(simulate("near.yaml", None).code, 0);
    assert!(
        simulate("strict.yaml", None)
            .refusal()
            .contains("must be a unit vector")
    );
}

// Two joints run into their stops, and events say when.
#[test]
fn joints_at_their_stops_are_events() {
    let limit = r#"type="revolute"><limit lower="-1" upper="0.1" effort="5" velocity="9"/>"#;
    let urdf = include_str!("../../urdf/planar_two_link.urdf");
    let urdf = urdf.replace(r#"type="continuous">"#, limit);
    let (folder, path) = file("robot.urdf", urdf);
    let config = folder.path().join("stops.yaml");
    let text = format!(
        "dynamics:\n  ros__parameters:\n    urdf: {}\n    initial_joint_velocities: [0.5, 0.0]\n",
        path.display()
    );
    std::fs::write(&config, text).unwrap();
    let run = simulated(config.to_str().unwrap(), "1");
    let first = &run["events"][0];
    assert_eq!(
        first["what"],
        "joint 'joint1' is at its upper stop, 0.1 rad"
    );
    // It moves by .1 rad at about .5 rad/s.
    let time = first["time"].as_f64().unwrap();
    assert!(time > 0.15 && time < 0.3, "{time}");
}
