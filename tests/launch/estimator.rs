//! The estimator in the graph: what it says of the target beside the truth, and features from a stranger.

use fuyu::{
    estimation::free_body::FreeRotation,
    model::Model,
    msg::{
        Interface,
        fuyu_msgs::{FeatureTracks, MotionEstimate},
        nav_msgs,
        sensor_msgs::{CameraInfo, Imu},
        std_msgs,
        tf2_msgs::TFMessage,
    },
    nodes::geometry::{pose_from_msg, with_matrix},
    ros::Time,
    spatial::Pose,
    vision::{BodyPoint, FeatureCamera, FeatureCameraConfig},
};
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    path::Path,
    time::{Duration, Instant},
};

use crate::{
    joining::peer_with_interfaces,
    peer::Peer,
    process::{Running, command, fuyu, read, scenario},
    starvation::in_time,
    view::{diagnosed, numbers},
    waiting::{PATIENCE, eventually},
};

/// Poses of an odometry topic by stamp \[ns\].
fn poses(odometry: Vec<nav_msgs::Odometry>) -> BTreeMap<i64, Pose> {
    let pose = |m: nav_msgs::Odometry| {
        let X = pose_from_msg(&m.pose.pose).expect("a sound pose");
        (Time::from(&m.header.stamp).as_nanos(), with_matrix(&X))
    };
    odometry.into_iter().map(pose).collect()
}

// Breaks when the estimator is told the wrong camera, the wrong gyro axes or the wrong mounting of the
// camera, when its axes are not those of the prediction's stamp, and when the motion itself is wrong.
#[test]
fn the_target_is_where_the_estimator_said_it_would_be() {
    in_time(|| {
        let domain = 90;
        // Twice as fast: the estimator has half the time to think.
        let (_folder, config) = scenario(
            "config/servicing.yaml",
            &[(
                "state_rate: 100.0",
                "state_rate: 50.0\n    real_time_factor: 2.0",
            )],
        );
        let args = ["--duration", "60"];
        let mut launch = Running::launch(domain, &config, &args);
        launch.wait(6 * PATIENCE).well();
        let bag = launch.bag();
        let description = read::<std_msgs::String>(&bag, "/robot_description");
        let model = Model::from_urdf(&description[0].data, "robot_description").unwrap();
        let X_BC = model.frame("camera_optical_frame").unwrap().X_BF;
        let base = poses(read(&bag, "/ground_truth/odom"));
        let target = poses(read(&bag, "/ground_truth/target/odom"));

        let motions = read::<MotionEstimate>(&bag, "/estimator/motion");
        let last = motions.last().expect("a motion");
        assert_eq!(
            (last.method.as_str(), last.model.as_str()),
            ("bundle", "asymmetric")
        );
        let J = [last.j_x, last.j_y, last.j_z];
        println!("J {J:?} from {} frames, {} px", last.frames, last.residual);
        let [x, y, z] = J;
        // The pliers' moments are as 7 : 4 : 3.
        let (mut sorted, sum) = ([x, y, z], x + y + z);
        sorted.sort_by(f64::total_cmp);
        for (moment, part) in sorted.iter().zip([3.0, 4.0, 7.0]) {
            assert!((moment / sum - part / 14.0).abs() < 2e-3, "{J:?}");
        }

        // All of it is drawn beside the truth.
        let pictures = tempfile::tempdir().unwrap();
        let folder = pictures.path().to_str().unwrap();
        let plotted = fuyu(&["bag", "plot", bag.to_str().unwrap(), "--output", folder]).well();
        for (name, curves) in [
            (
                "target_squared_rate",
                &["at each frame", "fit, the last motion", "true, target"][..],
            ),
            ("herpolhode", &["estimated", "true, target"]),
            ("prediction_error", &["made at", "by when it was made"]),
        ] {
            assert!(
                plotted.stdout.contains(&format!("{name}.png")),
                "{plotted:?}"
            );
            let svg = std::fs::read_to_string(pictures.path().join(format!("{name}.svg"))).unwrap();
            for curve in curves {
                assert!(svg.contains(curve), "{name} has no {curve:?}");
            }
            let png = std::fs::read(pictures.path().join(format!("{name}.png"))).unwrap();
            assert!(png.starts_with(b"\x89PNG") && png.len() > 10_000, "{name}");
        }

        // A prediction made when half a minute had been seen, held against what came then.
        let predictions = read::<nav_msgs::Path>(&bag, "/estimator/prediction");
        let made = |p: &nav_msgs::Path| Time::from(&p.header.stamp).as_secs_f64();
        let old = predictions
            .iter()
            .find(|p| made(p) > 30.0)
            .expect("a prediction");
        let stamp = Time::from(&old.header.stamp).as_nanos();
        let X_WC = base[&stamp] * X_BC;
        let mut offset: Option<Rotation3<f64>> = None;
        let mut worst = 0.0f64;
        let mut compared = 0;
        for pose in &old.poses {
            let Some(X_WT) = target.get(&Time::from(&pose.header.stamp).as_nanos()) else {
                continue;
            };
            let q = &pose.pose.orientation;
            let R_CB =
                UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
            let R_WB = X_WC.rotation * R_CB.to_rotation_matrix();
            // The body's axes are arbitrary but fixed to it.
            let R_BT = *offset.get_or_insert(R_WB.inverse() * X_WT.rotation);
            worst = worst.max((R_WB * R_BT).rotation_to(&X_WT.rotation).angle());
            compared += 1;
        }
        println!(
            "worst of {compared} predicted attitudes: {:.4} deg",
            worst.to_degrees()
        );
        assert!(compared > 40, "{compared} of {}", old.poses.len());
        // The target fills 190 px of the image, a pixel of which is 0.6 degrees of its turn; half a minute of it
        // tells the next half minute to some tenths of a degree. Any mistake of axes shows as tens of degrees.
        assert!(worst.to_degrees() < 1.5, "{} deg", worst.to_degrees());
    });
}

