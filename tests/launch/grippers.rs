//! A gripper over DDS: an rclpy node closes it on a tumbling satellite by either action, and hears of contacts and of the
//! wrench at the wrist.

use serde_json::{Value, json};

use crate::{
    commanders::{ABORTED, SUCCEEDED},
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    observer::{DIAGNOSTICS, JOINT_STATE, diagnosed, fresh, numbers},
    peer::Peer,
    process::{Running, command, source},
    waiting::{PATIENCE, eventually},
};

const SINGLE: [&str; 2] = ["hand/gripper_cmd", "control_msgs/action/GripperCommand"];
const PARALLEL: [&str; 2] = [
    "hand/parallel_gripper_cmd",
    "control_msgs/action/ParallelGripperCommand",
];
const CANCELED: u64 = 5;
/// Joint position at which the fingers touch the bar: the gap of 60 mm less its radius \[m\].
const AT_BAR: f64 = 0.045;

fn start(domain: u16, more: &[&str]) -> (Running, Peer) {
    let mut node = command("dynamics", domain);
    node.args(["--ros-args", "--params-file"])
        .arg(source("config/gripping.yaml"))
        .args(["-p", "hand.close_at:=-1.0", "-p", "duration:=0.0"]);
    for parameter in more {
        node.args(["-p", parameter]);
    }
    // The peer first: what it needs may have to be compiled, and the satellite tumbles out of the fingers.
    let mut peer = peer_with_interfaces("operator", domain);
    let node = Running::start(node);
    peer.subscribe("joint_states", JOINT_STATE, "reliable");
    peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
    (node, peer)
}

fn act(
    peer: &mut Peer,
    [action, kind]: [&str; 2],
    goal: &Value,
    cancel_after: Option<u64>,
) -> Value {
    let outcome = peer.does(json!({
        "do": "act", "action": action, "type": kind, "goal": goal, "cancel_after": cancel_after,
    }));
    println!(
        "{action} {goal}: {} {}",
        outcome["status"], outcome["result"]
    );
    outcome
}

fn single(position: f64, max_effort: f64) -> Value {
    json!({"command": {"position": position, "max_effort": max_effort}})
}

fn parallel(name: &[&str], position: &[f64], velocity: &[f64], effort: &[f64]) -> Value {
    json!({"command": {"name": name, "position": position, "velocity": velocity, "effort": effort}})
}

/// The finger's position now \[m\].
fn finger(peer: &mut Peer) -> f64 {
    let state = fresh(peer, "joint_states", 1).pop().expect("one");
    let names = state["name"].as_array().expect("names");
    let finger = names.iter().position(|name| name == "left_finger_joint");
    numbers(&state["position"])[finger.expect("the finger")]
}

