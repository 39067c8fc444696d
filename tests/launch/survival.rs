//! The graph survives stops and signals; Ctrl-C and kill -9 leave readable bags.

use fuyu::{bag::Bag, msg::sensor_msgs::JointState};
use serde_json::{Value, json};
use std::{fs, path::Path, thread, time::Duration};

use crate::{
    lateness::repeat_if_late,
    measuring::worst_below,
    observer::{JOINT_STATE, POSE, now},
    peer::Peer,
    process::{Check, Running, fuyu, source},
    waiting::{PATIENCE, eventually},
};

/// Longest time after SIGCONT until topics are received again \[s\].
const BACK_WITHIN: f64 = 3.0;
/// Topics of the loop: dynamics to camera to controller and back.
const LOOP: [(&str, &str); 3] = [
    ("joint_states", JOINT_STATE),
    ("camera/tip_pose", POSE),
    ("joint_commands", JOINT_STATE),
];

fn stamp(message: &Value) -> f64 {
    let stamp = &message["message"]["header"]["stamp"];
    stamp["sec"].as_f64().unwrap() + 1e-9 * stamp["nanosec"].as_f64().unwrap()
}

/// Stamp of the last state in a bag, closed or not \[s\]; `f64::MIN` if there is none yet.
fn last_stamp(bag: &Path) -> f64 {
    let states = Bag::open(bag).and_then(|bag| bag.read::<JointState>("/joint_states"));
    let last = states.ok().and_then(|mut states| states.pop());
    last.map_or(f64::MIN, |state| {
        let stamp = &state.message.header.stamp;
        f64::from(stamp.sec) + 1e-9 * f64::from(stamp.nanosec)
    })
}

fn launch(domain: u16, options: &[&str]) -> (Running, Peer) {
    let launch = Running::gently_with(domain, &source("config/positioning.yaml"), options);
    let mut peer = Peer::start("observer", domain);
    for (topic, kind) in LOOP {
        peer.subscribe(topic, kind, "reliable");
    }
    for (topic, _) in LOOP {
        peer.receive(topic, 20);
    }
    (launch, peer)
}

/// How long every topic of the loop took to flow, since `from`.
fn flows(launch: &Running, peer: &mut Peer, from: f64) -> f64 {
    let mut longest = 0.0f64;
    for (topic, _) in LOOP {
        let wait = json!({"do": "wait", "topic": topic, "count": 5, "since": from + 0.05});
        let messages = peer.does(wait);
        let messages = messages.as_array().unwrap();
        let count = messages.len();
        assert!(count >= 5, "{count} of {topic}: {}", launch.said().1);
        longest = longest.max(messages[4]["time"].as_f64().unwrap() - from);
    }
    longest
}

/// When the newest state came, and its stamp.
fn newest_state(peer: &mut Peer) -> (f64, f64) {
    let states = peer.does(json!({"do": "wait", "topic": "joint_states", "since": now() - 10.0}));
    let newest = states.as_array().unwrap().last().expect("states");
    (newest["time"].as_f64().unwrap(), stamp(newest))
}

/// How often nodes of a launch have joined the graph again.
fn joins(launch: &Running) -> usize {
    launch.said().1.matches("joined the graph again").count()
}

/// Stops a launch whose nodes are so many `participants`, three times.
fn stopped_and_continued(domain: u16, signal: &str, options: &[&str], participants: usize) {
    /// Between the two signals \[s\].
    const PAUSE: f64 = 3.0;
    let (mut launch, mut peer) = launch(domain, options);
    let stat = format!("/proc/{}/stat", launch.id());
    let what = format!("time until all topics flow after SIG{signal} and SIGCONT [s]");
    // Every stop must meet the limit, so the worst one is checked.
    worst_below(&what, BACK_WITHIN, 3, || {
        let (came, before) = newest_state(&mut peer);
        let joined = joins(&launch);
        launch.signal(signal);
        eventually("it stops", PATIENCE, || {
            let stat = fs::read_to_string(&stat).unwrap();
            (stat.split(' ').nth(2) == Some("T")).then_some(())
        });
        thread::sleep(Duration::from_secs_f64(PAUSE));
        let continued = now();
        launch.signal("CONT");
        // What was under way at the stop may arrive before the nodes join the graph again, which interrupts their topics.
        eventually("all nodes join the graph again", PATIENCE, || {
            (joins(&launch) >= joined + participants).then_some(())
        });
        let rejoined = now();
        let longest = rejoined - continued + flows(&launch, &mut peer, rejoined);
        if longest >= BACK_WITHIN {
            let took = rejoined - continued;
            println!("nodes joined again within {took:.3} s\n{}", launch.said().1);
        }
        let (later, after) = newest_state(&mut peer);
        assert!(after > before, "time goes on: {before} {after}");
        // Simulated time stood still with the process; the pause is not caught up.
        let elapsed = later - came;
        assert!(
            after - before < elapsed - 0.5 * PAUSE,
            "from {before} to {after} in {elapsed} s"
        );
        longest
    });
    // The recorder receives messages again, too.
    let (_, heard) = newest_state(&mut peer);
    eventually("the recorder receives again", PATIENCE, || {
        (last_stamp(&launch.bag()) > heard).then_some(())
    });
    launch.interrupt().well();
    Check::of(&launch.bag()).momentum_holds();
}