/// How the ball of [`recorded`] tumbles.
fn truth() -> FreeRotation {
    let inertia = Matrix3::from_diagonal(&Vector3::new(7.0, 4.0, 3.0));
    let rate = Vector3::new(0.1, 0.35, 0.2);
    FreeRotation::new(&inertia, UnitQuaternion::identity(), &rate, 0.0).unwrap()
}

/// Frames of a tumbling ball as a camera at rest sees them, 10 a second, as messages in JSON.
fn recorded(frames: u32) -> Vec<Value> {
    let motion = truth();
    let config = FeatureCameraConfig {
        quantised: true,
        ..FeatureCameraConfig::ideal(1024, 1.25)
    };
    let mut camera = FeatureCamera::new(config, BodyPoint::on_sphere(20, 0.45, 5));
    let frame = |k: u32| {
        let time = 0.1 * f64::from(k);
        let R_CB = motion.attitude(time).to_rotation_matrix();
        camera.show(
            time,
            &Pose::from_parts(Translation3::new(0.0, 0.0, 0.9), R_CB),
        );
        let seen = camera.deliver(time).expect("a frame");
        let list = |of: fn(&fuyu::vision::Feature) -> f64| -> Vec<f64> {
            seen.features.iter().map(of).collect()
        };
        json!({
            "header": {"frame_id": "their_camera", "stamp": {"sec": k / 10, "nanosec": k % 10 * 100_000_000}},
            "ids": seen.features.iter().map(|f| f.id).collect::<Vec<_>>(),
            "u": list(|f| f.u), "v": list(|f| f.v),
        })
    };
    (0..frames).map(frame).collect()
}

fn publish(peer: &mut Peer, message: &Value) {
    peer.does(json!({
        "do": "publish", "topic": "camera/features", "type": "fuyu_msgs/msg/FeatureTracks",
        "message": message, "qos_name": "sensor_data"
    }));
}

/// An estimator that knows the camera of [`recorded`], with a name space and more parameters.
fn estimator(domain: u16, namespace: &str, parameters: &[&str]) -> Running {
    let mut command = command("estimator", domain);
    let remap = format!("__ns:={namespace}");
    command.args([
        "--ros-args",
        "-r",
        &remap,
        "-r",
        "camera/features:=/camera/features",
    ]);
    let camera = [
        "camera.fx:=819.2",
        "camera.fy:=819.2",
        "camera.cx:=511.5",
        "camera.cy:=511.5",
    ];
    for parameter in camera.iter().chain(parameters) {
        command.args(["-p", parameter]);
    }
    Running::start(command)
}

fn stamp(message: &Value) -> f64 {
    let stamp = &message["header"]["stamp"];
    stamp["sec"].as_f64().unwrap() + 1e-9 * stamp["nanosec"].as_f64().unwrap()
}

