//! The dynamics node is killed and restarts at time zero: the other nodes wait, and continue with it.

use serde_json::{Value, json};
use std::time::{SystemTime, UNIX_EPOCH};

use crate::{
    child::Running,
    lateness::repeat_if_late,
    measuring::worst_below,
    peer::Peer,
    waiting::{PATIENCE, eventually},
};

const DOMAIN: u16 = 16;
/// From the start of the new process until commands answer it \[s\].
const BACK_WITHIN: f64 = 3.0;
const STATE: &str = "sensor_msgs/msg/JointState";

fn node(name: &str, more: &[&str]) -> Running {
    Running::node(name, "config/positioning.yaml", DOMAIN, more)
}

/// The peer's time [s].
pub fn now() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.expect("after 1970").as_secs_f64()
}

/// Messages that came since a time, at least one if there is patience enough.
pub fn since(peer: &mut Peer, topic: &str, time: f64) -> Vec<Value> {
    let wait = json!({"do": "wait", "topic": topic, "since": time, "timeout": 1.0});
    peer.does(wait).as_array().expect("a list").clone()
}

fn seconds(message: &Value) -> f64 {
    message["message"]["header"]["stamp"]["sec"]
        .as_f64()
        .expect("a stamp")
}

// Fails when camera or controller end with the dynamics node, keep its old time, or do not discover a new one.
#[test]
fn a_new_dynamics_node_is_found_and_time_starts_again_at_zero() {
    repeat_if_late(three_new_dynamics_nodes);
}

fn three_new_dynamics_nodes() {
    let _camera = node("camera", &[]);
    let gentle = [
        "-p",
        "k_o:=2.0",
        "-p",
        "k_v:=[400.0, 100.0, 200.0, 10.0, 2.0, 0.2]",
    ];
    let mut controller = node("controller", &gentle);
    let mut dynamics = node("dynamics", &["-p", "duration:=0.0"]);
    // A peer of Fast DDS may miss endpoints that are made while it comes.
    dynamics.says("bodies");
    let mut peer = Peer::start("observer", DOMAIN);
    peer.subscribe("joint_states", STATE, "reliable");
    peer.subscribe("joint_commands", STATE, "reliable");
    // Every new node must meet the limit, so the worst one is checked.
    worst_below(
        "until commands answer a new dynamics node [s]",
        BACK_WITHIN,
        3,
        || {
            eventually("some seconds of simulated time", 3 * PATIENCE, || {
                let last = since(&mut peer, "joint_commands", 0.0).pop()?;
                (seconds(&last) >= 2.0).then_some(())
            });
            dynamics.signal("KILL");
            assert_eq!(dynamics.wait(PATIENCE), None);
            let killed = now();
            dynamics = node("dynamics", &["-p", "duration:=0.0"]);
            // Messages under way when it was killed have the old time.
            let answered = eventually("an answer in the new time", PATIENCE, || {
                let answers = since(&mut peer, "joint_commands", killed);
                answers.iter().find(|m| seconds(m) < 2.0)?["time"].as_f64()
            });
            assert!(controller.runs());
            answered - killed
        },
    );
    controller.interrupt();
    dynamics.interrupt();
}
