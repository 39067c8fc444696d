//! Wrong messages on topics are refused, reported in diagnostics, and have no other effect.

use serde_json::{Value, json};

use crate::{
    lateness::repeat_if_late,
    observer::{DIAGNOSTICS, JOINT_STATE, POSE, diagnosed, fresh, now, numbers, reported},
    own_controller::without_controller,
    peer::Peer,
    process::{Check, Running, source},
    waiting::{PATIENCE, eventually},
};

const WARN: u64 = 1;

fn all_finite(states: &[Value]) {
    for state in states {
        for field in ["position", "velocity", "effort"] {
            let values = numbers(&state[field]);
            assert!(
                values.len() == 6 && values.iter().all(|x| x.is_finite()),
                "{state}"
            );
        }
    }
}

fn names() -> Value {
    json!(["joint1", "joint2", "joint3", "joint4", "joint5", "joint6"])
}

/// Sends a wrong message until a part of a node warns of it in these words: another warning on a late machine
/// may replace this one before it is published.
fn warned(peer: &mut Peer, part: &str, send: &Value, words: &[&str]) -> String {
    let since = now();
    let reported = eventually(part, PATIENCE, || {
        peer.does(send.clone());
        reported(peer, part, since, 5.0, |level, text| {
            level == WARN && words.iter().all(|word| text.contains(word))
        })
    });
    println!("{reported}");
    reported
}

#[test]
fn wrong_messages_are_refused_and_named() {
    repeat_if_late(|| {
        let domain = 82;
        let mut launch = Running::gently(domain, &source("config/positioning.yaml"));
        let mut peer = Peer::start("fault", domain);
        peer.subscribe("joint_states", JOINT_STATE, "reliable");
        peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        let state = &peer.receive("joint_states", 1)[0]["message"];
        assert_eq!(state["name"], names());
        diagnosed(&mut peer, "dynamics: commands", |level, _| level == 0);

        // null is NaN.
        for (message, words) in [
            (
                json!({"name": ["joint2"], "effort": [null]}),
                ["joint2", "effort", "NaN"],
            ),
            (
                json!({"name": ["elbow"], "effort": [1.0]}),
                ["elbow", "joint1", "joint6"],
            ),
            (
                json!({"name": names(), "effort": [1.0, 2.0]}),
                ["6 names", "2 efforts", "effort"],
            ),
            (
                json!({"name": [], "effort": [1.0]}),
                ["no joint", "joint1", "joint6"],
            ),
            (json!({}), ["no joint", "joint1", "joint6"]),
            (
                json!({"name": ["joint1", "joint1"], "effort": [1.0, 2.0]}),
                ["joint1", "twice", "joint1"],
            ),
        ] {
            let send = json!({"do": "publish", "topic": "joint_commands", "type": JOINT_STATE, "message": message});
            let reported = warned(&mut peer, "dynamics: commands", &send, &words);
            assert!(reported.contains("/joint_commands"), "{reported}");
        }
        let position = json!({"x": 3.0, "y": 5.0, "z": 0.5});
        let upright = json!({"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0});
        let world = json!({"frame_id": "world"});
        for (message, words) in [
            (
                json!({"header": world, "pose": {"position": {"x": 3.0, "y": null}, "orientation": upright}}),
                ["position", "NaN"],
            ),
            (
                json!({"header": world, "pose": {"position": position, "orientation": {"w": 0.5}}}),
                ["orientation", "0.5"],
            ),
            (
                json!({"header": {"frame_id": "base_link"}, "pose": {"position": position, "orientation": upright}}),
                ["frame_id", "base_link"],
            ),
        ] {
            let send =
                json!({"do": "publish", "topic": "goal_pose", "type": POSE, "message": message});
            let reported = warned(&mut peer, "camera: goal", &send, &words);
            assert!(reported.contains("/goal_pose"), "{reported}");
        }
        // The control loop has continued meanwhile, and the warning disappears when its cause does.
        all_finite(&fresh(&mut peer, "joint_states", 50));
        diagnosed(&mut peer, "dynamics: commands", |level, _| level == 0);
        diagnosed(&mut peer, "controller: control", |level, _| level == 0);
        let ended = launch.interrupt().well();
        assert!(!ended.stderr.contains("panic"), "{}", ended.stderr);
        // Momentum is conserved and every message can be decoded; the bag also contains the peer's wrong messages.
        let check = Check::of(&launch.bag());
        check.momentum_holds();
        assert_eq!(check.value("messages that cannot be decoded"), 0.0);
        for failed in check.failed() {
            let expected = failed.contains("tip error") || failed.contains("/joint_commands");
            assert!(expected || failed.contains("goal_pose"), "{failed}");
        }
    });
}

#[test]
fn without_commands_efforts_end_and_come_back() {
    repeat_if_late(|| {
        let domain = 83;
        let (_folder, config) = without_controller();
        let mut launch = Running::launch(domain, &config, &["--duration", "600"]);
        let mut peer = Peer::start("pilot", domain);
        peer.subscribe("joint_states", JOINT_STATE, "reliable");
        peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        peer.receive("joint_states", 1);
        let push = |peer: &mut Peer, effort: f64| {
            let sent = now();
            let command = json!({"name": ["joint1"], "effort": [effort]});
            peer.does(json!({"do": "publish", "topic": "joint_commands", "type": JOINT_STATE, "message": command}));
            // In the middle of a run of states between two commands the effort is the last one. It acts for no
            // longer than the timeout, so every state since counts.
            let state = eventually("the command acts", PATIENCE, || {
                let wait =
                    json!({"do": "wait", "topic": "joint_states", "since": sent, "timeout": 1.0});
                let states = peer.does(wait);
                let mut states = states.as_array().unwrap().iter().map(|s| &s["message"]);
                let state = states.rfind(|state| numbers(&state["effort"])[0] == effort);
                state.cloned()
            });
            assert_eq!(numbers(&state["effort"])[1..], [0.0; 5]);
        };
        for _ in 0..20 {
            push(&mut peer, 3.0);
        }
        let stopped = now();
        let reported = diagnosed(&mut peer, "dynamics: commands", |level, text| {
            level == WARN && text.contains("command_timeout")
        });
        println!("{reported}");
        assert!(
            reported.contains("command_timeout is 0.5 s") && reported.contains("joint_commands"),
            "{reported}"
        );
        let coasting = fresh(&mut peer, "joint_states", 10);
        all_finite(&coasting);
        for state in &coasting {
            assert_eq!(
                numbers(&state["effort"]),
                [0.0; 6],
                "{:.1} s later",
                now() - stopped
            );
        }
        // The servicer's joints have no damping: a free arm does not come to rest by itself.
        assert!(
            numbers(&coasting[9]["velocity"])[0] > 1e-4,
            "{}",
            coasting[9]
        );
        push(&mut peer, -2.0);
        launch.interrupt().well();
        Check::of(&launch.bag()).momentum_holds();
    });
}
