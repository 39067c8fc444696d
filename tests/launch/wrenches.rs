//! Wrenches from outside: the topic and the services, from a real rclpy node, and what the checks of the bag say.

use serde_json::{Value, json};
use std::{fs, path::PathBuf};

use crate::{
    commanders::{POSTURE, duration},
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    observer::{DIAGNOSTICS, fresh, now, reported},
    peer::Peer,
    process::{Check, Running, read, source},
    waiting::{PATIENCE, eventually},
};

const WRENCH: &str = "geometry_msgs/msg/WrenchStamped";

/// A scenario of the arm alone, with a recorder.
fn scenario() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("arm.yaml");
    let urdf = source("urdf/seven_joints.urdf");
    let text = format!(
        "dynamics:\n  ros__parameters:\n    urdf: {}\n    initial_joint_positions: {POSTURE:?}\nrecorder:\n  ros__parameters: {{}}\n",
        urdf.display()
    );
    fs::write(&path, text).expect("a file");
    (folder, path)
}

// A push of a known impulse, and a streamed wrench: momentum changes by force times time, and the checks of the bag
// account for it. Would break if the bag's residuals ignored the impulse, or if a wrench ended at the next state rather
// than on time.
#[test]
fn wrenches_change_momentum_and_the_residuals_account_for_it() {
    repeat_if_late(|| {
        let (_folder, config) = scenario();
        let mut launch = Running::launch(118, &config, &["--duration", "600"]);
        let mut peer = peer_with_interfaces("commander", 118);
        let momentum = "fuyu_msgs/msg/Momentum";
        peer.subscribe("ground_truth/momentum", momentum, "reliable");
        peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        peer.receive("ground_truth/momentum", 10);
        let call = |peer: &mut Peer, service: &str, kind: &str, request: Value| {
            let kind = format!("fuyu_msgs/srv/{kind}");
            let answer = peer
                .does(json!({"do": "call", "service": service, "type": kind, "request": request}));
            answer["response"].clone()
        };
        let push = json!({
            "link_name": "tool0", "reference_frame": "world",
            "wrench": {"force": {"x": 4.0, "y": -2.0, "z": 1.0}}, "duration": duration(0.505),
        });
        let answer = call(&mut peer, "apply_link_wrench", "ApplyLinkWrench", push);
        assert_eq!(answer["success"], true, "{answer}");
        let linear = |peer: &mut Peer| -> Vec<f64> {
            let last = fresh(peer, "ground_truth/momentum", 1).pop().expect("one");
            ["x", "y", "z"]
                .map(|axis| last["linear"][axis].as_f64().expect("a number"))
                .to_vec()
        };
        let pushed = eventually("the end of the push", PATIENCE, || {
            let (a, b) = (linear(&mut peer), linear(&mut peer));
            (a == b && a[0] > 1.0).then_some(a)
        });
        for (found, expected) in pushed.iter().zip([4.0, -2.0, 1.0]) {
            let off = found - 0.505 * expected;
            println!("momentum {found} N s, off by {off:.1e}");
            assert!(off.abs() < 1e-12, "{pushed:?}");
        }
        for (request, words) in [
            (
                json!({"link_name": "hand", "duration": duration(1.0)}),
                "link_name is 'hand'; give a link of the robot: base_link, link1",
            ),
            (json!({"link_name": "link7"}), "duration is 0"),
            (
                json!({"link_name": "link7", "duration": duration(1.0), "wrench": {"torque": {"x": null}}}),
                "torque.x is NaN",
            ),
            (
                json!({"link_name": "link7", "reference_frame": "map", "duration": duration(1.0)}),
                "reference_frame is 'map'",
            ),
        ] {
            let answer = call(&mut peer, "apply_link_wrench", "ApplyLinkWrench", request);
            assert_eq!(answer["success"], false, "{answer}");
            let said = answer["status_message"].as_str().expect("a text");
            assert!(said.contains(words), "{said}");
        }
        // A wrench in the axes of a link, as long as it is sent; then one without a link.
        let stream = |frame: &str| {
            json!({
                "do": "publish", "topic": "wrench", "type": WRENCH,
                "message": {"header": {"frame_id": frame}, "wrench": {"torque": {"z": 2.0}}},
            })
        };
        for _ in 0..10 {
            peer.does(stream("link2"));
            fresh(&mut peer, "ground_truth/momentum", 3);
        }
        let since = now();
        peer.does(stream(""));
        eventually("the refusal of a wrench without a link", PATIENCE, || {
            let words = "frame_id is ''; give a link of the robot";
            reported(
                &mut peer,
                "dynamics: wrenches",
                since,
                0.0,
                |level, text| level >= 1 && text.contains(words),
            )
        });
        // One without end, until it is cleared.
        let on = json!({"link_name": "base_link", "wrench": {"force": {"y": 1.0}}, "duration": {"sec": -1, "nanosec": 0}});
        assert_eq!(
            call(&mut peer, "apply_link_wrench", "ApplyLinkWrench", on)["success"],
            true
        );
        fresh(&mut peer, "ground_truth/momentum", 100);
        let cleared = call(
            &mut peer,
            "clear_link_wrenches",
            "ClearLinkWrenches",
            json!({"link_name": "base_link"}),
        );
        assert_eq!(
            cleared["status_message"], "1 wrenches have ended",
            "{cleared}"
        );
        launch.interrupt().well();

        let check = Check::of(&launch.bag());
        for name in ["linear momentum", "angular momentum"] {
            let change = check.value(name);
            println!("{name}: {change:.1e} unexplained");
            assert!(change < 1e-12, "{name} {change}");
        }
        let energy = check.value("energy balance");
        println!("energy balance: {energy:.1e}");
        assert!(energy < 1e-3, "{energy}");
        let all = read::<fuyu::msg::fuyu_msgs::Momentum>(&launch.bag(), "/ground_truth/momentum");
        let last = all.last().expect("some");
        // A joint has run into its stop.
        assert!(last.dissipated_energy > 0.1, "{last:?}");
        let spin = &last.angular;
        assert!(spin.x.abs() + spin.y.abs() + spin.z.abs() > 1.0, "{spin:?}");
        let impulses = read::<fuyu::msg::fuyu_msgs::ExternalImpulse>(
            &launch.bag(),
            "/ground_truth/external_impulse",
        );
        assert!(impulses.len() > 100);
    });
}
