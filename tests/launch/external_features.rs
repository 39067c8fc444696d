//! The estimator with features from rclpy nodes: live, and replayed from a recording.

use fuyu::msg::{
    Interface,
    fuyu_msgs::FeatureTracks,
    sensor_msgs::{CameraInfo, Imu},
    tf2_msgs::TFMessage,
};
use serde_json::{Value, json};
use std::{path::Path, thread, time::Duration};

use crate::{
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    observer::{diagnosed, numbers},
    peer::Peer,
    process::{Running, command, fuyu, read},
    tumbling::{cloud, estimator, publish, recorded, stamp},
    waiting::{PATIENCE, eventually},
};

#[test]
fn features_that_an_rclpy_node_publishes_are_enough() {
    repeat_if_late(|| {
        let domain = 91;
        let mut estimator = estimator(domain, "/", &["solve_period:=1.0"]);
        let mut peer = peer_with_interfaces("eye", domain);
        peer.subscribe(
            "estimator/motion",
            "fuyu_msgs/msg/MotionEstimate",
            "reliable",
        );
        peer.subscribe(
            "estimator/angular_velocity",
            "geometry_msgs/msg/Vector3Stamped",
            "reliable",
        );
        peer.subscribe(
            "diagnostics",
            "diagnostic_msgs/msg/DiagnosticArray",
            "reliable",
        );
        let frames = recorded(300);
        // Too few frames for an estimate, and diagnostics say so.
        publish(&mut peer, &frames[0]);
        let reported = diagnosed(&mut peer, "estimator: motion", |level, _| level == 1);
        assert!(reported.starts_with("not estimated yet"), "{reported}");
        // Twice as fast as a camera.
        for frame in &frames[1..] {
            publish(&mut peer, frame);
            thread::sleep(Duration::from_millis(50));
        }
        // Once frames stop, the last batch has them all and fits to a fraction of a pixel. Before that, the filter may
        // continue an early batch, whose points are uncertain, through 25 s of frames.
        let motion = eventually("a motion that fits 30 s", 4 * PATIENCE, || {
            let motion = peer.receive("estimator/motion", 1).pop()?["message"].clone();
            let fits = motion["duration"].as_f64()? > 29.0 && motion["residual"].as_f64()? < 0.5;
            fits.then_some(motion)
        });
        assert_eq!(motion["header"]["frame_id"], "their_camera");
        let of = |name: &str| motion[name].as_f64().unwrap();
        let sum = of("j_x") + of("j_y") + of("j_z");
        let mut parts = ["j_x", "j_y", "j_z"].map(|j| of(j) / sum);
        parts.sort_by(f64::total_cmp);
        for (part, right) in parts.iter().zip([3.0, 4.0, 7.0]) {
            assert!((part - right / 14.0).abs() < 2e-3, "{motion}");
        }
        // An inconsistent frame is refused, named in diagnostics, and harms nothing.
        let mut wrong = frames[0].clone();
        wrong["u"] = json!([1.0]);
        publish(&mut peer, &wrong);
        let reported = diagnosed(&mut peer, "estimator: features", |level, _| level == 1);
        assert!(reported.contains("20, 1 and 20"), "{reported}");
        // The recording again from its start: time goes back, and the estimator restarts.
        for frame in &frames[..5] {
            publish(&mut peer, frame);
        }
        let reported = diagnosed(&mut peer, "estimator: motion", |level, text| {
            level == 1 && text.contains("not estimated yet")
        });
        println!("{reported}");
        let rates = peer.receive("estimator/angular_velocity", 1);
        let w = &rates.last().unwrap()["message"]["vector"];
        let w = numbers(&json!([w["x"], w["y"], w["z"]]));
        assert!(w.iter().all(|w| w.is_finite()), "{w:?}");
        estimator.interrupt().well();
    });
}

