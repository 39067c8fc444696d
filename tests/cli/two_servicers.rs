//! Two robots in one world: `fuyu simulate`, and scenarios that cannot be.

use fuyu::{
    bag::Bag,
    msg::{fuyu_msgs::ControllerState, rosgraph_msgs::Clock, sensor_msgs::JointState},
};
use serde_json::Value;

use super::fuyu::{file, fuyu};

const CONFIG: &str = "config/two_servicers.yaml";

fn number(run: &Value, robot: &str, key: &str) -> f64 {
    let value = &run["robots"][robot][key];
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{robot} {key}: {run}"))
}

// Would break if one robot did not move, if the second one's camera did not see the first one's base turn, or if a
// robot moved otherwise than alone.
#[test]
fn both_tips_reach_their_goals() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let output = bag.to_str().unwrap();
    let run = fuyu(&["simulate", CONFIG, "--json", "--output", output]).json();
    let alone = fuyu(&["simulate", "config/positioning.yaml", "--json"]).json();
    for key in ["tip_position_error", "max_tip_speed"] {
        // The methods of integration differ.
        let off = number(&run, "/chaser1", key) - alone[key].as_f64().unwrap();
        assert!(off.abs() < 1e-6, "{key} {off}");
    }
    for robot in ["/chaser1", "/chaser2"] {
        assert!(number(&run, robot, "tip_position_error") < 0.01, "{run}");
        assert!(number(&run, robot, "tip_attitude_error") < 0.035, "{run}");
        let residual = &run["robots"][robot]["momentum_residual"];
        assert!(residual["angular"].as_f64().unwrap() < 1e-12, "{run}");
    }
    // The first base turns by 15 degrees, and the goal on it with it, by half a metre.
    let attitude = &run["robots"]["/chaser1"]["base_attitude_rpy"];
    assert!(attitude[0].as_f64().unwrap().abs() > 0.2, "{attitude}");
    assert!(run["robots"]["/chaser1"]["targets"]["derelict"].is_object());

    // One clock, and everything else in the namespace of its robot.
    let bag = Bag::open(&bag).unwrap();
    assert_eq!(bag.read::<Clock>("/clock").unwrap().len(), 6001);
    for robot in ["chaser1", "chaser2"] {
        let states = bag.read::<JointState>(&format!("/{robot}/joint_states"));
        assert_eq!(states.unwrap().len(), 6001);
        let answers = bag.read::<ControllerState>(&format!("/{robot}/controller/state"));
        assert_eq!(answers.unwrap().len(), 6001);
    }
    let check = fuyu(&["bag", "check", output, "--json"]);
    let report: Value = serde_json::from_str(&check.stdout).unwrap();
    assert_eq!(report["passed"], true, "{report}");
    for name in [
        "chaser1: energy balance",
        "chaser2: momentum from velocities",
        "chaser1/derelict: energy balance",
    ] {
        assert!(check.stdout.contains(name), "no {name} in {report}");
    }
    let text = fuyu(&["simulate", CONFIG, "--duration", "1"]);
    assert_eq!(text.code, 0, "{}", text.stderr);
    for said in ["/chaser1", "/chaser2", "derelict: energy residual"] {
        assert!(text.stdout.contains(said), "no {said} in {}", text.stdout);
    }
}

/// The scenario with `from` replaced must be refused by `simulate` and `launch` with a line that says all of `says`.
#[track_caller]
fn refused(from: &str, to: &str, says: &[&str]) {
    let good = include_str!("../../config/two_servicers.yaml");
    assert!(good.contains(from), "the scenario has no {from}");
    let (_folder, path) = file("two.yaml", good.replacen(from, to, 1));
    for command in ["simulate", "launch"] {
        let run = fuyu(&[command, path.to_str().unwrap()]);
        let message = run.refusal();
        for part in ["two.yaml"].iter().chain(says) {
            assert!(
                message.contains(part),
                "{command}: no {part:?} in: {message}"
            );
        }
    }
}

