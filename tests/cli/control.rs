//! Scenarios of the control laws, and a goal that cannot be reached.

use super::fuyu::{file, fuyu};
use serde_json::Value;

fn simulated(config: &str, from: &str, to: &str) -> Value {
    assert!(config.contains(from), "{from}");
    let (_folder, path) = file("scenario.yaml", config.replace(from, to));
    let args = ["simulate".as_ref(), path.as_os_str(), "--json".as_ref()];
    fuyu(&args).json()
}

const APPROXIMATE: &str = include_str!("../../config/approximate_jacobian.yaml");
const STRAIGHT: &str = include_str!("../../config/straight_path.yaml");

/// From the unstable region the fixed-base Jacobian arrives after 98.3 s; the generalized one creeps, but its tip is
/// never farther than at the start.
#[test]
fn the_approximate_jacobian_arrives_late() {
    let run = simulated(APPROXIMATE, "jacobian: fixed_base", "jacobian: fixed_base");
    let settled = run["time_to_1cm"].as_f64().unwrap();
    assert!((settled - 98.3).abs() < 0.5, "{run}");
    assert!(run["tip_position_error"].as_f64().unwrap() < 1e-3);
    let run = simulated(APPROXIMATE, "jacobian: fixed_base", "jacobian: generalized");
    assert!(run["tip_position_error"].as_f64().unwrap() < 0.2, "{run}");
}

#[test]
fn the_straight_path_arrives_sooner_by_damping() {
    let settled = |from: &str, to: &str| {
        let run = simulated(STRAIGHT, from, to);
        run["time_to_1cm"].as_f64().unwrap_or(f64::INFINITY)
    };
    let damping = settled("shaping: damping", "shaping: damping");
    let rotation = settled("shaping: damping", "shaping: rotation");
    let plain = settled("law: straight_path", "law: transpose_jacobian");
    assert!(damping < 15.0, "{damping}");
    assert!(rotation > 25.0 && plain > 25.0, "{rotation} {plain}");
}

#[test]
fn a_goal_out_of_reach_is_said_to_be_and_the_run_goes_on() {
    let far = STRAIGHT.replace("position: [0.0, 6.08", "position: [0.0, 16.08");
    let (_folder, path) = file("far.yaml", far);
    let run = fuyu(&["simulate".as_ref(), path.as_os_str()]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    for words in [
        "fuyu: warning:",
        "far.yaml",
        "from 0.00 s on",
        "farther from the system's centre of mass than the tip can come",
    ] {
        assert!(run.stderr.contains(words), "{words}: {}", run.stderr);
    }
    assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
}
