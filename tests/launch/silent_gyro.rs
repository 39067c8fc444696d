//! A gyro that falls silent: the controller reports it, stops using the last sample, and uses the gyro again when it
//! returns.

use nalgebra::Vector3;
use serde_json::{Value, json};

use crate::{
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    observer::{
        DIAGNOSTICS, JOINT_STATE, diagnosed, fresh, now, numbers, reported, tip_in_world, watch_tip,
    },
    own_controller::without_controller,
    peer::Peer,
    process::{GENTLE, Running, command, source},
    waiting::{PATIENCE, eventually},
};

const IMU: &str = "sensor_msgs/msg/Imu";
const STATE: &str = "fuyu_msgs/msg/ControllerState";
const GYRO: &str = "controller: gyro";
/// Of `config/positioning.yaml` \[m\].
const GOAL: [f64; 3] = [3.662078985521887, 5.4440225463358125, 0.37996776327278203];
/// What the gyro measures before it falls silent \[rad/s\]: wrong by so much that acting on it shows.
const WILD: f64 = 0.5;

/// Publishes a gyro sample with the stamp of the newest joint state.
fn measure(peer: &mut Peer, rate: f64) {
    let state = fresh(peer, "joint_states", 1).pop().expect("a state");
    let message = json!({
        "header": state["header"],
        "angular_velocity": {"x": rate, "y": 0.0, "z": 0.0},
    });
    peer.does(json!({"do": "publish", "topic": "relayed_imu", "type": IMU, "message": message}));
}

/// Keeps the gyro measuring until the controller reports that it is used.
fn used(peer: &mut Peer, rate: f64) {
    eventually("the gyro is used", PATIENCE, || {
        let since = now();
        for _ in 0..5 {
            measure(peer, rate);
        }
        reported(peer, GYRO, since, 0.5, |level, _| level == 0)
    });
}

/// Difference between the position error that the controller acts on and the true one \[m\].
fn misjudged(peer: &mut Peer) -> f64 {
    let state = fresh(peer, "controller/state", 1).pop().expect("a state");
    let acted_on = state["position_error_norm"].as_f64().expect("a number");
    let tip = tip_in_world(peer, "").translation.vector;
    ((tip - Vector3::from(GOAL)).norm() - acted_on).abs()
}

// Breaks when the last sample of a gyro is used for ever: it would carry the goal away by what the camera is late.
#[test]
fn a_gyro_that_falls_silent_is_reported_and_not_used() {
    repeat_if_late(|| {
        let domain = 12;
        let (_folder, config) = without_controller();
        let late = [
            "--duration",
            "600",
            "--ros-args",
            "-p",
            "camera:latency:=0.1",
        ];
        let mut launch = Running::launch(domain, &config, &late);
        let mut controller = command("controller", domain);
        // Without the name of the node before the parameter.
        let gentle = GENTLE.map(|word| word.trim_start_matches("controller:"));
        controller
            .args(["--ros-args", "--params-file"])
            .arg(source("config/positioning.yaml"))
            .args(["-r", "imu:=relayed_imu", "-p", "prediction:=latency"])
            .args(&gentle[1..]);
        let mut controller = Running::start(controller);
        let mut peer = peer_with_interfaces("gyro", domain);
        watch_tip(&mut peer, "");
        peer.subscribe("joint_states", JOINT_STATE, "reliable");
        peer.subscribe("controller/state", STATE, "reliable");
        peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        let missing = |level: u64, text: &str| level == 1 && text.contains("no imu message");
        diagnosed(&mut peer, GYRO, missing);

        used(&mut peer, WILD);
        let wild = eventually("the wrong rate shows", PATIENCE, || {
            (0..20).for_each(|_| measure(&mut peer, WILD));
            let misjudged = misjudged(&mut peer);
            (misjudged > 0.1).then_some(misjudged)
        });
        let stale = diagnosed(&mut peer, GYRO, |level, text| {
            level == 1 && text.contains("measurement_timeout is 1 s")
        });
        assert!(stale.contains("zero angular momentum"), "{stale}");
        println!("{stale}");
        // The tip is still controlled, by what is right here: the robot has no momentum.
        diagnosed(&mut peer, "controller: control", |level, text| {
            level == 0 && text.starts_with("steering")
        });
        let after = misjudged(&mut peer);
        println!(
            "the position error is misjudged by {wild:.3} m, and by {after:.3} m without gyro"
        );
        assert!(after < 0.05, "{after}");
        let finite = |state: &Value| numbers(&state["effort"]).iter().all(|e| e.is_finite());
        assert!(fresh(&mut peer, "joint_states", 20).iter().all(finite));

        used(&mut peer, 0.0);
        launch.interrupt().well();
        let ended = controller.interrupt().well();
        assert!(!ended.stderr.contains("ERROR"), "{}", ended.stderr);
    });
}
