//! The graph agrees with its description: publishers, subscribers, types and QoS.

use serde_json::json;
use std::fs;

use crate::{
    lateness::repeat_if_late,
    observer::{JOINT_STATE, POSE},
    peer::Peer,
    process::{Running, source},
};

/// Topic, type, reliability, durability, publishers.
const TOPICS: [(&str, &str, &str, &str, &[&str]); 22] = [
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
        "/ground_truth/target/robot_description",
        "std_msgs/msg/String",
        RELIABLE,
        LATCHED,
        DYNAMICS,
    ),
    (
        "/ground_truth/momentum",
        "fuyu_msgs/msg/Momentum",
        RELIABLE,
        VOLATILE,
        DYNAMICS,
    ),
    (
        "/ground_truth/external_impulse",
        "fuyu_msgs/msg/ExternalImpulse",
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
    (
        "/camera/features",
        "fuyu_msgs/msg/FeatureTracks",
        "BEST_EFFORT",
        VOLATILE,
        &["camera"],
    ),
    (
        "/estimator/angular_velocity",
        "geometry_msgs/msg/Vector3Stamped",
        RELIABLE,
        VOLATILE,
        &["estimator"],
    ),
    (
        "/estimator/motion",
        "fuyu_msgs/msg/MotionEstimate",
        RELIABLE,
        VOLATILE,
        &["estimator"],
    ),
    (
        "/estimator/prediction",
        "nav_msgs/msg/Path",
        RELIABLE,
        VOLATILE,
        &["estimator"],
    ),
    // Published by the user.
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
            "estimator",
            "launch_monitor",
            "recorder",
        ],
    ),
];
const RELIABLE: &str = "RELIABLE";
const VOLATILE: &str = "VOLATILE";
const LATCHED: &str = "TRANSIENT_LOCAL";
const DYNAMICS: &[&str] = &["dynamics"];
/// What the nodes may subscribe to besides `/clock`: only the camera turns truth into measurements.
const SUBSCRIPTIONS: [(&str, &[&str]); 4] = [
    (
        "dynamics",
        &[
            "/cartesian_path",
            "/delta_twist_cmds",
            "/joint_commands",
            "/joint_trajectory",
            "/wrench",
        ],
    ),
    (
        "camera",
        &[
            "/goal_pose",
            "/ground_truth/odom",
            "/ground_truth/target/odom",
            "/joint_states",
            "/robot_description",
        ],
    ),
    (
        "controller",
        &[
            "/camera/goal_pose",
            "/camera/tip_pose",
            "/estimator/angular_velocity",
            "/imu",
            "/joint_states",
            "/robot_description",
        ],
    ),
    (
        "estimator",
        &[
            "/camera/camera_info",
            "/camera/features",
            "/camera/points",
            "/imu",
            "/tf_static",
        ],
    ),
];

#[test]
fn topics_types_and_qos_are_those_of_the_description() {
    repeat_if_late(|| agrees(85, &[]));
}

#[test]
fn isolated_nodes_have_the_same_topics_types_and_qos() {
    repeat_if_late(|| agrees(56, &["--isolated"]));
}

fn agrees(domain: u16, options: &[&str]) {
    // All interfaces of the nodes, those of commanders too.
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("servicing.yaml");
    let scenario = fs::read_to_string(source("config/servicing.yaml")).expect("the scenario");
    let every = scenario.replace("commander_interfaces: false", "commander_interfaces: true");
    assert_ne!(every, scenario);
    fs::write(&config, every).expect("a file");
    let mut launch = Running::gently_with(domain, &config, options);
    let mut peer = Peer::start("auditor", domain);
    for (topic, kind, reliability, durability, nodes) in TOPICS {
        // Which node an endpoint belongs to is known a little later than the endpoint.
        let ask = json!({"do": "topic_info", "topic": topic, "nodes": nodes});
        let found = peer.does(ask);
        let endpoints = found.as_array().unwrap();
        let mut publishers: Vec<_> = endpoints.iter().map(|e| &e["node"]).collect();
        publishers.sort_by_key(|node| node.to_string());
        assert_eq!(json!(publishers), json!(nodes), "{topic}");
        for endpoint in endpoints {
            let found =
                ["type", "reliability", "durability"].map(|k| endpoint[k].as_str().unwrap());
            assert_eq!(found, [kind, reliability, durability], "{topic}");
        }
    }
    // What is not there could still come: a node makes all its endpoints before it works, and peers learn
    // of them in the order in which they are made. So the controller's answers come after all of them.
    for (topic, kind) in [("joint_commands", JOINT_STATE), ("camera/tip_pose", POSE)] {
        peer.subscribe(topic, kind, "reliable");
        peer.receive(topic, 100);
    }
    for (node, allowed) in SUBSCRIPTIONS {
        let graph = peer.graph(node, "/", &json!({ "subscribers": allowed }));
        let heard = graph["subscribers"].as_object().unwrap().keys();
        let heard: Vec<_> = heard.filter(|t| *t != "/clock").collect();
        assert_eq!(heard, allowed, "{node}");
    }
    launch.interrupt().well();
}
