//! Scenarios with goals on a target, late cameras and two arms, and how wrong ones are refused.

use serde_json::Value;

use super::fuyu::{Run, file, fuyu};

const TRACKING: &str = include_str!("../../config/tracking.yaml");
const DUAL_ARM: &str = include_str!("../../config/dual_arm.yaml");

fn simulated(scenario: &str, from: &str, to: &str) -> Run {
    assert!(from.is_empty() || scenario.contains(from), "{from}");
    let (folder, path) = file("scenario.yaml", scenario.replacen(from, to, 1));
    let run = fuyu(&["simulate".as_ref(), path.as_os_str(), "--json".as_ref()]);
    drop(folder);
    run
}

fn error(run: &Value) -> (f64, f64) {
    let number = |key: &str| run[key].as_f64().unwrap_or(f64::INFINITY);
    (
        number("tip_position_error"),
        number("tip_attitude_error").to_degrees(),
    )
}

#[test]
fn a_grasp_point_on_a_tumbling_target_is_followed() {
    let (position, angle) = error(&simulated(TRACKING, "", "").json());
    assert!(position < 0.02 && angle < 1.0, "{position} {angle}");
    let blind = simulated(TRACKING, "    prediction: motion", "    prediction: none");
    let (position, _) = error(&blind.json());
    assert!(position > 0.1, "{position}");
}

#[test]
fn one_arm_reaches_its_goal_while_the_other_holds_the_base() {
    let run = simulated(DUAL_ARM, "", "").json();
    let (position, angle) = error(&run);
    assert!(position < 1e-3 && angle < 0.1, "{position} {angle}");
    let turned = |run: &Value| {
        let angles = run["base_attitude_rpy"].as_array().unwrap().iter();
        angles
            .map(|a| a.as_f64().unwrap().abs())
            .fold(0.0, f64::max)
            .to_degrees()
    };
    assert!(turned(&run) < 0.02, "{}", turned(&run));
    let free = simulated(DUAL_ARM, "base_task: before_tips", "base_task: free").json();
    assert!(turned(&free) > 1.0, "{}", turned(&free));
}

#[test]
fn what_does_not_exist_is_named() {
    for (scenario, from, to, words) in [
        (
            TRACKING,
            "frame: target",
            "frame: moon",
            ["goal.frame", "'moon' is not one of target"],
        ),
        (
            TRACKING,
            "    prediction: motion",
            "    prediction: oracle",
            ["'oracle' is not one of", "none, latency, motion"],
        ),
        (
            TRACKING,
            "goal_position_noise: 0.007",
            "goal_position_noise: 0.0",
            ["goal_position_noise", "0"],
        ),
        (
            DUAL_ARM,
            "second_tip_task: free",
            "second_tip_task: rest",
            ["second_tip_task", "pose, position, free"],
        ),
        (
            DUAL_ARM,
            "    second_tip_link: right_tool\n    law",
            "    second_tip_link: third_tool\n    law",
            ["second_tip_link", "'third_tool' is no link"],
        ),
        (
            DUAL_ARM,
            "    second_tip_link: right_tool\n    law",
            "    law",
            ["second_tip_link", "must be the same"],
        ),
    ] {
        let run = simulated(scenario, from, to);
        let refusal = run.refusal();
        for word in words {
            assert!(refusal.contains(word), "{to}: no {word:?} in {refusal}");
        }
    }
}
