//! What happens to a process must not end the graph: stops, signals, Ctrl-C, kill -9.

use fuyu::msg::sensor_msgs::JointState;
use serde_json::{Value, json};
use std::{fs, path::Path, thread, time::Duration};

use crate::{
    peer::Peer,
    process::{Check, Running, eventually, fuyu, read, source},
    view::{JOINT_STATE, POSE, now},
};

/// Within this time after SIGCONT topics flow again \[s\].
const BACK_WITHIN: f64 = 3.0;
/// What goes round the loop: dynamics to camera to controller and back.
const LOOP: [(&str, &str); 3] = [
    ("joint_states", JOINT_STATE),
    ("camera/tip_pose", POSE),
    ("joint_commands", JOINT_STATE),
];

fn stamp(message: &Value) -> f64 {
    let stamp = &message["message"]["header"]["stamp"];
    stamp["sec"].as_f64().unwrap() + 1e-9 * stamp["nanosec"].as_f64().unwrap()
}

fn last_stamp(bag: &Path) -> f64 {
    let states = read::<JointState>(bag, "/joint_states");
    let stamp = &states.last().expect("states").header.stamp;
    f64::from(stamp.sec) + 1e-9 * f64::from(stamp.nanosec)
}

fn launch(domain: u16) -> (Running, Peer) {
    let launch = Running::launch(
        domain,
        &source("config/positioning.yaml"),
        &["--duration", "600"],
    );
    let mut peer = Peer::start("observer", domain);
    for (topic, kind) in LOOP {
        peer.subscribe(topic, kind, "reliable");
    }
    for (topic, _) in LOOP {
        peer.receive(topic, 20);
    }
    (launch, peer)
}

/// Simulated time of the newest state and how long every topic of the loop took to flow, since `from`.
fn flows(peer: &mut Peer, from: f64) -> (f64, f64) {
    let (mut time, mut longest) = (0.0, 0.0f64);
    for (topic, _) in LOOP {
        let wait = json!({"do": "wait", "topic": topic, "count": 5, "since": from + 0.05});
        let messages = peer.does(wait);
        let messages = messages.as_array().unwrap();
        assert!(messages.len() >= 5, "{topic} is silent");
        longest = longest.max(messages[4]["time"].as_f64().unwrap() - from);
        time = stamp(&messages[messages.len() - 1]);
    }
    (time, longest)
}

fn stopped_and_continued(domain: u16, signal: &str) {
    let (mut launch, mut peer) = launch(domain);
    let (before, _) = flows(&mut peer, now() - 1.0);
    launch.signal(signal);
    let stat = format!("/proc/{}/stat", launch.id());
    eventually("it stops", Duration::from_secs(5), || {
        let stat = fs::read_to_string(&stat).unwrap();
        (stat.split(' ').nth(2) == Some("T")).then_some(())
    });
    thread::sleep(Duration::from_secs(3));
    let continued = now();
    launch.signal("CONT");
    let (after, longest) = flows(&mut peer, continued);
    println!("after SIG{signal} and SIGCONT all topics flow within {longest:.2} s");
    assert!(longest < BACK_WITHIN, "{longest}");
    assert!(after > before, "time goes on: {before} {after}");
    // The pause is not made up for: simulated time stood still with the process.
    assert!(after < before + 2.5, "{before} {after}");
    thread::sleep(Duration::from_secs(1));
    launch.interrupt().well();
    // The recorder, too, heard what came later.
    assert!(last_stamp(&launch.bag()) > after);
    Check::of(&launch.bag()).momentum_holds();
}

#[test]
fn topics_flow_again_after_stop_and_continue() {
    stopped_and_continued(77, "STOP");
}

#[test]
fn topics_flow_again_after_ctrl_z_and_fg() {
    stopped_and_continued(78, "TSTP");
}

#[test]
fn a_childs_exit_and_other_signals_harm_nothing() {
    let (mut launch, mut peer) = launch(79);
    for signal in ["CHLD", "WINCH", "URG", "USR1", "PIPE"] {
        for _ in 0..5 {
            launch.signal(signal);
        }
        let (_, longest) = flows(&mut peer, now());
        println!("after SIG{signal} all topics flow within {longest:.2} s");
        assert!(longest < BACK_WITHIN, "{longest} after SIG{signal}");
    }
    launch.interrupt().well();
}

#[test]
fn ctrl_c_closes_the_bag() {
    let (mut launch, _peer) = launch(80);
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
}

#[test]
fn kill_9_leaves_a_bag_up_to_the_last_second() {
    let (mut launch, mut peer) = launch(81);
    thread::sleep(Duration::from_secs(5));
    let (seen, _) = flows(&mut peer, now() - 0.5);
    launch.signal("KILL");
    let ended = launch.wait(Duration::from_secs(10));
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
    let lost = seen - last_stamp(&bag);
    println!("kill -9 lost the last {lost:.2} s");
    assert!(lost < 2.0, "{lost}");
    let text = fuyu(&["bag", "info", bag.to_str().unwrap()]).well().stdout;
    assert!(
        text.contains("not closed") || text.contains("cut off") || text.contains("ends"),
        "{text}"
    );
}
