//! A robot with flexible parts and wheels in the graph: topics, commands of wheels and thrusters, energy of the recording.

use fuyu::msg::{
    fuyu_msgs::{AppendageStates, ExternalImpulse},
    sensor_msgs::JointState,
};
use serde_json::json;
use std::time::Duration;

use crate::{
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    lockstep::{simulated, states},
    observer::{DIAGNOSTICS, fresh, now, reported},
    process::{Check, Running, read, scenario, source},
    waiting::{PATIENCE, eventually},
};

const IMPULSE: &str = "ground_truth/external_impulse";
const CONFIG: &str = "config/flexible_servicer.yaml";

// Nothing is commanded: every state is that of `fuyu simulate`, to the last bit, and strain energy becomes kinetic energy and
// modal damping. Without either the balance would be off by a third of a joule.
#[test]
fn bent_panels_vibrate_over_dds_as_in_the_simulation() {
    let faster = ("duration: 30.0", "duration: 6.0\n    real_time_factor: 6.0");
    let (_folder, config) = scenario(CONFIG, &[faster]);
    let expected = simulated(&config, "6");
    let mut launch = Running::launch(185, &config, &[]);
    launch.wait(Duration::from_secs(60)).well();
    let bag = launch.bag();
    assert_eq!(states(&bag), expected);

    let mut deformation = read::<AppendageStates>(&bag, "/ground_truth/appendages");
    deformation.dedup();
    assert_eq!(deformation.len(), 601);
    let first = &deformation[0];
    assert_eq!(first.name, ["solar_plus", "solar_minus"]);
    assert_eq!((first.modes.as_slice(), first.mu[0]), (&[4, 4][..], 0.5));
    assert!((first.strain_energy - 0.363_884_609).abs() < 1e-8);
    // b1 moves the tip by 2 / sqrt(48) m per unit, as b2 does; t1 does not move its middle.
    let tip = first.tip_displacement[0].z - 0.55 * 2.0 / 48f64.sqrt();
    assert!(tip.abs() < 1e-9, "{tip}");
    assert_eq!(
        read::<JointState>(&bag, "/wheel_states")[0].name[2],
        "wheel_z"
    );
    let check = Check::of(&bag);
    check.momentum_holds();
    assert!(check.failed().is_empty(), "{:?}", check.failed());
    assert!(check.value("energy balance") < 1e-6);
}

// Camera and controller answer every state of a robot with panels.
#[test]
fn a_lockstep_run_with_panels_equals_the_simulated_one() {
    repeat_if_late(|| {
        let panels = std::fs::read_to_string(source(CONFIG)).expect("a scenario");
        let (_, panels) = panels.split_once("    appendages:").expect("panels");
        let (panels, _) = panels.split_once("    wheels:").expect("wheels after them");
        let with_panels = format!("    appendages:{panels}camera:\n");
        let changes = [("camera:\n", with_panels.as_str())];
        let (_folder, config) = scenario("config/positioning.yaml", &changes);
        let expected = simulated(&config, "5");
        let args = ["--lockstep", "--duration", "5"];
        let mut launch = Running::launch(187, &config, &args);
        launch.wait(5 * PATIENCE).well();
        assert_eq!(states(&launch.bag()), expected);
        assert_eq!(expected.len(), 501);
    });
}

// A wheel and a thruster commanded by rclpy: held until the commands end, refused with the reason.
#[test]
fn wheels_and_thrusters_are_commanded_by_name() {
    repeat_if_late(|| {
        let thruster = "    thrusters: [aft]\n    aft:\n      direction: [0.0, 1.0, 0.0]\n      thrust: 20.0\n    wheels:";
        let (_folder, config) = scenario(
            CONFIG,
            &[
                ("    wheels:", thruster),
                ("duration: 30.0", "duration: 0.0"),
            ],
        );
        let mut launch = Running::launch(186, &config, &["--duration", "600"]);
        let mut peer = peer_with_interfaces("commander", 186);
        peer.subscribe("wheel_states", "sensor_msgs/msg/JointState", "reliable");
        peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        peer.subscribe(IMPULSE, "fuyu_msgs/msg/ExternalImpulse", "reliable");
        peer.receive("wheel_states", 10);
        let wheel = |name: &str| {
            json!({
                "do": "publish", "topic": "wheel_commands", "type": "sensor_msgs/msg/JointState",
                "message": {"name": [name], "effort": [0.5]},
            })
        };
        peer.does(wheel("wheel_y"));
        let speed = |peer: &mut crate::peer::Peer| {
            let last = fresh(peer, "wheel_states", 1).pop().expect("one");
            let of = |field: &str| last[field][1].as_f64().expect("a number");
            (of("velocity"), of("effort"))
        };
        eventually("the wheel turns", PATIENCE, || {
            let (speed, torque) = speed(&mut peer);
            (speed > 0.1 && (torque - 0.5).abs() < 1e-9).then_some(())
        });
        // No further command: after command_timeout the torque is zero, and the wheel goes on turning.
        let coasting = eventually("the end of the torque", PATIENCE, || {
            let (speed, torque) = speed(&mut peer);
            (torque == 0.0).then_some(speed)
        });
        assert!(coasting > 1.0 && coasting < 3.0, "{coasting}");
        let since = now();
        peer.does(wheel("wheel_w"));
        eventually("the refusal of an unknown wheel", PATIENCE, || {
            let words = "'wheel_w' is not one of wheel_x, wheel_y, wheel_z";
            let name = "dynamics: wheels and thrusters";
            reported(&mut peer, name, since, 0.0, |level, text| {
                level >= 1 && text.contains(words)
            })
        });
        let mut fire = |seconds: f64| {
            peer.does(json!({
                "do": "publish", "topic": "thruster_commands", "type": "fuyu_msgs/msg/ThrusterCommands",
                "message": {"name": ["aft"], "on_time": [seconds]},
            }));
            fresh(&mut peer, "wheel_states", 100);
        };
        let begin = now();
        // The first message of a publisher may come three seconds late (docs/upstream.md); here it does nothing.
        fire(0.0);
        fire(0.25);
        eventually("the end of the thrust", PATIENCE, || {
            let wait = json!({"do": "wait", "topic": IMPULSE, "since": begin, "timeout": 0.5});
            let impulses = peer.does(wait);
            let linear = &impulses.as_array()?.last()?["message"]["linear"];
            let square = |axis: &str| linear[axis].as_f64().map(|v| v * v);
            let norm = (square("x")? + square("y")? + square("z")?).sqrt();
            (norm > 4.99).then_some(())
        });
        launch.interrupt().well();

        let bag = launch.bag();
        let impulse = read::<ExternalImpulse>(&bag, "/ground_truth/external_impulse");
        let linear = &impulse.last().expect("the thruster was on").linear;
        let norm = (linear.x.powi(2) + linear.y.powi(2) + linear.z.powi(2)).sqrt();
        // 20 N for .25 s, on a base that turns by a milliradian.
        assert!((norm - 5.0).abs() < 1e-5, "{norm}");
        let check = Check::of(&bag);
        for name in ["linear momentum", "angular momentum"] {
            assert!(check.value(name) < 1e-12, "{name} {}", check.value(name));
        }
        assert!(check.value("energy balance") < 1e-3);
    });
}
