//! A lockstep run in the graph, in memory or over DDS, is bit-identical to `fuyu simulate`.

use fuyu::msg::sensor_msgs::JointState;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

use crate::{
    lateness::repeat_if_late,
    process::{Running, fuyu, read, source},
    waiting::PATIENCE,
};

const CONFIG: &str = "config/positioning.yaml";
/// Long enough to include saturated motion, unsaturated motion and the final damping \[s\].
const DURATION: &str = "20";

/// The joint states of a bag, without those that were published again to wake a late joiner.
pub fn states(bag: &Path) -> Vec<JointState> {
    let mut states = read::<JointState>(bag, "/joint_states");
    states.dedup();
    states
}

/// With messages in memory, or with a participant for each node and all messages over DDS.
fn launched(domain: u16, config: &Path, duration: &str, isolated: bool) -> Vec<JointState> {
    let mut args = vec!["--lockstep", "--duration", duration];
    if isolated {
        args.push("--isolated");
    }
    let mut launch = Running::launch(domain, config, &args);
    let ended = launch.wait(5 * PATIENCE).well();
    println!("{}", ended.stdout);
    states(&launch.bag())
}

/// The bag of `fuyu simulate` for a scenario.
pub fn simulated(config: &Path, duration: &str) -> Vec<JointState> {
    let folder = tempfile::tempdir().unwrap();
    let (output, config) = (folder.path().join("bag"), config.to_str().unwrap());
    let args = ["simulate", config, "--duration", duration, "--output"];
    fuyu(&[&args[..], &[output.to_str().unwrap()]].concat()).well();
    states(&output)
}

/// Stamps, positions, rates and efforts are bit-identical: `fuyu simulate` also converts stamps and quaternions as messages do.
/// An isolated recorder may be discovered after the first states; from then on it has every one.
fn assert_same(simulated: &[JointState], launched: &[JointState], states: usize, isolated: bool) {
    assert_eq!(simulated.len(), states);
    match isolated {
        false => assert_eq!(launched.len(), states),
        true => assert!((states / 2..=states).contains(&launched.len())),
    }
    let recorded = &simulated[states - launched.len()..];
    for (ours, theirs) in recorded.iter().zip(launched) {
        assert_eq!(ours, theirs);
    }
}

#[test]
fn a_launched_run_equals_the_simulated_one() {
    equals_the_simulated_one(CONFIG, DURATION, 2001);
    // Together with a camera that sends features and an estimator that solves for seconds.
    equals_the_simulated_one("config/servicing.yaml", "5", 501);
    // Wheels that hold the base, with a late star tracker and a gyro with a bias.
    equals_the_simulated_one("config/attitude_hold.yaml", "10", 1001);
    repeat_if_late(a_moving_goal_seen_with_noise);
}

fn equals_the_simulated_one(config: &str, duration: &str, count: usize) {
    repeat_if_late(|| {
        let config = source(config);
        let simulated = simulated(&config, duration);
        for (domain, isolated) in [(71, false), (72, true)] {
            let launched = launched(domain, &config, duration, isolated);
            assert_same(&simulated, &launched, count, isolated);
        }
    });
}

/// `config/tracking.yaml`, changed so that it can run in lockstep: the camera sees every state without latency. It keeps the
/// noise of camera and gyro, the tumbling target, prediction and feed-forward. The estimator's results are not used: they
/// arrive at varying times, so runs would differ by 1e-4. The file exists as long as the folder.
pub fn tracking() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("tracking.yaml");
    let mut text = std::fs::read_to_string(source("config/tracking.yaml")).unwrap();
    for (late, at_once) in [
        ("rate: 10.0", "rate: 0.0"),
        ("latency: 0.15", "latency: 0.0"),
    ] {
        assert!(text.contains(late), "{late}");
        text = text.replacen(late, at_once, 1);
    }
    std::fs::write(&config, text).unwrap();
    (folder, config)
}

fn a_moving_goal_seen_with_noise() {
    let (_folder, config) = tracking();
    let simulated = simulated(&config, "5");
    assert_same(&simulated, &launched(71, &config, "5", false), 501, false);
}
