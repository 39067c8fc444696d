//! What ends a DDS participant by accident must not end a node: a child's exit, SIGSTOP and SIGCONT,
//! Ctrl-Z and fg.

use serde_json::json;
use std::{
    fs, thread,
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use crate::{peer::Peer, probe::Probe};

const TEXT: &str = "std_msgs/msg/String";
/// Within this time after SIGCONT topics flow again [s].
const BACK_WITHIN: f64 = 3.0;

fn now() -> f64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap()
        .as_secs_f64()
}

#[test]
fn no_thread_takes_a_signal() {
    let probe = Probe::start(47, &[]);
    let mut peer = Peer::start("peer", 47);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.receive("chatter", 1);
    let threads = probe.blocked_signals();
    // Test, program, receiving, sending, signals, two of rustdds.
    assert!(threads.len() >= 7, "{threads:?}");
    // A thread that waits for signals takes them while it waits.
    for (thread, mask) in threads.into_iter().filter(|(t, _)| t != "signals") {
        for (signal, number) in [
            ("INT", 2),
            ("USR1", 10),
            ("ALRM", 14),
            ("CHLD", 17),
            ("CONT", 18),
        ] {
            assert!(
                mask & (1 << (number - 1)) != 0,
                "{thread} takes SIG{signal}"
            );
        }
    }
}

#[test]
fn a_childs_exit_harms_nothing() {
    let domain = 48;
    let _probe = Probe::start(domain, &[]);
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.subscribe("heard", TEXT, "reliable");
    for children in 1..=5 {
        let command = json!({"data": "have a child"});
        peer.does(json!({"do": "publish", "topic": "say", "type": TEXT, "message": command}));
        let heard = peer.receive("heard", children);
        let outcome = heard[children - 1]["message"]["data"].as_str().unwrap();
        assert!(outcome.starts_with("Ok("), "{outcome}");
    }
    let since = now();
    let after = peer.does(json!({"do": "wait", "topic": "chatter", "count": 20, "since": since}));
    assert!(after.as_array().unwrap().len() >= 20);
}

/// Stops the probe with `signal` for a second; how long each direction took to flow again [s].
fn stop_and_continue(domain: u16, signal: &str) -> Option<(f64, f64)> {
    let probe = Probe::start(domain, &["--ros-args", "-p", "label:=kept"]);
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.subscribe("heard", TEXT, "reliable");
    peer.receive("chatter", 10);
    let said = json!({"data": "before"});
    peer.does(json!({"do": "publish", "topic": "say", "type": TEXT, "message": said}));
    peer.receive("heard", 1);

    probe.signal(signal);
    thread::sleep(Duration::from_millis(300));
    let stat = fs::read_to_string(format!("/proc/{}/stat", probe.0.id())).unwrap();
    if stat.split(' ').nth(2) != Some("T") {
        return None;
    }
    thread::sleep(Duration::from_secs(1));
    let continued = now();
    probe.signal("CONT");

    let wait = json!({"do": "wait", "topic": "chatter", "count": 1, "since": continued + 0.05});
    let chatter = peer.does(wait);
    let out = chatter[0]["time"].as_f64().expect("chatter comes back") - continued;
    let message = chatter[0]["message"]["data"].as_str().unwrap();
    // The program's own state: its parameter, and a count that goes on.
    assert!(message.starts_with("kept "), "{message}");
    let count: i32 = message.split(' ').nth(1).unwrap().parse().unwrap();
    assert!(count > 10, "{message}");

    let mut back = None;
    while back.is_none() && now() - continued < 10.0 {
        let said = json!({"data": "there?"});
        peer.does(json!({
            "do": "publish", "topic": "say", "type": TEXT, "message": said, "matched": 0
        }));
        let heard =
            json!({"do": "wait", "topic": "heard", "since": continued + 0.05, "timeout": 0.05});
        back = peer.does(heard)[0]["time"].as_f64();
    }
    let back = back.expect("it hears again") - continued;
    // A late joiner gets what was published once, before the stop, by the participant that is gone.
    peer.subscribe("robot_description", TEXT, "latched");
    let description = peer.receive("robot_description", 1);
    assert_eq!(description[0]["message"]["data"], "<robot/>");
    let (said, code) = probe.interrupt();
    assert_eq!(code, Some(0), "{said}");
    println!("after SIG{signal} and SIGCONT: publishes after {out:.2} s, hears after {back:.2} s");
    Some((out, back))
}

#[test]
fn topics_flow_again_after_stop_and_continue() {
    let (out, back) = stop_and_continue(49, "STOP").expect("SIGSTOP stops everything");
    assert!(out < BACK_WITHIN && back < BACK_WITHIN, "{out} {back}");
}

#[test]
fn topics_flow_again_after_ctrl_z_and_fg() {
    match stop_and_continue(50, "TSTP") {
        Some((out, back)) => assert!(out < BACK_WITHIN && back < BACK_WITHIN, "{out} {back}"),
        None => println!("skipped: this process group is orphaned, Ctrl-Z does nothing here"),
    }
}

// systemd and `timeout` send this pair. Would break if the second revived what the first takes down.
#[test]
fn continuing_does_not_revive_what_was_told_to_stop() {
    for _ in 0..3 {
        let mut probe = Probe::start(60, &[]);
        let mut peer = Peer::start("peer", 60);
        peer.subscribe("chatter", TEXT, "reliable");
        peer.receive("chatter", 1);
        probe.signal("TERM");
        probe.signal("CONT");
        let (said, code) = probe.finish();
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains("the probe ends in order"), "{said}");
        assert!(
            !said.contains("panic") && !said.contains("joined the graph anew"),
            "{said}"
        );
    }
}

#[test]
fn a_second_interrupt_ends_it_at_once() {
    let probe = Probe::start(53, &["--ros-args", "-p", "stubborn:=true"]);
    let mut peer = Peer::start("peer", 53);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.receive("chatter", 1);
    probe.signal("INT");
    thread::sleep(Duration::from_millis(500));
    let start = now();
    let (said, code) = probe.interrupt();
    assert!(now() - start < 1.0);
    assert_eq!(code, Some(130), "{said}");
}

#[test]
fn a_peer_that_was_killed_comes_back() {
    let domain = 54;
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.subscribe("heard", TEXT, "reliable");
    for _ in 0..2 {
        let started = now();
        // Dropped at the end of the round: SIGKILL.
        let _probe = Probe::start(domain, &[]);
        let first = json!({"do": "wait", "topic": "chatter", "since": started});
        let first = peer.does(first)[0]["time"].as_f64().expect("chatter comes");
        let said = json!({"data": "back?"});
        // The killed one still counts as matched.
        peer.does(json!({"do": "publish", "topic": "say", "type": TEXT, "message": said}));
        let heard = json!({"do": "wait", "topic": "heard", "since": started});
        let heard = peer.does(heard)[0]["time"].as_f64().expect("it hears");
        println!(
            "first message after {:.2} s, heard after {:.2} s",
            first - started,
            heard - started
        );
    }
}
