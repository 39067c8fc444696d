//! `config/capture.yaml` and `config/capture_gripper.yaml` in `fuyu simulate`: a whole mission with the estimator in the loop.

use serde_json::Value;

use super::fuyu::{file, fuyu};

fn phase<'a>(run: &'a Value, name: &str) -> &'a Value {
    let phases = run["mission"]["phases"].as_array().unwrap();
    let found = phases.iter().find(|phase| phase["phase"] == name);
    found.unwrap_or_else(|| panic!("no phase {name}: {}", run["mission"]))
}

fn figure(phase: &Value, name: &str) -> f64 {
    phase["figures"][name]
        .as_f64()
        .unwrap_or_else(|| panic!("{name}: {phase}"))
}

#[test]
fn the_mission_captures_stops_and_identifies_its_target() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("capture");
    let bag = bag.to_str().unwrap();
    let run = fuyu(&["simulate", "config/capture.yaml", "--json", "--output", bag]).json();
    assert_eq!(run["mission"]["captured"], true);
    phase(&run, "done");
    let identify = phase(&run, "identify");
    // The client has 300 kg.
    let mass = figure(identify, "mass");
    assert!((mass / 300.0 - 1.0).abs() < 0.01, "{mass}");
    assert_eq!(figure(identify, "rank"), 13.0);
    assert!(figure(phase(&run, "detumble"), "angular velocity after") < 0.05_f64.to_radians());
    let events = run["events"].as_array().unwrap();
    assert!(
        events
            .iter()
            .any(|e| e["what"].as_str().unwrap().contains("holds client"))
    );
    // What is left of the truth: base and target turn together, slowly.
    let w = |value: &Value| {
        let w: Vec<f64> = serde_json::from_value(value.clone()).unwrap();
        w.iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    assert!(w(&run["final"]["base_angular_velocity"]) < 0.05_f64.to_radians());
    assert!(w(&run["final"]["targets"]["client"]["angular_velocity"]) < 0.05_f64.to_radians());
    // The recording tells the same of each phase.
    let check = fuyu(&["bag", "check", bag, "--json"]).json();
    let checks = check["checks"].as_array().unwrap();
    let verdict = |name: &str| {
        let found = checks.iter().find(|check| check["name"] == name);
        found.map_or("missing", |check| check["verdict"].as_str().unwrap())
    };
    for name in [
        "observe", "plan", "approach", "grasp", "detumble", "identify",
    ] {
        assert_eq!(verdict(&format!("mission, {name}")), "noted", "{check}");
    }
    for name in ["mission", "rate after detumbling", "angular momentum"] {
        assert_eq!(verdict(name), "passed", "{name}: {check}");
    }
    assert_eq!(check["passed"], true, "{check}");
    let plotted = fuyu(&["bag", "plot", bag]);
    assert!(plotted.stdout.contains("mission.png"), "{}", plotted.stdout);
    // The same to the bit.
    let short = [
        "simulate",
        "config/capture.yaml",
        "--json",
        "--duration",
        "30",
    ];
    let [first, second] = [(); 2].map(|()| fuyu(&short).json());
    assert_eq!(first["final"], second["final"]);
}

// Fails if wheels take more than they can, if thrusters do not give the rest, or if the wheels' momentum falsifies the identification. With
// wheels that are large enough no external couple is needed: the momentum of everything then stays.
#[test]
fn wheels_and_thrusters_stop_the_target() {
    let text = include_str!("../../config/capture_wheels.yaml");
    let large = text
        .replace("max_momentum: 1.0", "max_momentum: 20.0")
        .replacen(
            "tip_link: tool0\n    autostart",
            "tip_link: tool0\n    couple: 0.0\n    autostart",
            1,
        );
    for (text, needs_thrusters) in [(text.to_owned(), true), (large, false)] {
        let (folder, path) = file("wheels.yaml", text);
        let bag = folder.path().join("bag");
        let bag = bag.to_str().unwrap();
        let path = path.to_str().unwrap();
        let run = fuyu(&["simulate", path, "--json", "--output", bag]).json();
        let mission = &run["mission"];
        assert_eq!(mission["captured"], true, "{mission}");
        let mass = figure(phase(&run, "identify"), "mass");
        assert!((mass / 300.0 - 1.0).abs() < 0.01, "{mass}");
        let detumble = phase(&run, "detumble");
        assert!(figure(detumble, "angular velocity after") < 0.05_f64.to_radians());
        assert!(
            figure(detumble, "largest momentum of the wheels") > 1.0,
            "{detumble}"
        );
        assert_eq!(
            figure(detumble, "largest couple") > 0.0,
            needs_thrusters,
            "{detumble}"
        );
        let of = |name: &str| {
            mission[name]
                .as_f64()
                .unwrap_or_else(|| panic!("{mission}"))
        };
        assert!(
            of("grasp_force") < 50.0 && of("grasp_torque") < 50.0,
            "{mission}"
        );
        let check = fuyu(&["bag", "check", bag, "--json"]).json();
        assert_eq!(check["passed"], true, "{check}");
    }
}

