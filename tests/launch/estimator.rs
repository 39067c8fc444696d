//! The estimator in the graph: what it says of the target beside the truth, and features from a stranger.

use fuyu::{
    estimation::free_body::FreeRotation,
    model::Model,
    msg::{fuyu_msgs::MotionEstimate, nav_msgs, std_msgs},
    nodes::geometry::{pose_from_msg, with_matrix},
    ros::Time,
    spatial::Pose,
    vision::{BodyPoint, FeatureCamera, FeatureCameraConfig},
};
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde_json::{Value, json};
use std::collections::BTreeMap;

use crate::{
    joining::peer_with_interfaces,
    peer::Peer,
    process::{Running, command, read, scenario},
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

/// Frames of a tumbling ball as a camera at rest sees them, 10 a second, as messages in JSON.
fn recorded(frames: u32) -> Vec<Value> {
    let inertia = Matrix3::from_diagonal(&Vector3::new(7.0, 4.0, 3.0));
    let rate = Vector3::new(0.1, 0.35, 0.2);
    let motion = FreeRotation::new(&inertia, UnitQuaternion::identity(), &rate, 0.0).unwrap();
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

#[test]
fn features_that_an_rclpy_node_publishes_are_enough() {
    in_time(|| {
        let domain = 91;
        let mut estimator = command("estimator", domain);
        let parameters = [
            "camera.fx:=819.2",
            "camera.fy:=819.2",
            "camera.cx:=511.5",
            "camera.cy:=511.5",
            "solve_period:=1.0",
        ];
        estimator.arg("--ros-args");
        for parameter in parameters {
            estimator.args(["-p", parameter]);
        }
        let mut estimator = Running::start(estimator);
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