/// Errors of the angular velocities that `topic` has told for times after `from` \[rad/s\].
fn rate_errors(peer: &mut Peer, topic: &str, from: f64) -> Vec<f64> {
    let told = peer.receive(topic, 1);
    let told = told.iter().map(|m| &m["message"]);
    let error = |m: &Value| {
        let w = &m["vector"];
        let w = ["x", "y", "z"].map(|axis| w[axis].as_f64().unwrap());
        (Vector3::from(w) - truth().angular_velocity(stamp(m))).norm()
    };
    // What was told while no frames came is for other times than theirs.
    let of_a_frame = |m: &&Value| (10.0 * stamp(m) - (10.0 * stamp(m)).round()).abs() < 1e-6;
    let told = told.filter(of_a_frame);
    told.filter(|m| stamp(m) > from).map(error).collect()
}

/// Whether `topic` has told an angular velocity for this time.
fn told_for(peer: &mut Peer, topic: &str, time: f64) -> Option<()> {
    let told = peer.does(json!({"do": "wait", "topic": topic, "count": 1, "timeout": 1.0}));
    let mut told = told.as_array().expect("a list").iter();
    told.any(|m| (stamp(&m["message"]) - time).abs() < 1e-6)
        .then_some(())
}

/// Processor time that a process has taken \[s\].
fn cpu_time(process: &Running) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.id())).expect("it runs");
    // The name, in parentheses, may hold blanks; then times in user and in system mode are the 12th and 13th, in
    // hundredths of a second.
    let (_, rest) = stat.rsplit_once(')').expect("a name");
    let ticks = rest.split_whitespace().skip(11).take(2);
    ticks
        .map(|t| t.parse::<f64>().expect("ticks") / 100.0)
        .sum()
}

fn rms(errors: &[f64]) -> f64 {
    let squares: f64 = errors.iter().map(|e| e * e).sum();
    (squares / errors.len() as f64).sqrt()
}

const VECTOR: &str = "geometry_msgs/msg/Vector3Stamped";

