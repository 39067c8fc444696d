//! Images of a tumbling ball from a camera that is not fuyu's, and the results of estimator nodes.

use fuyu::{
    estimation::free_body::FreeRotation,
    spatial::Pose,
    vision::{BodyPoint, FeatureCamera, FeatureCameraConfig},
};
use nalgebra::{Matrix3, Translation3, UnitQuaternion, Vector3};
use serde_json::{Value, json};

use crate::{
    peer::Peer,
    process::{Running, command},
};

/// True motion of the ball in [`recorded`].
pub fn truth() -> FreeRotation {
    let inertia = Matrix3::from_diagonal(&Vector3::new(7.0, 4.0, 3.0));
    let rate = Vector3::new(0.1, 0.35, 0.2);
    FreeRotation::new(&inertia, UnitQuaternion::identity(), &rate, 0.0).unwrap()
}

/// Frames of a tumbling ball as a camera at rest sees them, 10 a second, as messages in JSON.
pub fn recorded(frames: u32) -> Vec<Value> {
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
            "header": header(k),
            "ids": seen.features.iter().map(|f| f.id).collect::<Vec<_>>(),
            "u": list(|f| f.u), "v": list(|f| f.v),
        })
    };
    (0..frames).map(frame).collect()
}

/// The header of frame `k`.
fn header(k: u32) -> Value {
    json!({"frame_id": "their_camera", "stamp": {"sec": k / 10, "nanosec": k % 10 * 100_000_000}})
}

/// The points of the ball in [`recorded`] at the time of frame `k`, as a depth camera measures them.
pub fn cloud(k: u32) -> Value {
    let R_CB = truth().attitude(0.1 * f64::from(k)).to_rotation_matrix();
    let points = BodyPoint::on_sphere(20, 0.45, 5);
    let data: Vec<u8> = points
        .iter()
        .map(|point| R_CB * point.p_B + Vector3::new(0.0, 0.0, 0.9))
        .flat_map(|p_C| [p_C.x, p_C.y, p_C.z])
        .flat_map(|value| (value as f32).to_le_bytes())
        .collect();
    let field = |name: &str, offset: u32| json!({"name": name, "offset": offset, "datatype": 7, "count": 1});
    json!({
        "header": header(k),
        "height": 1, "width": 20, "fields": [field("x", 0), field("y", 4), field("z", 8)],
        "is_bigendian": false, "point_step": 12, "row_step": 240, "data": data, "is_dense": true,
    })
}

pub fn publish(peer: &mut Peer, message: &Value) {
    peer.does(json!({
        "do": "publish", "topic": "camera/features", "type": "fuyu_msgs/msg/FeatureTracks",
        "message": message, "qos_name": "sensor_data"
    }));
}

/// Starts an estimator node with the calibration of [`recorded`], in a namespace and with further parameters.
pub fn estimator(domain: u16, namespace: &str, parameters: &[&str]) -> Running {
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

pub fn stamp(message: &Value) -> f64 {
    let stamp = &message["header"]["stamp"];
    stamp["sec"].as_f64().unwrap() + 1e-9 * stamp["nanosec"].as_f64().unwrap()
}

/// Errors of the angular velocities on `topic` for times after `from` \[rad/s\].
pub fn rate_errors(peer: &mut Peer, topic: &str, from: f64) -> Vec<f64> {
    let reported = peer.receive(topic, 1);
    let reported = reported.iter().map(|m| &m["message"]);
    let error = |m: &Value| {
        let w = &m["vector"];
        let w = ["x", "y", "z"].map(|axis| w[axis].as_f64().unwrap());
        (Vector3::from(w) - truth().angular_velocity(stamp(m))).norm()
    };
    // Without frames the estimator extrapolates to other times; only estimates at the time of a frame are compared.
    let of_a_frame = |m: &&Value| (10.0 * stamp(m) - (10.0 * stamp(m)).round()).abs() < 1e-6;
    let reported = reported.filter(of_a_frame);
    reported.filter(|m| stamp(m) > from).map(error).collect()
}

/// `Some` if an angular velocity with the stamp `time` was published on `topic`.
pub fn told_for(peer: &mut Peer, topic: &str, time: f64) -> Option<()> {
    let reported = peer.does(json!({"do": "wait", "topic": topic, "count": 1, "timeout": 1.0}));
    let mut reported = reported.as_array().expect("a list").iter();
    reported
        .any(|m| (stamp(&m["message"]) - time).abs() < 1e-6)
        .then_some(())
}

/// Processor time that a process has used \[s\].
pub fn cpu_time(process: &Running) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.id())).expect("it runs");
    // The process name, in parentheses, may contain blanks. The 12th and 13th fields after it are the times in user and
    // system mode, in hundredths of a second.
    let (_, rest) = stat.rsplit_once(')').expect("a name");
    let ticks = rest.split_whitespace().skip(11).take(2);
    ticks
        .map(|t| t.parse::<f64>().expect("ticks") / 100.0)
        .sum()
}

pub fn rms(errors: &[f64]) -> f64 {
    let squares: f64 = errors.iter().map(|e| e * e).sum();
    (squares / errors.len() as f64).sqrt()
}

pub const VECTOR: &str = "geometry_msgs/msg/Vector3Stamped";
