//! The robot as an rclpy node that a test drives observes it.

use fuyu::{
    msg::geometry_msgs,
    nodes::geometry::{pose_from_msg, with_matrix},
    spatial::Pose,
};
use serde_json::{Value, json};
use std::time::{SystemTime, UNIX_EPOCH};

use crate::{
    peer::Peer,
    waiting::{PATIENCE, eventually},
};

pub const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
pub const POSE: &str = "geometry_msgs/msg/PoseStamped";
pub const ODOMETRY: &str = "nav_msgs/msg/Odometry";
pub const DIAGNOSTICS: &str = "diagnostic_msgs/msg/DiagnosticArray";

/// The peer's time \[s\].
pub fn now() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.expect("after 1970").as_secs_f64()
}

/// At least `count` messages that come from now on.
pub fn fresh(peer: &mut Peer, topic: &str, count: usize) -> Vec<Value> {
    let messages = since(peer, topic, count, now());
    assert!(
        messages.len() >= count,
        "{} messages on {topic}",
        messages.len()
    );
    messages
}

/// The messages that have come since `begin` (of [`now`]), at least one unless the peer's patience ends. `begin` moves behind
/// the last, so that a loop misses none.
pub fn following(peer: &mut Peer, topic: &str, begin: &mut f64) -> Vec<Value> {
    let received = received_since(peer, topic, 1, *begin);
    if let Some(last) = received.last() {
        *begin = last["time"].as_f64().expect("a time").next_up();
    }
    received.iter().map(|m| m["message"].clone()).collect()
}

/// The messages that have come since `begin` (of [`now`]), once there are `count` or the peer's patience ends.
fn since(peer: &mut Peer, topic: &str, count: usize, begin: f64) -> Vec<Value> {
    let received = received_since(peer, topic, count, begin);
    received.iter().map(|m| m["message"].clone()).collect()
}

/// As [`since`], each with its time.
fn received_since(peer: &mut Peer, topic: &str, count: usize, begin: f64) -> Vec<Value> {
    let wait = json!({"do": "wait", "topic": topic, "count": count, "since": begin});
    peer.does(wait).as_array().expect("a list").clone()
}

pub fn numbers(list: &Value) -> Vec<f64> {
    serde_json::from_value(list.clone()).unwrap_or_else(|e| panic!("{list}: {e}"))
}

fn pose(message: &Value) -> Pose {
    let message: geometry_msgs::Pose = serde_json::from_value(message.clone()).expect("a pose");
    with_matrix(&pose_from_msg(&message).expect("a sound pose"))
}

/// The tip in the world, from the base's pose and the camera's tip pose of the same stamp.
pub fn tip_in_world(peer: &mut Peer, namespace: &str) -> Pose {
    let (odom, tip) = measured(namespace);
    eventually("base and tip of the same stamp", PATIENCE, || {
        // The camera may be late, so the base's poses of the last second are needed too.
        let begin = now() - 1.0;
        let bases = since(peer, &odom, 5, begin);
        let tips = since(peer, &tip, 5, begin);
        let mut pairs = tips.iter().filter_map(|tip| {
            let same = |base: &&Value| base["header"]["stamp"] == tip["header"]["stamp"];
            Some((bases.iter().find(same)?, tip))
        });
        let (base, tip) = pairs.next_back()?;
        Some(pose(&base["pose"]["pose"]) * pose(&tip["pose"]))
    })
}

fn measured(namespace: &str) -> (String, String) {
    let below = |name: &str| format!("{namespace}/{name}");
    (below("ground_truth/odom"), below("camera/tip_pose"))
}

/// Subscribes to what [`tip_in_world`] needs, in a namespace such as `/chaser`, or "".
pub fn watch_tip(peer: &mut Peer, namespace: &str) {
    let (odom, tip) = measured(namespace);
    peer.subscribe(&odom, ODOMETRY, "reliable");
    peer.subscribe(&tip, POSE, "reliable");
}

/// The diagnostic message of a part of a node (`dynamics: commands`): the first after `since`
/// (of [`now`]) that satisfies `enough`, if one comes within `patience` \[s\].
pub fn reported(
    peer: &mut Peer,
    part: &str,
    since: f64,
    patience: f64,
    enough: impl Fn(u64, &str) -> bool,
) -> Option<String> {
    let deadline = now() + patience;
    loop {
        let wait = json!({"do": "wait", "topic": "diagnostics", "since": since, "timeout": 0.5});
        let reports = peer.does(wait);
        let reports = reports.as_array().expect("a list").iter();
        let mut statuses = reports.flat_map(|r| r["message"]["status"].as_array().expect("a list"));
        let found = statuses.find(|status| {
            let level = status["level"][0].as_u64().expect("a level");
            let text = status["message"].as_str().expect("a text");
            status["name"] == part && enough(level, text)
        });
        if let Some(found) = found {
            return Some(found["message"].as_str().expect("a text").to_owned());
        }
        if now() > deadline {
            return None;
        }
    }
}

/// As [`reported`], from now on; panics if it does not come.
pub fn diagnosed(peer: &mut Peer, part: &str, enough: impl Fn(u64, &str) -> bool) -> String {
    let patience = PATIENCE.as_secs_f64();
    let text = reported(peer, part, now(), patience, enough);
    text.unwrap_or_else(|| panic!("not in diagnostics: {part}"))
}