// Two estimators that see the same frames and solve their batches at the same times, 20 s apart; one has the filter.
// Breaks when the filter does worse than none, is lost in a gap, or takes new ids for a new body.
#[test]
fn between_solutions_and_after_gaps_the_filter_knows_more() {
    in_time(|| {
        let domain = 92;
        let topics = [
            "/with/estimator/angular_velocity",
            "/without/estimator/angular_velocity",
        ];
        let mut with = estimator(
            domain,
            "/with",
            &["solve_period:=20.0", "prediction_period:=1.0"],
        );
        let mut without = estimator(domain, "/without", &["solve_period:=20.0", "filter:=false"]);
        let mut peer = peer_with_interfaces("eye", domain);
        for topic in topics {
            peer.subscribe(topic, VECTOR, "reliable");
        }
        peer.subscribe(
            "/with/estimator/prediction",
            "nav_msgs/msg/Path",
            "reliable",
        );
        peer.subscribe(
            "diagnostics",
            "diagnostic_msgs/msg/DiagnosticArray",
            "reliable",
        );
        let frames = recorded(700);
        let show = |peer: &mut Peer, from: usize, to: usize, ids: u64| {
            for frame in &frames[from..to] {
                let mut frame = frame.clone();
                let known = frame["ids"].as_array().unwrap().iter();
                frame["ids"] = known.map(|id| json!(id.as_u64().unwrap() + ids)).collect();
                let sent = peer.does(json!({
                    "do": "publish", "topic": "/camera/features", "type": "fuyu_msgs/msg/FeatureTracks",
                    "message": frame, "qos_name": "sensor_data", "matched": 2
                }));
                assert_eq!(sent, 2);
                // The frames come twenty times as fast as they were taken, which leaves the solver its time.
                std::thread::sleep(Duration::from_millis(5));
            }
        };
        // Six seconds are enough for a first solution; they are shown frame by frame until both have one.
        show(&mut peer, 0, 60, 0);
        for topic in topics {
            eventually("a first motion", 4 * PATIENCE, || {
                let told = json!({"do": "wait", "topic": topic, "count": 1, "timeout": 1.0});
                (!peer.does(told).as_array().unwrap().is_empty()).then_some(())
            });
        }
        let (before, started) = (cpu_time(&with), Instant::now());
        // The next batch is due 20 s after the last of the first ones, which ended at 2 s at the earliest.
        show(&mut peer, 60, 120, 0);
        show(&mut peer, 170, 220, 0);
        for topic in topics {
            eventually("the last frame's", PATIENCE, || {
                told_for(&mut peer, topic, 21.9)
            });
        }
        // At 30 frames a second a quarter of a core is 8 ms a frame; looking for messages takes its time, too.
        let taken = cpu_time(&with) - before - 0.05 * started.elapsed().as_secs_f64();
        println!("{:.2} ms of processor time a frame", 1e3 * taken / 110.0);
        assert!(taken / 110.0 < 0.25 / 30.0, "{taken} s");
        let [filtered, batch] = topics.map(|topic| rate_errors(&mut peer, topic, 10.0));
        println!(
            "with {:.2e}, without {:.2e} rad/s",
            rms(&filtered),
            rms(&batch)
        );
        assert!(filtered.len() > 60 && batch.len() > 60);
        assert!(rms(&filtered) < 0.5 * rms(&batch));
        let after_gap = topics.map(|topic| rms(&rate_errors(&mut peer, topic, 16.95)));
        println!("after the gap {after_gap:?}");
        assert!(after_gap[0] < 0.5 * after_gap[1]);
        // Predictions come in their period, not with every frame.
        let paths = peer.receive("/with/estimator/prediction", 1);
        let times: Vec<f64> = paths.iter().map(|p| stamp(&p["message"])).collect();
        assert!(times.len() > 5 && times.len() < 40, "{times:?}");
        for path in &paths {
            let poses = path["message"]["poses"].as_array().unwrap();
            assert_eq!(poses.len(), 61);
            let last = stamp(&poses[60]) - stamp(&path["message"]);
            assert!((last - 30.0).abs() < 1e-6, "{last}");
        }

        // All ids change, as with a tracker that starts anew: the filter coasts until a batch has the new ones.
        show(&mut peer, 220, 280, 0);
        show(&mut peer, 280, 300, 100);
        let told = diagnosed(&mut peer, "with/estimator: motion", |level, text| {
            level == 1 && text.contains("coasting")
        });
        assert!(told.contains("not those of the structure"), "{told}");
        show(&mut peer, 300, 690, 100);
        let told = diagnosed(&mut peer, "with/estimator: motion", |level, text| {
            level == 0 && text == "asymmetric"
        });
        println!("{told}");
        show(&mut peer, 690, 700, 100);
        eventually("the last frame's", PATIENCE, || {
            told_for(&mut peer, topics[0], 69.9)
        });
        let last = rms(&rate_errors(&mut peer, topics[0], 68.95));
        println!("with new ids {last:.2e} rad/s");
        assert!(last < 1e-3);
        with.interrupt().well();
        without.interrupt().well();
    });
}

// A body that something has touched moves otherwise, and is known anew; breaks when the estimator holds on to what
// it knew.
#[test]
fn a_push_is_noticed_and_the_new_motion_found() {
    in_time(|| {
        let domain = 93;
        let mut estimator = estimator(domain, "/", &["solve_period:=5.0"]);
        let mut peer = peer_with_interfaces("eye", domain);
        peer.subscribe(
            "estimator/motion",
            "fuyu_msgs/msg/MotionEstimate",
            "reliable",
        );
        peer.subscribe("estimator/angular_velocity", VECTOR, "reliable");
        let frames = recorded(600);
        for frame in &frames[..200] {
            publish(&mut peer, frame);
        }
        eventually("the motion of 20 s", 4 * PATIENCE, || {
            let motion = peer.receive("estimator/motion", 1).pop()?["message"].clone();
            (motion["duration"].as_f64()? > 19.0).then_some(())
        });
        // From here on it turns the other way: the frames before 60 s, backwards.
        let mut pushed: Vec<Value> = frames[200..].iter().rev().cloned().collect();
        for (frame, at) in pushed.iter_mut().zip(&frames[200..]) {
            frame["header"] = at["header"].clone();
            publish(&mut peer, frame);
        }
        eventually("the new motion", 4 * PATIENCE, || {
            let told = peer.receive("estimator/angular_velocity", 1).pop()?["message"].clone();
            let w = ["x", "y", "z"].map(|axis| told["vector"][axis].as_f64().unwrap());
            let right = -truth().angular_velocity(79.9 - stamp(&told));
            let found = (Vector3::from(w) - right).norm() < 2e-3 && stamp(&told) > 59.0;
            found.then_some(())
        });
        // It was noticed, rather than taken for outliers until the window had passed.
        let (_, said) = estimator.said();
        assert!(said.contains("the target moves otherwise"), "{said}");
        estimator.interrupt().well();
    });
}