// Images of one camera leave the scale open; a cloud of points every two seconds gives it. Fails if clouds are not
// matched to features, or positions stay in units of depth.
#[test]
fn clouds_of_points_give_positions_in_metres() {
    repeat_if_late(|| {
        let domain = 88;
        let mut estimator = estimator(domain, "/", &["solve_period:=1.0"]);
        let mut peer = peer_with_interfaces("eye", domain);
        let topics = [
            ("estimator/motion", "fuyu_msgs/msg/MotionEstimate"),
            ("diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
        ];
        for (topic, kind) in topics {
            peer.subscribe(topic, kind, "reliable");
        }
        let publish_cloud = |peer: &mut Peer, message: Value| {
            peer.does(json!({
                "do": "publish", "topic": "camera/points", "type": "sensor_msgs/msg/PointCloud2",
                "message": message, "qos_name": "sensor_data"
            }));
        };
        let frames = recorded(200);
        for (k, frame) in (0..).zip(&frames) {
            publish(&mut peer, frame);
            if k % 20 == 10 {
                publish_cloud(&mut peer, cloud(k));
            }
            thread::sleep(Duration::from_millis(50));
        }
        let motion = eventually("a motion in metres", 4 * PATIENCE, || {
            let motion = peer.receive("estimator/motion", 1).pop()?["message"].clone();
            let long = motion["duration"].as_f64()? > 19.0;
            (long && motion["centre_unit"] == "m").then_some(motion)
        });
        let centre = &motion["position"];
        let error = [("x", 0.0), ("y", 0.0), ("z", 0.9)]
            .map(|(axis, right)| centre[axis].as_f64().unwrap() - right);
        let variances = numbers(&motion["position_covariance"]);
        for (k, error) in error.iter().enumerate() {
            let deviation = variances[4 * k].sqrt();
            assert!(
                error.abs() < 4.0 * deviation && deviation < 0.01,
                "{error} {deviation}: {motion}"
            );
        }
        // A cloud in another frame is refused, and diagnostics name it.
        let mut wrong = cloud(199);
        wrong["header"]["frame_id"] = json!("lidar");
        wrong["header"]["stamp"]["sec"] = json!(30);
        publish_cloud(&mut peer, wrong);
        let reported = diagnosed(&mut peer, "estimator: ranges", |level, _| level == 1);
        assert!(
            reported.contains("'lidar'") && reported.contains("camera/points"),
            "{reported}"
        );
        estimator.interrupt().well();
    });
}

/// Messages of a bag's topic as JSON, with their stamps \[s\].
fn stamped<M: Interface + serde::Serialize>(bag: &Path, topic: &str) -> Vec<(f64, Value)> {
    let messages = read::<M>(bag, topic).into_iter();
    let json = messages.map(|m| serde_json::to_value(m).expect("JSON"));
    json.map(|m| (stamp(&m), m)).collect()
}

// Fails when the estimator misreads camera, mounting or gyro data from another publisher: the arm
// turns the base by 15 degrees meanwhile.
#[test]
fn an_rclpy_node_replays_what_fuyu_simulate_recorded() {
    repeat_if_late(|| {
        let domain = 94;
        let folder = tempfile::tempdir().expect("a folder");
        let bag = folder.path().join("bag");
        let output = ["--output", bag.to_str().expect("a plain path")];
        fuyu(&[&["simulate", "config/servicing.yaml"], &output[..]].concat()).well();
        let features = stamped::<FeatureTracks>(&bag, "/camera/features");
        // 20 Hz are enough for the gyro of a base that turns slowly.
        let imu = stamped::<Imu>(&bag, "/imu").into_iter().step_by(5);
        let mut replay: Vec<_> = imu.map(|m| ("imu", "sensor_msgs/msg/Imu", m)).collect();
        let frames = features.iter().cloned();
        replay.extend(frames.map(|m| ("camera/features", "fuyu_msgs/msg/FeatureTracks", m)));
        replay.sort_by(|a, b| a.2.0.total_cmp(&b.2.0));

        let mut estimator = Running::start(command("estimator", domain));
        let mut peer = peer_with_interfaces("player", domain);
        peer.subscribe(
            "estimator/motion",
            "fuyu_msgs/msg/MotionEstimate",
            "reliable",
        );
        peer.subscribe(
            "diagnostics",
            "diagnostic_msgs/msg/DiagnosticArray",
            "reliable",
        );
        let camera = read::<CameraInfo>(&bag, "/camera/camera_info").remove(0);
        let mounts = read::<TFMessage>(&bag, "/tf_static").remove(0);
        for (topic, kind, message) in [
            (
                "camera/camera_info",
                "sensor_msgs/msg/CameraInfo",
                json!(camera),
            ),
            ("/tf_static", "tf2_msgs/msg/TFMessage", json!(mounts)),
        ] {
            peer.does(json!({
                "do": "publish", "topic": topic, "type": kind, "message": message, "qos_name": "latched"
            }));
        }
        // Before that the camera is not known; the first sample of the gyro asks for its mounting.
        let first = replay.remove(0);
        let (topic, kind, (_, message)) = &first;
        let publish = |peer: &mut Peer, topic: &str, kind: &str, message: &Value| {
            let qos = if topic == "imu" {
                "reliable"
            } else {
                "sensor_data"
            };
            peer.does(json!({
                "do": "publish", "topic": topic, "type": kind, "message": message, "qos_name": qos
            }));
        };
        publish(&mut peer, topic, kind, message);
        diagnosed(&mut peer, "estimator: camera", |level, _| level == 0);
        // Twice as fast as it was recorded. Much faster, on a busy machine, the filter extrapolates the first batches for
        // longer than they are good for, takes that for a change of the motion, and drops the frames before.
        for burst in replay.chunks(30) {
            for (topic, kind, (_, message)) in burst {
                publish(&mut peer, topic, kind, message);
            }
            thread::sleep(Duration::from_millis(500));
        }
        let motion = eventually("the motion of the whole recording", PATIENCE, || {
            let motions = peer.does(json!({
                "do": "wait", "topic": "estimator/motion", "count": 1, "timeout": 1.0
            }));
            let motions = motions.as_array().expect("a list").iter().rev();
            let mut motions = motions.map(|m| &m["message"]);
            motions
                .find(|m| m["duration"].as_f64() > Some(50.0))
                .cloned()
        });
        let of = |name: &str| motion[name].as_f64().unwrap();
        let sum = of("j_x") + of("j_y") + of("j_z");
        let mut parts = ["j_x", "j_y", "j_z"].map(|j| of(j) / sum);
        parts.sort_by(f64::total_cmp);
        for (part, right) in parts.iter().zip([3.0, 4.0, 7.0]) {
            assert!((part - right / 14.0).abs() < 2e-3, "{motion}");
        }
        assert!(of("residual") < 0.5 && of("frames") > 400.0, "{motion}");
        estimator.interrupt().well();
    });
}