#[test]
fn topics_flow_again_after_stop_and_continue() {
    repeat_if_late(|| stopped_and_continued(77, "STOP", &[], 1));
}

#[test]
fn topics_of_isolated_nodes_flow_again_after_stop_and_continue() {
    // Those of dynamics, camera, controller, recorder and of the launch itself.
    repeat_if_late(|| stopped_and_continued(58, "STOP", &["--isolated"], 5));
}

#[test]
fn topics_flow_again_after_ctrl_z_and_fg() {
    repeat_if_late(|| stopped_and_continued(78, "TSTP", &[], 1));
}

#[test]
fn a_childs_exit_and_other_signals_harm_nothing() {
    repeat_if_late(|| {
        let (mut launch, mut peer) = launch(79, &[]);
        for signal in ["CHLD", "WINCH", "URG", "USR1", "PIPE"] {
            for _ in 0..5 {
                launch.signal(signal);
            }
            // A topic whose thread a signal had ended would stay silent.
            let longest = flows(&launch, &mut peer, now());
            println!("after SIG{signal} all topics flow within {longest:.2} s");
        }
        launch.interrupt().well();
    });
}

#[test]
fn ctrl_c_closes_the_bag() {
    repeat_if_late(|| {
        let (mut launch, _peer) = launch(80, &[]);
        // A terminal, or a launcher, signals the process and its group: two signals within milliseconds are one request.
        launch.signal("INT");
        let ended = launch.interrupt().well();
        for line in [
            "positioning",
            "stopped",
            "simulated time",
            "momentum residual",
            "messages",
        ] {
            assert!(ended.stdout.contains(line), "{line} in {}", ended.stdout);
        }
        assert!(
            !ended.stderr.contains("ERROR") && !ended.stderr.contains("panic"),
            "{}",
            ended.stderr
        );
        let bag = launch.bag();
        let info = fuyu(&["bag", "info", "--json", bag.to_str().unwrap()])
            .well()
            .json();
        assert_eq!(
            (&info["complete"], &info["has_metadata"]),
            (&json!(true), &json!(true)),
            "{info}"
        );
        assert!(bag.join("metadata.yaml").exists());
    });
}

#[test]
fn kill_9_leaves_a_bag_up_to_the_last_second() {
    repeat_if_late(|| {
        // Every kill must meet the limit, so the worst one is checked.
        worst_below("loss by kill -9 [s]", 2.0, 3, || {
            let (mut launch, mut peer) = launch(81, &[]);
            eventually("something is on the disk", PATIENCE, || {
                (last_stamp(&launch.bag()) > 2.0).then_some(())
            });
            let (_, seen) = newest_state(&mut peer);
            launch.signal("KILL");
            let ended = launch.wait(PATIENCE);
            assert_eq!(ended.code, None);
            let bag = launch.bag();
            let info = fuyu(&["bag", "info", "--json", bag.to_str().unwrap()])
                .well()
                .json();
            assert_eq!(
                (&info["complete"], &info["has_metadata"]),
                (&json!(false), &json!(false)),
                "{info}"
            );
            let text = fuyu(&["bag", "info", bag.to_str().unwrap()]).well().stdout;
            assert!(
                text.contains("not closed") || text.contains("cut off") || text.contains("ends"),
                "{text}"
            );
            seen - last_stamp(&bag)
        });
    });
}