#[test]
fn features_that_an_rclpy_node_publishes_are_enough() {
    in_time(|| {
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
        // Too little to tell a motion, and said so.
        publish(&mut peer, &frames[0]);
        let told = diagnosed(&mut peer, "estimator: motion", |level, _| level == 1);
        assert!(told.starts_with("not estimated yet"), "{told}");
        for frame in &frames[1..] {
            publish(&mut peer, frame);
        }
        let motion = eventually("the motion of 20 s", 4 * PATIENCE, || {
            let motion = peer.receive("estimator/motion", 1).pop()?["message"].clone();
            (motion["duration"].as_f64()? > 20.0).then_some(motion)
        });
        assert_eq!(motion["header"]["frame_id"], "their_camera");
        let of = |name: &str| motion[name].as_f64().unwrap();
        let sum = of("j_x") + of("j_y") + of("j_z");
        let mut parts = ["j_x", "j_y", "j_z"].map(|j| of(j) / sum);
        parts.sort_by(f64::total_cmp);
        for (part, right) in parts.iter().zip([3.0, 4.0, 7.0]) {
            assert!((part - right / 14.0).abs() < 2e-3, "{motion}");
        }
        assert!(of("residual") < 0.5, "{motion}");
        // A frame that cannot be is refused, named, and harms nothing.
        let mut wrong = frames[0].clone();
        wrong["u"] = json!([1.0]);
        publish(&mut peer, &wrong);
        let told = diagnosed(&mut peer, "estimator: features", |level, _| level == 1);
        assert!(told.contains("20, 1 and 20"), "{told}");
        // The recording again from its start: time goes back, and the estimator begins anew.
        for frame in &frames[..5] {
            publish(&mut peer, frame);
        }
        let told = diagnosed(&mut peer, "estimator: motion", |level, text| {
            level == 1 && text.contains("not estimated yet")
        });
        println!("{told}");
        let rates = peer.receive("estimator/angular_velocity", 1);
        let w = &rates.last().unwrap()["message"]["vector"];
        let w = numbers(&json!([w["x"], w["y"], w["z"]]));
        assert!(w.iter().all(|w| w.is_finite()), "{w:?}");
        estimator.interrupt().well();
    });
}

/// Messages of a bag's topic as JSON, with their stamps \[s\].
fn stamped<M: Interface + serde::Serialize>(bag: &Path, topic: &str) -> Vec<(f64, Value)> {
    let messages = read::<M>(bag, topic).into_iter();
    let json = messages.map(|m| serde_json::to_value(m).expect("JSON"));
    json.map(|m| (stamp(&m), m)).collect()
}

// Breaks when the estimator does not understand what a stranger says of the camera, its mounting or its gyro: the arm
// turns the base by 15 degrees meanwhile.
#[test]
fn a_stranger_replays_what_fuyu_simulate_recorded() {
    in_time(|| {
        let domain = 94;
        let folder = tempfile::tempdir().expect("a folder");
        let bag = folder.path().join("bag");
        let output = ["--output", bag.to_str().expect("a plain path")];
        fuyu(&[&["simulate", "config/servicing.yaml"], &output[..]].concat()).well();
        let features = stamped::<FeatureTracks>(&bag, "/camera/features");
        // A gyro at 20 Hz tells as much of a base that turns slowly.
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
        for (topic, kind, (_, message)) in &replay {
            publish(&mut peer, topic, kind, message);
        }
        let (last, _) = features.last().expect("frames");
        let motion = eventually("the motion of the whole recording", 4 * PATIENCE, || {
            let told = peer.receive("estimator/motion", 1);
            let mut told = told.iter().map(|m| &m["message"]).rev();
            told.find(|m| stamp(m) > last - 1.0 && m["duration"].as_f64() > Some(55.0))
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

#[test]
fn a_prediction_that_would_flood_the_graph_is_refused() {
    let mut estimator = estimator(95, "/", &["horizon:=3600.0", "prediction_rate:=100.0"]);
    let ended = estimator.wait(PATIENCE);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    let said = "horizon 3600 and prediction_rate 100 are more than 10000 attitudes";
    assert!(ended.stderr.contains(said), "{}", ended.stderr);
}
