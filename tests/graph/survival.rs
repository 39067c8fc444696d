//! A node survives signals that end DDS participants: a child's exit, SIGSTOP and SIGCONT,
//! Ctrl-Z and fg.

use serde_json::json;
use std::{
    fs,
    process::Command,
    thread,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use crate::{
    lateness::repeat_if_late,
    measuring::worst_below,
    peer::{Peer, python},
    probe::Probe,
    upstream::lost_peers::short_lease,
    waiting::{PATIENCE, eventually},
};

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
    // The probe may not know yet that the peer subscribes to its answers.
    eventually("it answers", PATIENCE, || {
        let said = json!({"data": "hello"});
        peer.does(json!({"do": "publish", "topic": "say", "type": TEXT, "message": said}));
        let heard = json!({"do": "wait", "topic": "heard", "timeout": 0.2});
        let heard = peer.does(heard);
        (!heard.as_array()?.is_empty()).then_some(())
    });
    for _ in 0..5 {
        let since = now();
        let command = json!({"data": "have a child"});
        peer.does(json!({"do": "publish", "topic": "say", "type": TEXT, "message": command}));
        eventually("the outcome of a child", PATIENCE, || {
            let heard = json!({"do": "wait", "topic": "heard", "since": since, "timeout": 0.2});
            let heard = peer.does(heard);
            let texts = heard.as_array()?.iter();
            let mut texts = texts.filter_map(|h| h["message"]["data"].as_str());
            texts.any(|text| text.starts_with("Ok(")).then_some(())
        });
    }
    let since = now();
    let after = peer.does(json!({"do": "wait", "topic": "chatter", "count": 20, "since": since}));
    assert!(after.as_array().unwrap().len() >= 20);
}

/// Stops the probe with `signal` for a second, and checks that afterwards topics are received in both directions within
/// the limit. Returns false if the signal does not stop the probe.
fn stop_and_continue(domain: u16, signal: &str) -> bool {
    let probe = Probe::start(domain, &["--ros-args", "-p", "label:=kept"]);
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.subscribe("heard", TEXT, "reliable");
    peer.receive("chatter", 10);
    let said = json!({"data": "before"});
    peer.does(json!({"do": "publish", "topic": "say", "type": TEXT, "message": said}));
    peer.receive("heard", 1);

    let mut stops = true;
    let what = format!("time until topics flow after SIG{signal} and SIGCONT [s]");
    // Every stop must meet the limit, so the worst one is checked.
    worst_below(&what, BACK_WITHIN, 3, || {
        stops = stop_once(&probe, signal);
        if !stops {
            return 0.0;
        }
        let continued = now();
        probe.signal("CONT");

        let wait = json!({"do": "wait", "topic": "chatter", "since": continued + 0.05});
        let chatter = peer.does(wait);
        let out = chatter[0]["time"].as_f64().expect("chatter comes back") - continued;
        let message = chatter[0]["message"]["data"].as_str().unwrap();
        // The program has kept its state: the parameter, and a counter that continues.
        assert!(message.starts_with("kept "), "{message}");
        let count: i32 = message.split(' ').nth(1).unwrap().parse().unwrap();
        assert!(count > 10, "{message}");

        let back = eventually("it receives again", PATIENCE, || {
            let said = json!({"data": "there?"});
            peer.does(json!({
                "do": "publish", "topic": "say", "type": TEXT, "message": said, "matched": 0
            }));
            let since = continued + 0.05;
            let wait = json!({"do": "wait", "topic": "heard", "since": since, "timeout": 0.05});
            peer.does(wait)[0]["time"].as_f64()
        });
        println!(
            "publishes after {out:.2} s, hears after {:.2} s",
            back - continued
        );
        out.max(back - continued)
    });
    // A late joiner receives the latched message that the previous participant published before the stop.
    peer.subscribe("robot_description", TEXT, "latched");
    let description = peer.receive("robot_description", 1);
    assert_eq!(description[0]["message"]["data"], "<robot/>");
    let (said, code) = probe.interrupt();
    assert_eq!(code, Some(0), "{said}");
    stops
}

/// Sends the signal. Returns true a second after the probe has stopped, or false if it does not stop.
fn stop_once(probe: &Probe, signal: &str) -> bool {
    probe.signal(signal);
    let stat = format!("/proc/{}/stat", probe.id());
    // SIGTSTP does not stop an orphaned process group.
    let deadline = Instant::now() + Duration::from_secs(5);
    while fs::read_to_string(&stat).unwrap().split(' ').nth(2) != Some("T") {
        if Instant::now() > deadline {
            return false;
        }
        thread::sleep(Duration::from_millis(20));
    }
    thread::sleep(Duration::from_secs(1));
    true
}

