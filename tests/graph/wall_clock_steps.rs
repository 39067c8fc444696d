//! The wall clock is set back while a node runs.

use serde_json::{Value, json};
use std::process::Command;

use crate::{
    peer::Peer,
    probe::Probe,
    waiting::{PATIENCE, eventually},
    wall_clock::WallClock,
};

/// How far: longer than anything here waits.
const STEP: i64 = 3600;

/// Publishes `/clock`, and returns the time of the last message of the probe, which follows it \[s\].
fn tick(peer: &mut Peer, seconds: &mut u32) -> Option<f64> {
    *seconds += 1;
    let clock = json!({"clock": {"sec": *seconds}});
    peer.does(json!({
        "do": "publish", "topic": "/clock", "type": "rosgraph_msgs/msg/Clock", "message": clock
    }));
    let said = peer.does(json!({"do": "wait", "topic": "chatter", "count": 1, "timeout": 0.2}));
    let last = said.as_array()?.last()?["message"]["data"]
        .as_str()?
        .to_owned();
    last.rsplit_once(" at ")?.1.parse().ok()
}

// Fails if the node stays with a participant whose best-effort readers (`/clock` is one) give nothing until the clock has
// caught up.
#[test]
fn a_node_hears_best_effort_topics_after_the_wall_clock_was_set_back() {
    let domain = 104;
    let clock = WallClock::new();
    let mut probe = Command::new(Probe::executable());
    clock.set_for(&mut probe);
    let mut probe = Probe::start_with(probe, domain, &["--ros-args", "-p", "use_sim_time:=true"]);
    probe.runs();
    let mut peer = Peer::start("peer", domain);
    peer.subscribe("chatter", "std_msgs/msg/String", "reliable");
    peer.subscribe(
        "diagnostics",
        "diagnostic_msgs/msg/DiagnosticArray",
        "reliable",
    );
    let mut seconds = 0;
    eventually("the probe follows /clock", PATIENCE, || {
        tick(&mut peer, &mut seconds).filter(|t| *t > 0.0)
    });
    clock.shift(-STEP);
    let stepped = f64::from(seconds);
    eventually("it follows /clock again", PATIENCE, || {
        tick(&mut peer, &mut seconds).filter(|t| *t > stepped + 1.0)
    });
    let reported = eventually("it reports the step", PATIENCE, || {
        let all = peer.receive("diagnostics", 1);
        let statuses = all.iter().filter_map(|d| d["message"]["status"].as_array());
        statuses
            .flatten()
            .find(|s| s["name"] == "probe: wall clock")
            .map(|s| s["message"].clone())
    });
    assert!(
        matches!(&reported, Value::String(s) if s.contains("set back by 3600.0 s")),
        "{reported}"
    );
}
