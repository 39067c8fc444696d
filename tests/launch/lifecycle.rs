//! Dynamics and controller as managed nodes, whose states a real rclpy node changes; and the end by SIGTERM.

use fuyu::msg::sensor_msgs::JointState;
use serde_json::{Value, json};
use std::{thread, time::Duration};

use crate::{
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    observer::{DIAGNOSTICS, JOINT_STATE, diagnosed, fresh},
    peer::Peer,
    process::{Running, command, read, source},
    waiting::{PATIENCE, eventually},
};

const UNCONFIGURED: u64 = 1;
const INACTIVE: u64 = 2;
const ACTIVE: u64 = 3;
const FINALIZED: u64 = 4;

fn call(peer: &mut Peer, node: &str, service: &str, kind: &str, request: Value) -> Value {
    let answer = peer.does(json!({
        "do": "call", "service": format!("{node}/{service}"),
        "type": format!("lifecycle_msgs/srv/{kind}"), "request": request,
    }));
    answer["response"].clone()
}

/// Asks for a transition by its name; gives whether it was made, and the state after it.
fn change(peer: &mut Peer, node: &str, label: &str) -> (bool, u64) {
    let request = json!({"transition": {"label": label}});
    let changed = call(peer, node, "change_state", "ChangeState", request);
    let changed = changed["success"].as_bool().expect("an answer");
    (changed, state(peer, node))
}

fn state(peer: &mut Peer, node: &str) -> u64 {
    let answer = call(peer, node, "get_state", "GetState", json!({}));
    answer["current_state"]["id"].as_u64().expect("a state")
}

fn seconds(state: &Value) -> f64 {
    let stamp = &state["header"]["stamp"];
    let part = |name: &str| stamp[name].as_f64().expect("a time");
    part("sec") + 1e-9 * part("nanosec")
}

#[test]
fn dynamics_takes_every_lifecycle_transition() {
    repeat_if_late(|| {
        let domain = 5;
        let mut dynamics = command("dynamics", domain);
        dynamics
            .args(["--ros-args", "--params-file"])
            .arg(source("config/servicing.yaml"))
            .args(["-p", "start_on_command:=false", "-p", "autostart:=false"]);
        let mut dynamics = Running::start(dynamics);
        let mut peer = Peer::start("manager", domain);
        let node = "dynamics";
        assert_eq!(state(&mut peer, node), UNCONFIGURED);
        let event = "lifecycle_msgs/msg/TransitionEvent";
        peer.subscribe("dynamics/transition_event", event, "reliable");
        peer.subscribe("joint_states", JOINT_STATE, "reliable");
        let answer = call(
            &mut peer,
            node,
            "get_available_states",
            "GetAvailableStates",
            json!({}),
        );
        assert_eq!(
            answer["available_states"].as_array().map(Vec::len),
            Some(11)
        );
        let ways = |peer: &mut Peer, service: &str| -> Vec<String> {
            let answer = call(peer, node, service, "GetAvailableTransitions", json!({}));
            let all = answer["available_transitions"]
                .as_array()
                .expect("a list")
                .iter();
            all.map(|t| {
                t["transition"]["label"]
                    .as_str()
                    .expect("a name")
                    .to_owned()
            })
            .collect()
        };
        assert_eq!(
            ways(&mut peer, "get_available_transitions"),
            ["configure", "shutdown"]
        );
        // All transitions of rcl where the peer listens on loopback alone; else, as Fast DDS announces every interface, those that
        // the node takes, since the longer answer would not reach it.
        let edges = ways(&mut peer, "get_transition_graph").len();
        assert!(edges == 17 || edges == 25, "{edges} edges");

        assert_eq!(change(&mut peer, node, "activate"), (false, UNCONFIGURED));
        assert_eq!(change(&mut peer, node, "configure"), (true, INACTIVE));
        assert_eq!(change(&mut peer, node, "activate"), (true, ACTIVE));
        let before = seconds(&peer.receive("joint_states", 10)[9]["message"]);
        assert_eq!(change(&mut peer, node, "deactivate"), (true, INACTIVE));
        let rest = eventually("the states end", PATIENCE, || {
            let some = peer.receive("joint_states", 1).len();
            thread::sleep(Duration::from_millis(300));
            let all = peer.receive("joint_states", 1);
            (some == all.len()).then(|| seconds(&all[some - 1]["message"]))
        });
        assert_eq!(change(&mut peer, node, "activate"), (true, ACTIVE));
        // Time continues where it stood.
        let state = fresh(&mut peer, "joint_states", 1).remove(0);
        assert!(seconds(&state) >= rest && rest >= before, "{rest} {state}");
        assert_eq!(change(&mut peer, node, "deactivate"), (true, INACTIVE));
        assert_eq!(change(&mut peer, node, "cleanup"), (true, UNCONFIGURED));
        assert_eq!(change(&mut peer, node, "shutdown"), (true, FINALIZED));
        assert_eq!(change(&mut peer, node, "configure"), (false, FINALIZED));

        // The first ones may have gone out before the peer was known.
        let goals = eventually("the transition event of the end", PATIENCE, || {
            let reported = peer.receive("dynamics/transition_event", 1);
            let goal = |e: &Value| e["message"]["goal_state"]["id"].as_u64().expect("a state");
            let goals: Vec<_> = reported.iter().map(goal).collect();
            goals.ends_with(&[FINALIZED]).then_some(goals)
        });
        let all = [10, 2, 13, 3, 14, 2, 13, 3, 14, 2, 11, 1, 12, 4];
        assert!(all.ends_with(&goals), "{goals:?}");
        dynamics.interrupt().well();
    });
}