#[test]
fn topics_flow_again_after_stop_and_continue() {
    repeat_if_late(|| assert!(stop_and_continue(49, "STOP"), "SIGSTOP stops everything"));
}

#[test]
fn topics_flow_again_after_ctrl_z_and_fg() {
    repeat_if_late(|| {
        if !stop_and_continue(50, "TSTP") {
            println!("skipped: this process group is orphaned, Ctrl-Z does nothing here");
        }
    });
}

// systemd and `timeout` send this pair. Fails if SIGCONT restarts a node that SIGTERM is ending.
#[test]
fn continuing_does_not_revive_a_node_that_is_ending() {
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
            !said.contains("panic") && !said.contains("joined the graph again"),
            "{said}"
        );
    }
}

#[test]
fn a_second_interrupt_ends_it_at_once() {
    repeat_if_late(|| {
        // Every interrupt must meet the limit.
        worst_below("end after the second interrupt [s]", 1.0, 3, || {
            end_after_two()
        });
    });
}

/// How long a process that ignores the first interrupt takes to end after the second \[s\].
fn end_after_two() -> f64 {
    let probe = Probe::start(53, &["--ros-args", "-p", "stubborn:=true"]);
    let mut peer = Peer::start("peer", 53);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.receive("chatter", 1);
    probe.signal("INT");
    eventually("it has taken the first one", PATIENCE, || {
        let chatter = peer.receive("chatter", 1);
        let last = chatter.last()?["message"]["data"].as_str()?;
        last.starts_with("last ").then_some(())
    });
    // Interrupts within 0.25 s are one request.
    thread::sleep(Duration::from_millis(300));
    let start = now();
    let (said, code) = probe.interrupt();
    assert_eq!(code, Some(130), "{said}");
    now() - start
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
        // The killed one still counts as matched, so a message may be published too early.
        let heard = eventually("it receives", PATIENCE, || {
            let said = json!({"data": "back?"});
            peer.does(json!({"do": "publish", "topic": "say", "type": TEXT, "message": said}));
            let heard = json!({"do": "wait", "topic": "heard", "since": started, "timeout": 0.2});
            peer.does(heard)[0]["time"].as_f64()
        });
        println!(
            "first message after {:.2} s, heard after {:.2} s",
            first - started,
            heard - started
        );
    }
}

// The peer is stopped for longer than its lease, which looks like an interrupted network, and continues as it was. Fails
// without a new participant when it returns (docs/upstream.md), or if one loss led to several.
#[test]
fn topics_flow_again_after_a_loss_longer_than_the_lease() {
    let domain = 111;
    let mut probe = Probe::start(domain, &[]);
    let profile = short_lease();
    let mut command = Command::new(python());
    command.env("FASTRTPS_DEFAULT_PROFILES_FILE", profile.path());
    let mut peer = Peer::start_with(command, "peer", domain);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.subscribe("heard", TEXT, "reliable");
    peer.receive("chatter", 1);
    peer.does(json!({"do": "pause", "seconds": 7}));
    let continued = now();
    probe.says("joined the graph again");
    let joined = now();
    println!("joined again after {:.2} s", joined - continued);
    // What was sent meanwhile may arrive before the new participant.
    let since = joined + 0.5;
    let chatter = peer.does(json!({"do": "wait", "topic": "chatter", "since": since}));
    assert!(chatter[0]["time"].is_number(), "chatter comes back");
    eventually("it receives again", PATIENCE, || {
        let said = json!({"data": "there?"});
        peer.does(json!({
            "do": "publish", "topic": "say", "type": TEXT, "message": said, "matched": 0
        }));
        let wait = json!({"do": "wait", "topic": "heard", "since": since, "timeout": 0.05});
        peer.does(wait)[0]["time"].as_f64()
    });
    // Longer than the pause between two checks of the connection.
    thread::sleep(Duration::from_secs(3));
    let (said, _) = probe.interrupt();
    // Its node's name may not be known yet.
    let lost = said.matches("nothing has arrived for the time of the lease");
    assert_eq!(lost.count(), 1, "{said}");
    assert_eq!(said.matches("joined the graph again").count(), 1, "{said}");
}