fn dot(a: &Value, b: &Value) -> f64 {
    (["x", "y", "z"]
        .iter()
        .map(|axis| number(&a[axis]) * number(&b[axis])))
    .sum()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

// Would break if goals did not end, if a stalled gripper stopped to press, or if contacts were not those of the fingers.
#[test]
fn an_operator_closes_a_gripper_on_a_tumbling_satellite() {
    repeat_if_late(|| {
        let (mut node, mut peer) = start(216, &[]);
        peer.subscribe("contacts", "ros_gz_interfaces/msg/Contacts", "reliable");
        peer.subscribe(
            "wrist/wrench",
            "geometry_msgs/msg/WrenchStamped",
            "reliable",
        );

        // In free space the goal is reached.
        let outcome = act(&mut peer, SINGLE, &single(0.02, 50.0), None);
        assert_eq!(outcome["status"], SUCCEEDED);
        assert_eq!(outcome["result"]["reached_goal"], true);
        assert_eq!(outcome["result"]["stalled"], false);
        assert!((number(&outcome["result"]["position"]) - 0.02).abs() <= 0.01);
        assert!(outcome["feedback"].as_array().expect("a list").len() > 1);

        // On the bar it stalls, with the effort of the goal; that is a success, as the scenario says.
        let outcome = act(&mut peer, SINGLE, &single(0.06, 120.0), None);
        assert_eq!(outcome["status"], SUCCEEDED);
        let result = &outcome["result"];
        assert_eq!(
            (&result["stalled"], &result["reached_goal"]),
            (&json!(true), &json!(false))
        );
        assert!(
            (number(&result["position"]) - AT_BAR).abs() < 1e-3,
            "{result}"
        );
        eventually("the effort of the goal", PATIENCE, || {
            let outcome = act(&mut peer, SINGLE, &single(0.06, 120.0), None);
            ((number(&outcome["result"]["effort"]) - 120.0).abs() < 1e-6).then_some(())
        });

        // Each finger presses on the bar with half of the effort; the sum is over its points.
        let contacts = fresh(&mut peer, "contacts", 1).pop().expect("contacts");
        for finger in ["left_finger", "right_finger"] {
            let all = contacts["contacts"].as_array().expect("a list");
            let mut forces = 0.0;
            for contact in all {
                let names = [
                    &contact["collision1"]["name"],
                    &contact["collision2"]["name"],
                ];
                if names
                    .iter()
                    .any(|name| name.as_str().is_some_and(|n| n.contains(finger)))
                {
                    assert!(
                        names
                            .iter()
                            .any(|n| n.as_str().is_some_and(|n| n.contains("satellite")))
                    );
                    let normals = contact["normals"].as_array().expect("a list");
                    let wrenches = contact["wrenches"].as_array().expect("a list");
                    for (normal, wrench) in normals.iter().zip(wrenches) {
                        forces += dot(normal, &wrench["body_1_wrench"]["force"]);
                    }
                }
            }
            assert!(
                (forces - 60.0).abs() < 1.0,
                "{finger}: {forces} N in {contacts}"
            );
        }
        let wrench = fresh(&mut peer, "wrist/wrench", 1).pop().expect("a wrench");
        assert_eq!(wrench["header"]["frame_id"], "tool0");
        for part in ["force", "torque"] {
            for axis in ["x", "y", "z"] {
                assert!(
                    number(&wrench["wrench"][part][axis]).is_finite(),
                    "{wrench}"
                );
            }
        }

        // Commands of the arm do not move the fingers.
        let open = json!({"name": ["joint1", "left_finger_joint"], "velocity": [0.0, -0.05]});
        peer.does(json!({"do": "publish", "topic": "joint_commands", "type": JOINT_STATE, "message": open}));
        fresh(&mut peer, "joint_states", 30);
        assert!((finger(&mut peer) - AT_BAR).abs() < 1e-3);

        // The other action opens it, at the rate that it is asked for, and a cancelled goal stops it.
        let joint = ["left_finger_joint"];
        let slow = parallel(&joint, &[0.0], &[0.01], &[]);
        let outcome = act(&mut peer, PARALLEL, &slow, Some(10));
        assert_eq!(outcome["status"], CANCELED);
        let stopped = number(&outcome["result"]["state"]["position"][0]);
        assert!(stopped > 0.01 && stopped < AT_BAR, "{stopped}");
        fresh(&mut peer, "joint_states", 50);
        assert!((finger(&mut peer) - stopped).abs() < 2e-3);
        let outcome = act(
            &mut peer,
            PARALLEL,
            &parallel(&[], &[0.0], &[], &[40.0]),
            None,
        );
        assert_eq!(outcome["status"], SUCCEEDED);
        assert_eq!(outcome["result"]["state"]["name"], json!(joint));
        assert!(number(&outcome["result"]["state"]["position"][0]) <= 0.01);
        node.interrupt().well();
    });
}

// Would break if what is wrong with a goal were executed, or its reason were lost.
#[test]
fn wrong_goals_are_refused_and_stalling_may_be_a_failure() {
    repeat_if_late(|| {
        let (mut node, mut peer) = start(217, &["hand.allow_stalling:=false"]);
        for (which, goal, words) in [
            (
                SINGLE,
                single(0.02, -1.0),
                "max_effort is -1; it must be above 0",
            ),
            (
                SINGLE,
                json!({"command": {"position": null, "max_effort": 1.0}}),
                "position is NaN; it must be finite",
            ),
            (
                PARALLEL,
                parallel(&["elbow"], &[0.0], &[], &[]),
                "'elbow'; the gripper's joint is 'left_finger_joint'",
            ),
            (
                PARALLEL,
                parallel(&[], &[0.0, 0.1], &[], &[]),
                "position has 2 numbers",
            ),
        ] {
            let outcome = act(&mut peer, which, &goal, None);
            assert_eq!(outcome, json!({"accepted": false}));
            diagnosed(&mut peer, "dynamics: gripper hand", |level, text| {
                level == 1 && text.contains(words)
            });
        }
        let outcome = act(&mut peer, SINGLE, &single(0.06, 0.0), None);
        assert_eq!(outcome["status"], ABORTED);
        assert_eq!(outcome["result"]["stalled"], true);
        // A limit beyond the gripper's own, and a goal beyond its stroke, are cut.
        let outcome = act(&mut peer, SINGLE, &single(-5.0, 1e6), None);
        assert_eq!(outcome["status"], SUCCEEDED);
        assert!(node.interrupt().well().stderr.contains("goal refused"));
    });
}
