//! In lockstep a run over DDS is the simulated one.

use fuyu::msg::sensor_msgs::JointState;
use std::path::Path;

use crate::{
    process::{Running, fuyu, read, source},
    starvation::in_time,
    waiting::PATIENCE,
};

const CONFIG: &str = "config/positioning.yaml";
/// Long enough for all of the saturated, the unsaturated and the damped part of the motion to begin.
const DURATION: &str = "20";

/// The joint states of a bag, without those that were published again to wake a late joiner.
fn states(bag: &Path) -> Vec<JointState> {
    let mut states = read::<JointState>(bag, "/joint_states");
    states.dedup();
    states
}

fn over_dds(domain: u16, config: &str, duration: &str) -> Vec<JointState> {
    let args = ["--lockstep", "--duration", duration];
    let mut launch = Running::launch(domain, &source(config), &args);
    let ended = launch.wait(5 * PATIENCE).well();
    println!("{}", ended.stdout);
    states(&launch.bag())
}

#[test]
fn a_run_over_dds_equals_the_simulated_one() {
    equals_the_simulated_one(CONFIG, DURATION, 2001);
    // Beside a camera that sends features and an estimator that solves for seconds.
    equals_the_simulated_one("config/servicing.yaml", "5", 501);
}

fn equals_the_simulated_one(config: &str, duration: &str, count: usize) {
    in_time(|| {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("bag");
        let args = ["simulate", config, "--duration", duration, "--output"];
        fuyu(&[&args[..], &[output.to_str().unwrap()]].concat()).well();
        let simulated = states(&output);
        let [one, two] = [71, 72].map(|domain| over_dds(domain, config, duration));
        assert!(one == two, "two runs over DDS differ");
        assert_eq!((simulated.len(), one.len()), (count, count));
        let mut worst = 0.0f64;
        for (ours, theirs) in simulated.iter().zip(&one) {
            assert_eq!((&ours.header, &ours.name), (&theirs.header, &theirs.name));
            let pairs = |of: fn(&JointState) -> &Vec<f64>| of(ours).iter().zip(of(theirs));
            let all = pairs(|s| &s.position).chain(pairs(|s| &s.velocity));
            worst = all.fold(worst, |worst, (a, b)| worst.max((a - b).abs()));
        }
        // Not to the bit: on topics attitudes are quaternions.
        println!("largest difference of a position or rate between DDS and simulation: {worst:e}");
        assert!(worst <= 1e-12, "{worst:e}");
    });
}
