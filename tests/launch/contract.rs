//! The graph is what its description says: who hears what, types and QoS.

use serde_json::{Value, json};
use std::time::{Duration, Instant};

use crate::{
    peer::Peer,
    process::{Running, eventually, source},
};

/// Topic, type, reliability, durability, publishers.
const TOPICS: [(&str, &str, &str, &str, &[&str]); 16] = [
    (
        "/clock",
        "rosgraph_msgs/msg/Clock",
        RELIABLE,
        VOLATILE,
        DYNAMICS,
    ),
    (
        "/robot_description",
        "std_msgs/msg/String",
        RELIABLE,
        LATCHED,
        DYNAMICS,
    ),
    (
        "/joint_states",
        "sensor_msgs/msg/JointState",
        RELIABLE,
        VOLATILE,
        DYNAMICS,
    ),
    (
        "/tf",
        "tf2_msgs/msg/TFMessage",
        RELIABLE,
        VOLATILE,
        DYNAMICS,
    ),
    (
        "/tf_static",
        "tf2_msgs/msg/TFMessage",
        RELIABLE,
        LATCHED,
        DYNAMICS,
    ),
    (
        "/ground_truth/odom",
        "nav_msgs/msg/Odometry",
        RELIABLE,
        VOLATILE,
        DYNAMICS,
    ),
    (
        "/ground_truth/target/odom",
        "nav_msgs/msg/Odometry",
        RELIABLE,
        VOLATILE,
        DYNAMICS,
    ),
    (
        "/ground_truth/momentum",
        "fuyu_msgs/msg/Momentum",
        RELIABLE,
        VOLATILE,
        DYNAMICS,
    ),
    ("/imu", "sensor_msgs/msg/Imu", RELIABLE, VOLATILE, DYNAMICS),
    (
        "/joint_commands",
        "sensor_msgs/msg/JointState",
        RELIABLE,
        VOLATILE,
        &["controller"],
    ),
    (
        "/controller/state",
        "fuyu_msgs/msg/ControllerState",
        RELIABLE,
        VOLATILE,
        &["controller"],
    ),
    (
        "/camera/tip_pose",
        "geometry_msgs/msg/PoseStamped",
        RELIABLE,
        VOLATILE,
        &["camera"],
    ),
    (
        "/camera/goal_pose",
        "geometry_msgs/msg/PoseStamped",
        RELIABLE,
        VOLATILE,
        &["camera"],
    ),
    (
        "/camera/camera_info",
        "sensor_msgs/msg/CameraInfo",
        RELIABLE,
        LATCHED,
        &["camera"],
    ),
    // It is the user's to publish.
    (
        "/goal_pose",
        "geometry_msgs/msg/PoseStamped",
        RELIABLE,
        VOLATILE,
        &[],
    ),
    (
        "/diagnostics",
        "diagnostic_msgs/msg/DiagnosticArray",
        RELIABLE,
        VOLATILE,
        &[
            "camera",
            "controller",
            "dynamics",
            "launch_monitor",
            "recorder",
        ],
    ),
];
const RELIABLE: &str = "RELIABLE";
const VOLATILE: &str = "VOLATILE";
const LATCHED: &str = "TRANSIENT_LOCAL";
const DYNAMICS: &[&str] = &["dynamics"];
/// What the nodes may hear, beside `/clock` for time: the camera alone turns truth into measurements.
const SUBSCRIPTIONS: [(&str, &[&str]); 3] = [
    ("dynamics", &["/joint_commands"]),
    (
        "camera",
        &[
            "/goal_pose",
            "/ground_truth/odom",
            "/joint_states",
            "/robot_description",
        ],
    ),
    (
        "controller",
        &[
            "/camera/goal_pose",
            "/camera/tip_pose",
            "/joint_states",
            "/robot_description",
        ],
    ),
];

#[test]
fn topics_types_and_qos_are_those_of_the_description() {
    let domain = 85;
    let args = ["--duration", "600"];
    let mut launch = Running::launch(domain, &source("config/servicing.yaml"), &args);
    let mut peer = Peer::start("auditor", domain);
    for (topic, kind, reliability, durability, nodes) in TOPICS {
        // Which node an endpoint belongs to is known a little later than the endpoint.
        let mut publishers = Vec::new();
        let mut endpoints = Vec::new();
        let deadline = Instant::now() + Duration::from_secs(20);
        while publishers != nodes && Instant::now() < deadline {
            let found = peer.does(json!({"do": "topic_info", "topic": topic}));
            endpoints = found.as_array().unwrap().clone();
            let node = |e: &Value| e["node"].as_str().unwrap().to_owned();
            publishers = endpoints.iter().map(node).collect();
            publishers.sort_unstable();
        }
        assert_eq!(publishers, nodes, "{topic}");
        assert!(endpoints.len() == nodes.len(), "{topic}");
        for endpoint in &endpoints {
            let found =
                ["type", "reliability", "durability"].map(|k| endpoint[k].as_str().unwrap());
            assert_eq!(found, [kind, reliability, durability], "{topic}");
        }
    }
    for (node, allowed) in SUBSCRIPTIONS {
        // Its endpoints may come after the node itself.
        let heard = eventually(node, Duration::from_secs(20), || {
            let graph: Value = peer.does(json!({"do": "graph", "node": node}));
            let heard = graph["subscribers"].as_object()?.keys();
            let heard: Vec<_> = heard.filter(|t| *t != "/clock").cloned().collect();
            (heard.len() >= allowed.len()).then_some(heard)
        });
        assert_eq!(heard, allowed, "{node}");
    }
    launch.interrupt().well();
}