#[test]
fn robots_that_cannot_share_a_world_are_refused() {
    let both = "robots: [/chaser1, /chaser2]";
    refused(
        &format!("    {both}\n"),
        "",
        &[
            "parameter robots is []",
            "the scenario has /chaser1, /chaser2",
        ],
    );
    for (robots, says) in [
        ("[/chaser1]", "only one"),
        ("[/chaser1, chaser2]", "leading slash"),
    ] {
        let wrong = format!("    robots: {robots}\n    base:\n");
        refused("    base:\n", &wrong, &["robots", says]);
    }
    refused(
        both,
        "robots: [/chaser1, /chaser3]",
        &["/chaser3", "has /chaser1, /chaser2"],
    );
    refused(
        "    base:\n",
        "    robots: [/chaser2, /chaser1]\n    base:\n",
        &[
            "/chaser2/dynamics",
            "[/chaser2, /chaser1]",
            "all need the same",
        ],
    );
    refused(
        "    base:\n",
        "    state_rate: 50.0\n    base:\n",
        &["/chaser2/dynamics", "state_rate is 50", "is 100"],
    );
    refused(
        "    base:\n",
        "    lockstep: true\n    base:\n",
        &["/chaser2/dynamics", "lockstep"],
    );
    for (frame, says) in [
        (
            "/chaser3/base_link",
            "their bases are /chaser1/base_link, /chaser2/base_link",
        ),
        (
            "/chaser1/wreck",
            "the robot /chaser1 has base_link, derelict",
        ),
        ("derelict", "the dynamics node has no targets"),
    ] {
        let frame = format!("frame: {frame}");
        refused(
            "frame: /chaser1/base_link",
            &frame,
            &["/chaser2/camera", "goal.frame", says],
        );
    }
    let alone = include_str!("../../config/positioning.yaml").replace(
        "    integrator:",
        "    robots: [/chaser1, /chaser2]\n    integrator:",
    );
    let (_folder, path) = file("alone.yaml", alone);
    let run = fuyu(&["simulate", path.to_str().unwrap()]);
    let message = run.refusal();
    assert!(message.contains("no other dynamics node"), "{message}");
}

// The owner of the time may be any robot, so a duration of one alone would be another one for each command.
#[test]
fn robots_whose_times_differ_are_refused() {
    for (parameter, says) in [
        (
            "duration: 20.0",
            "duration is 20 but that of /chaser1/dynamics is 60",
        ),
        ("real_time_factor: 0.5", "real_time_factor is 0.5"),
        ("start_paused: true", "start_paused is true"),
    ] {
        let changed = format!("    {parameter}\n    base:\n");
        refused("    base:\n", &changed, &["/chaser2/dynamics", says]);
    }
}

// Would break if an absolute name of the robot's own target or base meant the world's frame: a robot alone is simulated as
// one of several.
#[test]
fn a_robot_alone_may_name_its_own_bodies_absolutely() {
    let good = include_str!("../../config/tracking.yaml");
    let run = |text: String| {
        let (_folder, path) = file("alone.yaml", text);
        let args = [
            "simulate",
            path.to_str().unwrap(),
            "--duration",
            "0.5",
            "--json",
        ];
        let mut run = fuyu(&args).json();
        run.as_object_mut().unwrap().remove("wall_time");
        run
    };
    let relative = run(good.to_owned());
    let absolute = good.replace("frame: target", "frame: /target");
    let absolute = absolute.replace("      target: target", "      target: /target");
    assert_ne!(absolute, good, "the scenario names no target");
    assert_eq!(run(absolute), relative);
    assert!(relative["tip_position_error"].is_number(), "{relative}");
}

// A target of one robot's world carries the goal of the other robot.
#[test]
fn a_camera_sees_targets_of_the_other_robot() {
    let good = include_str!("../../config/two_servicers.yaml");
    let text = good.replace("frame: /chaser1/base_link", "frame: /chaser1/derelict");
    let (_folder, path) = file("two.yaml", text);
    let run = fuyu(&[
        "simulate",
        path.to_str().unwrap(),
        "--duration",
        "0.1",
        "--json",
    ]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let run: Value = serde_json::from_str(&run.stdout).unwrap();
    // The goal is next to the derelict at 8, -8 m, the robot at -5.6, -6.5 m.
    assert!(
        number(&run, "/chaser2", "tip_position_error") > 3.0,
        "{run}"
    );
}
