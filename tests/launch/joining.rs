//! A real rclpy node joins `fuyu launch`.

use serde_json::{Value, json};
use std::{process::Command, time::Instant};

use crate::{
    lateness::repeat_if_late,
    observer::{
        DIAGNOSTICS, JOINT_STATE, ODOMETRY, POSE, following, fresh, now, numbers, tip_in_world,
        watch_tip,
    },
    peer::Peer,
    process::{GENTLE, Running, source},
    waiting::{PATIENCE, eventually},
};

/// A peer that knows `tf2_msgs` and `fuyu_msgs`, which have no wheel.
pub fn peer_with_interfaces(name: &str, domain: u16) -> Peer {
    let script = source("scripts/test-interfaces.sh");
    let output = Command::new(script).output().expect("the script starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let python = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    Peer::start_with(Command::new(python), name, domain)
}

const SERVICING: &str = "config/servicing.yaml";

#[test]
fn rclpy_receives_what_the_robot_publishes() {
    repeat_if_late(|| {
        let domain = 73;
        let _launch = Running::gently(domain, &source(SERVICING));
        let mut peer = peer_with_interfaces("ground", domain);
        for (topic, kind, qos) in [
            ("joint_states", JOINT_STATE, "reliable"),
            ("/tf", "tf2_msgs/msg/TFMessage", "reliable"),
            ("/tf_static", "tf2_msgs/msg/TFMessage", "latched"),
            ("/clock", "rosgraph_msgs/msg/Clock", "reliable"),
            ("ground_truth/target/odom", ODOMETRY, "reliable"),
            ("imu", "sensor_msgs/msg/Imu", "reliable"),
            (
                "camera/features",
                "fuyu_msgs/msg/FeatureTracks",
                "sensor_data",
            ),
            (
                "ground_truth/momentum",
                "fuyu_msgs/msg/Momentum",
                "reliable",
            ),
            (
                "controller/state",
                "fuyu_msgs/msg/ControllerState",
                "reliable",
            ),
            (
                "camera/camera_info",
                "sensor_msgs/msg/CameraInfo",
                "latched",
            ),
        ] {
            peer.subscribe(topic, kind, qos);
        }
        let state = &peer.receive("joint_states", 1)[0]["message"];
        assert_eq!(state["name"].as_array().unwrap().len(), 6, "{state}");
        assert_eq!(state["header"]["frame_id"], "base_link");
        assert!(numbers(&state["position"]).iter().all(|q| q.is_finite()));

        // One tree: every frame but the world has one parent, which exists.
        let moving = peer.receive("/tf", 1)[0]["message"]["transforms"].clone();
        let fixed = peer.receive("/tf_static", 1)[0]["message"]["transforms"].clone();
        let all = moving
            .as_array()
            .unwrap()
            .iter()
            .chain(fixed.as_array().unwrap());
        let links = all.map(|t| {
            (
                t["child_frame_id"].to_string(),
                t["header"]["frame_id"].to_string(),
            )
        });
        let mut links: Vec<_> = links.collect();
        links.sort();
        let children: Vec<_> = links.iter().map(|l| l.0.as_str()).collect();
        for (child, parent) in &links {
            let known = parent == "\"world\"" || children.contains(&parent.as_str());
            assert!(known, "{child} hangs from {parent}, which is nowhere");
        }
        assert!(children.windows(2).all(|w| w[0] != w[1]), "{children:?}");
        for frame in [
            "\"base_link\"",
            "\"tool0\"",
            "\"target\"",
            "\"camera_optical_frame\"",
        ] {
            assert!(children.contains(&frame), "{frame} is not in {children:?}");
        }

        let clocks = peer.receive("/clock", 20);
        let time = |m: &Value| {
            let clock = &m["message"]["clock"];
            clock["sec"].as_f64().unwrap() + 1e-9 * clock["nanosec"].as_f64().unwrap()
        };
        assert!(clocks.windows(2).all(|w| time(&w[0]) <= time(&w[1])));
        eventually("the clock runs", PATIENCE, || {
            (time(peer.receive("/clock", 1).last()?) > 1.0).then_some(())
        });

        let target = &fresh(&mut peer, "ground_truth/target/odom", 1)[0];
        assert_eq!(
            (&target["header"]["frame_id"], &target["child_frame_id"]),
            (&json!("world"), &json!("target"))
        );
        let w = &target["twist"]["twist"]["angular"];
        let w = ["x", "y", "z"].map(|axis| w[axis].as_f64().unwrap());
        let speed = w.iter().map(|w| w * w).sum::<f64>().sqrt();
        assert!((0.05..0.5).contains(&speed), "the target tumbles: {w:?}");
        let momentum = &fresh(&mut peer, "ground_truth/momentum", 1)[0];
        assert!(
            momentum["kinetic_energy"].as_f64().unwrap() > 0.0,
            "{momentum}"
        );
        let imu = &fresh(&mut peer, "imu", 1)[0];
        assert_eq!(imu["header"]["frame_id"], "base_link");
        assert_eq!(imu["orientation_covariance"][0], -1.0, "{imu}");
        let features = &fresh(&mut peer, "camera/features", 1)[0];
        assert_eq!(features["header"]["frame_id"], "camera_optical_frame");
        let (u, v) = (numbers(&features["u"]), numbers(&features["v"]));
        assert_eq!((u.len(), v.len()), (20, 20), "{features}");
        let inside = |x: &f64| (0.0..1024.0).contains(x) && x.fract() == 0.0;
        assert!(u.iter().chain(&v).all(inside), "{features}");
        let control = &fresh(&mut peer, "controller/state", 1)[0];
        assert_eq!(control["law"], "transpose_jacobian");
        assert_eq!(
            peer.receive("camera/camera_info", 1)[0]["message"]["width"],
            1024
        );

        // It subscribes long after the only publication.
        let mut late = Peer::start("late", domain);
        late.subscribe("robot_description", "std_msgs/msg/String", "latched");
        let description = &late.receive("robot_description", 1)[0]["message"]["data"];
        let urdf = std::fs::read_to_string(source("urdf/servicer.urdf")).unwrap();
        assert_eq!(description, &urdf);
    });
}

#[test]
fn rclpy_sees_and_sets_parameters() {
    repeat_if_late(|| {
        let domain = 74;
        let mut launch = Running::launch(domain, &source(SERVICING), &["--duration", "600"]);
        let mut peer = Peer::start("operator", domain);
        peer.subscribe("joint_states", JOINT_STATE, "reliable");
        for node in ["dynamics", "camera", "controller", "estimator", "recorder"] {
            let services = [format!("/{node}/list_parameters")];
            peer.graph(node, "/", &json!({ "services": services }));
        }
        peer.receive("joint_states", 1);
        // The controller knows the robot once it answers.
        peer.subscribe("joint_commands", JOINT_STATE, "reliable");
        peer.receive("joint_commands", 1);

        let call = |peer: &mut Peer, node: &str, service: &str, kind: &str, request: Value| {
            peer.does(json!({
                "do": "call", "service": format!("/{node}/{service}"),
                "type": format!("rcl_interfaces/srv/{kind}"), "request": request
            }))["response"]
                .clone()
        };
        let everything = json!({"prefixes": [], "depth": 0});
        for (node, some) in [
            (
                "dynamics",
                ["urdf", "integrator", "target.angular_velocity"],
            ),
            ("camera", ["rate", "latency", "goal.position"]),
            ("controller", ["k_p", "k_v", "law"]),
            ("recorder", ["bag", "compression", "topics"]),
        ] {
            let list = call(
                &mut peer,
                node,
                "list_parameters",
                "ListParameters",
                everything.clone(),
            );
            let names = list["result"]["names"].clone();
            for name in some {
                assert!(
                    names.as_array().unwrap().contains(&json!(name)),
                    "{name} of {node}: {names}"
                );
            }
            // Few at a time: rustdds 0.15.1 spoils answers that do not fit one datagram of 1500 bytes.
            for some in names.as_array().unwrap().chunks(5) {
                let some = json!({ "names": some });
                let kind = "DescribeParameters";
                let described = call(&mut peer, node, "describe_parameters", kind, some);
                for descriptor in described["descriptors"].as_array().unwrap() {
                    assert_ne!(descriptor["description"], "", "{descriptor}");
                }
            }
        }
        let names = json!({"names": ["k_p", "k_v"]});
        let got = call(
            &mut peer,
            "controller",
            "get_parameters",
            "GetParameters",
            names.clone(),
        );
        assert_eq!(got["values"][0]["double_value"], 75.0);
        assert_eq!(
            got["values"][1]["double_array_value"],
            json!([400.0, 100.0, 200.0, 10.0, 2.0, 2.0])
        );
        let described = call(
            &mut peer,
            "controller",
            "describe_parameters",
            "DescribeParameters",
            names,
        );
        assert_eq!(described["descriptors"][0]["read_only"], false);
        let range = &described["descriptors"][0]["floating_point_range"][0];
        assert!(range["from_value"].as_f64().unwrap() > 0.0, "{range}");

        let set = |peer: &mut Peer, node: &str, values: Value| {
            let answer = peer.does(json!({"do": "set_parameters", "node": node, "values": values}));
            let result = &answer["response"]["results"][0];
            let reason = result["reason"].as_str().unwrap().to_owned();
            (result["successful"] == true, reason)
        };
        assert_eq!(
            set(&mut peer, "/controller", json!([["k_p", 60.0]])),
            (true, String::new())
        );
        for (node, values, named) in [
            ("/controller", json!([["k_p", -1.0]]), ["k_p", "-1"]),
            ("/controller", json!([["k_p", 60]]), ["k_p", "60.0"]),
            ("/controller", json!([["k_v", [1.0, 2.0]]]), ["k_v", "6"]),
            (
                "/controller",
                json!([["law", "magic"]]),
                ["law", "joint_pd"],
            ),
            (
                "/controller",
                json!([["nosuch", 1.0]]),
                ["nosuch", "/controller"],
            ),
            (
                "/dynamics",
                json!([["time_step", 0.02]]),
                ["time_step", "read-only"],
            ),
            (
                "/dynamics",
                json!([["urdf", "other.urdf"]]),
                ["urdf", "read-only"],
            ),
            ("/camera", json!([["dropout", 2.0]]), ["dropout", "2"]),
        ] {
            let (successful, reason) = set(&mut peer, node, values.clone());
            assert!(!successful, "{values} was accepted");
            for word in named {
                assert!(
                    reason.contains(word),
                    "{word} is not in {reason:?} about {values}"
                );
            }
            println!("{node} {values}: {reason}");
        }
        // The law uses the parameter that was set.
        let mut state = peer_with_interfaces("state", domain);
        state.subscribe(
            "controller/state",
            "fuyu_msgs/msg/ControllerState",
            "reliable",
        );
        let control = &fresh(&mut state, "controller/state", 1)[0];
        assert_eq!(control["k_p"], 60.0, "{control}");
        launch.interrupt().well();
    });
}

#[test]
fn the_tip_goes_where_rclpy_says() {
    repeat_if_late(|| {
        let domain = 75;
        let twice = ["-p", "dynamics:real_time_factor:=2.0"];
        let args = [&["--duration", "600"], &GENTLE[..], &twice].concat();
        let mut launch = Running::launch(domain, &source(SERVICING), &args);
        let mut peer = Peer::start("pilot", domain);
        watch_tip(&mut peer, "");
        peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        let mut goal = tip_in_world(&mut peer, "");
        goal.translation.vector += nalgebra::Vector3::new(-0.2, 0.2, 0.1);
        let (p, q) = (
            goal.translation,
            nalgebra::UnitQuaternion::from(goal.rotation),
        );
        let pose = json!({
            "position": {"x": p.x, "y": p.y, "z": p.z},
            "orientation": {"x": q.i, "y": q.j, "z": q.k, "w": q.w}
        });
        let message = json!({"header": {"frame_id": "world"}, "pose": pose});
        peer.does(json!({"do": "publish", "topic": "goal_pose", "type": POSE, "message": message}));
        // The node's own measurement over a second: a machine under load does not always allow a factor of two,
        // a node that does not know its parameter never reaches it.
        let mut begin = now();
        eventually("twice as fast as real time", PATIENCE, || {
            let reports = following(&mut peer, "diagnostics", &mut begin);
            let mut statuses = reports.iter().flat_map(|r| r["status"].as_array().unwrap());
            let time = statuses.find(|s| s["name"] == "dynamics: time")?;
            let mut values = time["values"].as_array().unwrap().iter();
            let factor = values.find(|v| v["key"] == "real time factor")?["value"].as_str()?;
            let factor: f64 = factor.parse().unwrap();
            (1.9..2.1).contains(&factor).then_some(())
        });
        let distance =
            |peer: &mut Peer| (tip_in_world(peer, "").translation.vector - p.vector).norm();
        let before = distance(&mut peer);
        let start = Instant::now();
        let mut near = 0;
        eventually("the tip is within 2 cm", 5 * PATIENCE, || {
            near = if distance(&mut peer) < 0.02 {
                near + 1
            } else {
                0
            };
            // The tip stays there, it does not fly through.
            (near == 10).then_some(())
        });
        let took = start.elapsed().as_secs_f64();
        println!(
            "from {before:.2} m to {:.4} m in {took:.0} s",
            distance(&mut peer)
        );
        assert!(
            launch
                .interrupt()
                .well()
                .stdout
                .contains("real-time factor ")
        );
    });
}
