//! Masutani 1995 chapter 7, straight paths, against an independent reference (`fixtures/masutani_ch7.json`), and on
//! twelve tasks.

use fuyu::control::Shaping;
use fuyu::dynamics::Method;
use fuyu::experiments::masutani_ch7::{FIG_7_3, Outcome, Steering, Task, config, tasks};
use serde_json::Value;

use crate::fixtures::numbers;

const ROTATION: Steering = Steering::Straight(Shaping::Rotation);
const DAMPING: Steering = Steering::Straight(Shaping::Damping);

/// The tip every 3 s for a minute, within 1e-6 m, with the reference's integration (RK4, 20 ms). The method matters:
/// where the tip starts, the rotation jumps from `P = I` to what the first motion asks for, and every method has its
/// own error there. A rotation to the other side, without one of its bounds or about another axis is off by
/// centimetres. In the last run the tip has become so slow after 28 s that the rotation is too stiff for the
/// reference's step: rounding grows there, to 1e-5 m.
#[test]
fn the_plain_and_the_rotated_law_go_as_the_reference() {
    let runs: Vec<Value> =
        serde_json::from_str(include_str!("fixtures/masutani_ch7.json")).unwrap();
    for run in &runs {
        let steering = match run["mod"].as_u64().unwrap() {
            0 => Steering::Plain,
            _ => ROTATION,
        };
        let task = Task {
            start: numbers(&run["q0"]).try_into().unwrap(),
            goal: numbers(&run["target"]).try_into().unwrap(),
        };
        let mut robot = task.start(config(steering)).by(Method::Rk4);
        for sample in run["samples"].as_array().unwrap() {
            let theirs = numbers(sample);
            if theirs[0] > 0.0 {
                robot.run_to(theirs[0], 0.02);
            }
            let ours = robot.X_WE().translation.vector;
            let stiff = steering == ROTATION && task != FIG_7_3 && theirs[0] > 28.0;
            let tolerance = if stiff { 1e-5 } else { 1e-6 };
            for (ours, theirs) in ours.iter().zip(&theirs[1..]) {
                assert!(
                    (ours - theirs).abs() < tolerance,
                    "{steering:?} {ours} {theirs}"
                );
            }
        }
    }
}

#[test]
fn the_example_becomes_straight() {
    let run = |steering| FIG_7_3.run(config(steering), 60.0);
    let (plain, rotated) = (run(Steering::Plain), run(ROTATION));
    assert!(
        (plain.deviation - 0.466).abs() < 1e-3,
        "{}",
        plain.deviation
    );
    assert!(
        (plain.path_ratio - 1.228).abs() < 2e-3,
        "{}",
        plain.path_ratio
    );
    assert!(
        (rotated.deviation - 0.044).abs() < 2e-3,
        "{}",
        rotated.deviation
    );
    assert!(
        (rotated.path_ratio - 1.001).abs() < 2e-3,
        "{}",
        rotated.path_ratio
    );
}

/// Rotation straightens every path but crawls on some; damping straightens them more and is through with each within
/// half a minute.
#[test]
fn twelve_tasks_straight_and_in_time() {
    let mut crawled = 0;
    for (number, task) in tasks().iter().enumerate() {
        let run = |steering| -> Outcome { task.run(config(steering), 60.0) };
        let [plain, rotated, damped] = [Steering::Plain, ROTATION, DAMPING].map(run);
        assert!(rotated.deviation < plain.deviation, "{number}");
        assert!(damped.deviation < 0.3 * plain.deviation, "{number}");
        assert!(damped.settled.is_some_and(|t| t < 30.0), "{number}");
        crawled += usize::from(rotated.settled.is_none_or(|t| t > 30.0));
    }
    assert!(crawled > 0);
}