#[test]
fn wheels_and_thrusters_that_cannot_stop_a_target_are_refused() {
    let text = include_str!("../../config/capture_wheels.yaml");
    refuses(
        text,
        &[
            (
                "wheels: [wheel_1, wheel_2, wheel_3, wheel_4]",
                "wheels: [wheel_1, wheel_2]",
                "parameter use_wheels is true, but the wheels give no torque about one axis at least",
            ),
            (
                "thruster_z1, thruster_z2, thruster_z3, thruster_z4]",
                "thruster_z1, thruster_z2]",
                "parameter use_thrusters is true, but the thrusters give no torque of",
            ),
            (
                "autostart: true\n",
                "autostart: true\n    thruster_period: 0.01\n",
                "min_on_time",
            ),
            (
                "autostart: true\n",
                "autostart: true\n    use_wheels: false\n    couple: 0.0\n",
                "parameter couple is 0 and no wheels are in use",
            ),
        ],
    );
}

// Fails if the servo of the joints shakes the grip loose, if the load exceeds what it may be, or if the compliance of the grip falsifies
// the identification.
#[test]
fn two_fingers_hold_the_target_by_friction() {
    let run = fuyu(&["simulate", "config/capture_gripper.yaml", "--json"]).json();
    let mission = &run["mission"];
    assert_eq!(mission["captured"], true, "{mission}");
    let of = |name: &str| {
        mission[name]
            .as_f64()
            .unwrap_or_else(|| panic!("{mission}"))
    };
    assert!(
        of("mass_error") < 0.01 && of("final_rate") < 0.05_f64.to_radians(),
        "{mission}"
    );
    assert!(
        of("grasp_force") < 50.0 && of("grasp_torque") < 50.0,
        "{mission}"
    );
}

// Fails if a mission goes on with a target that slips through its fingers: the friction is a hundredth of what holds it.
#[test]
fn a_target_that_slips_through_the_fingers_is_let_go() {
    let text = include_str!("../../config/capture_gripper.yaml");
    let slippery = text.replacen("friction: 0.8", "friction: 0.005", 1);
    assert_ne!(slippery, text);
    let (_folder, path) = file("slippery.yaml", slippery);
    let run = fuyu(&["simulate", path.to_str().unwrap(), "--json"]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    let result: serde_json::Value = serde_json::from_str(&run.stdout).expect("one JSON object");
    let mission = &result["mission"];
    assert_eq!(mission["captured"], false, "{mission}");
    assert_eq!(mission["phase"], "aborted", "{mission}");
    let reason = mission["reason"].as_str().unwrap();
    assert!(
        reason.contains("the target has slipped by")
            || reason.contains("the gripper has lost the target"),
        "{reason}"
    );
}

/// Checks that each change of a scenario, one text for another, is refused with a line that contains the third text.
fn refuses(scenario: &str, changes: &[(&str, &str, &str)]) {
    for (from, to, expected) in changes {
        let changed = scenario.replacen(from, to, 1);
        assert_ne!(changed, scenario);
        let (_folder, path) = file("scenario.yaml", changed);
        let run = fuyu(&["simulate", path.to_str().unwrap()]);
        assert!(run.refusal().contains(expected), "{}", run.stderr);
    }
}

#[test]
fn a_gripper_that_cannot_work_is_refused() {
    let text = include_str!("../../config/capture_gripper.yaml");
    refuses(
        text,
        &[
            (
                "    gripper_joint: left_finger_joint\n",
                "    gripper_joint: thumb\n",
                "parameter gripper_joint: the robot has no joint 'thumb' that moves on its own",
            ),
            (
                "    gripper: hand\n",
                "    gripper: foot\n",
                "parameter gripper is 'foot'; the dynamics node's grippers are [\"hand\"]",
            ),
            (
                "    gripper_closed: 0.06\n",
                "    gripper_closed: 0.002\n",
                "parameters gripper_open and gripper_closed are both 0.002; they must differ",
            ),
            (
                "    gripper_closed: 0.06\n",
                "    gripper_closed: 0.07\n",
                "parameter gripper_closed is 0.07; joint left_finger_joint moves from 0 to 0.06",
            ),
            (
                "    grip_stiffness: 5.0e4\n",
                "",
                "parameter grip_stiffness is not given",
            ),
            (
                "    gripper: hand\n",
                "    gripper: hand\n    gripper_services: true\n",
                "parameter gripper is 'hand' and gripper_services is true",
            ),
        ],
    );
}

#[test]
fn a_mission_without_what_it_needs_is_refused() {
    let text = include_str!("../../config/capture.yaml");
    refuses(
        text,
        &[
            (
                "    goal:\n      frame: client\n",
                "    goal:\n",
                "camera: parameter goal.frame is not given; a mission needs it",
            ),
            (
                "    autostart: true\n",
                "    autostart: true\n    standoff: 0.0\n",
                "parameter standoff is 0; it must be positive and finite",
            ),
            (
                "    autostart: true\n",
                "    autostart: true\n    approach_axis: [1.0, 0.0]\n",
                "parameter approach_axis has 2 values; give 3",
            ),
            (
                "mission:\n",
                "controller:\n  ros__parameters:\n    tip_link: tool0\nmission:\n",
                "/controller commands the same joints; name one of the two",
            ),
        ],
    );
    refuses(
        include_str!("../../config/capture_wheels.yaml"),
        &[(
            "mission:\n",
            "attitude:\n  ros__parameters:\n    use_sim_time: true\nmission:\n",
            "/attitude holds the base, which must float freely; name one of the two",
        )],
    );
}
