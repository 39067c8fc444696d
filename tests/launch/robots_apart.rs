//! Two robots in one graph, each in a namespace: with one `/clock`, and with a clock each.

use fuyu::bag::Bag;
use std::{collections::BTreeSet, path::Path};

use crate::{
    process::{Ended, Running, source},
    waiting::PATIENCE,
};

const NAMESPACES: [&str; 2] = ["/a", "/b"];
/// Simulated time of each run \[s\].
const DURATION: &str = "4.0";

/// What a robot's launch has printed, and what its bag contains.
struct Outcome {
    ended: Ended,
    files: usize,
    topics: BTreeSet<String>,
    /// Time of recording of each message \[s\].
    stamps: Vec<f64>,
}

fn content(ended: Ended, bag: &Path) -> Outcome {
    let bag = Bag::open(bag).expect("a bag");
    let (mut topics, mut stamps) = (BTreeSet::new(), Vec::new());
    for message in bag.messages() {
        topics.insert(message.topic.name.clone());
        stamps.push(1e-9 * message.log_time as f64);
    }
    Outcome {
        ended,
        files: bag.files().len(),
        topics,
        stamps,
    }
}

/// Launches both robots at once, with more remaps.
fn launch(domain: u16, remaps: &[&str]) -> [Outcome; 2] {
    let config = source("config/positioning.yaml");
    let robots = NAMESPACES.map(|namespace| {
        let namespace = format!("__ns:={namespace}");
        let mut args = vec!["--duration", DURATION, "--ros-args", "-r", &namespace];
        args.extend(remaps.iter().flat_map(|remap| ["-r", *remap]));
        // Gains that are stable on a computer that is late.
        args.extend(["-p", "controller:k_o:=2.0"]);
        args.extend(["-p", "controller:k_v:=[400.0, 100.0, 200.0, 10.0, 2.0, 0.2]"]);
        Running::launch(domain, &config, &args)
    });
    robots.map(|mut robot| {
        let ended = robot.wait(3 * PATIENCE);
        content(ended, &robot.bag())
    })
}

/// Whether a bag has a robot's topics, and none of another one.
fn has_only(outcome: &Outcome, robot: &str, other: &str) {
    let has = |topic: &str| outcome.topics.contains(&format!("{robot}/{topic}"));
    assert!(has("joint_states") && has("controller/state"), "{:?}", outcome.topics);
    let foreign = format!("{other}/");
    assert!(
        !outcome.topics.iter().any(|topic| topic.starts_with(&foreign)),
        "{:?}",
        outcome.topics
    );
    let named = format!("robot {robot}");
    assert!(outcome.ended.stdout.contains(&named), "{}", outcome.ended.stdout);
}

// Fails if nodes follow both publishers of /clock: time then jumps back at every state, and a bag has a thousand files.
#[test]
fn robots_that_share_a_clock_by_mistake_are_warned_and_recorded() {
    let outcomes = launch(121, &[]);
    for (outcome, [robot, other]) in outcomes.iter().zip([["/a", "/b"], ["/b", "/a"]]) {
        has_only(outcome, robot, other);
        assert_eq!(outcome.files, 1, "{}", outcome.ended.stderr);
        let warnings = outcome.ended.stderr.matches("both publish /clock").count();
        assert!(warnings > 0, "{}", outcome.ended.stderr);
        let back = outcome.stamps.windows(2).filter(|pair| pair[1] < pair[0] - 0.1).count();
        assert!(back <= 1, "time jumps back {back} times");
    }
}

// Fails if the recorder does not know its clock by the remapped name: its first messages get the time of the end.
#[test]
fn a_recorder_with_a_remapped_clock_stamps_from_the_start() {
    let remaps = ["/clock:=clock", "/tf:=tf", "/tf_static:=tf_static"];
    let outcomes = launch(123, &remaps);
    for (outcome, [robot, other]) in outcomes.iter().zip([["/a", "/b"], ["/b", "/a"]]) {
        has_only(outcome, robot, other);
        assert_eq!(outcome.files, 1);
        let early = outcome.stamps.iter().filter(|stamp| **stamp < 2.0).count();
        assert!(
            3 * early > outcome.stamps.len(),
            "{early} of {} messages are of the first half",
            outcome.stamps.len()
        );
        assert!(!outcome.ended.stderr.contains("both publish"), "{}", outcome.ended.stderr);
    }
}