#[test]
fn a_controller_commands_while_it_is_active() {
    repeat_if_late(|| {
        let domain = 6;
        let args = [
            "--duration",
            "600",
            "--ros-args",
            "-p",
            "controller:autostart:=false",
        ];
        let mut launch = Running::launch(domain, &source("config/positioning.yaml"), &args);
        let mut peer = peer_with_interfaces("manager", domain);
        peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        peer.subscribe("joint_states", JOINT_STATE, "reliable");
        let node = "controller";
        assert_eq!(change(&mut peer, node, "configure"), (true, INACTIVE));
        diagnosed(&mut peer, "controller: control", |_, text| {
            text.contains("not active")
        });
        // Time waits for the first command.
        assert_eq!(seconds(&fresh(&mut peer, "joint_states", 1)[0]), 0.0);
        assert_eq!(change(&mut peer, node, "activate"), (true, ACTIVE));
        eventually("time goes on", PATIENCE, || {
            let state = fresh(&mut peer, "joint_states", 1).pop()?;
            (seconds(&state) > 3.0).then_some(())
        });
        // All nodes follow a simulation that restarts.
        let reset = peer.does(json!({
            "do": "call", "service": "dynamics/reset_simulation",
            "type": "simulation_interfaces/srv/ResetSimulation", "request": {"scope": 0},
        }));
        assert_eq!(reset["response"]["result"]["result"], 1, "{reset}");
        let again = eventually("time restarts at zero", PATIENCE, || {
            let state = fresh(&mut peer, "joint_states", 1).pop()?;
            (seconds(&state) < 3.0).then(|| seconds(&state))
        });
        eventually("time goes on from there", PATIENCE, || {
            let state = fresh(&mut peer, "joint_states", 1).pop()?;
            (seconds(&state) > again + 0.1).then_some(())
        });
        assert_eq!(change(&mut peer, node, "deactivate"), (true, INACTIVE));
        diagnosed(&mut peer, "dynamics: commands", |level, text| {
            level == 1 && text.contains("efforts are zero")
        });

        // SIGTERM, as systemd sends it: ends in order, with a complete bag.
        launch.signal("TERM");
        launch.wait(PATIENCE).well();
        let bag = launch.bag();
        assert!(bag.join("metadata.yaml").exists());
        assert!(read::<JointState>(&bag, "/joint_states").len() > 10);
    });
}
