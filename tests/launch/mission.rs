//! A capture mission over DDS, with an operator in rclpy who holds, resumes and aborts.

use fuyu::msg::{
    fuyu_msgs::{MissionState, ThrusterCommands},
    sensor_msgs::JointState,
};
use serde_json::{Value, json};

use crate::{
    lateness::repeat_if_late,
    observer::{JOINT_STATE, fresh, numbers},
    peer::Peer,
    process::{Check, Running, read, source},
    waiting::{PATIENCE, eventually},
};

const DOMAIN: u16 = 162;
const DOMAIN_OF_WHEELS: u16 = 164;

/// Calls a service of the mission node: whether it did what was asked, and what it says.
fn call(peer: &mut Peer, service: &str) -> (bool, String) {
    let answer = peer.does(json!({
        "do": "call", "service": format!("mission/{service}"), "type": "std_srvs/srv/Trigger", "request": {},
    }));
    let response: &Value = &answer["response"];
    let success = response["success"].as_bool();
    let message = response["message"].as_str();
    (
        success.unwrap_or_else(|| panic!("{answer}")),
        message.unwrap_or_else(|| panic!("{answer}")).to_owned(),
    )
}

/// Waits until the mission is in `phase`. Resuming a mission that is not held changes nothing, and says the phase.
fn reach(peer: &mut Peer, phase: &str) {
    let mut said = String::new();
    eventually(&format!("phase {phase}"), 5 * PATIENCE, || {
        let (_, message) = call(peer, "resume");
        if message != said {
            println!("{message}");
            said.clone_from(&message);
        }
        assert!(!message.contains("is over"), "{message}");
        message.ends_with(&format!("phase {phase}")).then_some(())
    });
}

/// Largest joint rate of a fresh state \[rad/s\].
fn largest_rate(peer: &mut Peer) -> Option<f64> {
    let state = fresh(peer, "joint_states", 1).pop()?;
    let rates = numbers(&state["velocity"]);
    Some(rates.iter().fold(0.0, |most, rate| rate.abs().max(most)))
}

// Fails if the arm moved on while it is held, if it did not go on afterwards, if the approach could be skipped, or if an
// aborted mission left the arm moving.
#[test]
fn an_operator_holds_resumes_and_aborts() {
    repeat_if_late(|| {
        let mut launch = Running::launch(DOMAIN, &source("config/capture.yaml"), &[]);
        let mut peer = Peer::start("operator", DOMAIN);
        peer.subscribe("joint_states", JOINT_STATE, "reliable");
        reach(&mut peer, "approach");
        eventually("the arm moves", PATIENCE, || {
            (largest_rate(&mut peer)? > 5e-3).then_some(())
        });
        let (skipped, reason) = call(&mut peer, "skip");
        assert!(!skipped && reason.contains("approach"), "{reason}");
        let (held, said) = call(&mut peer, "hold");
        assert!(held, "{said}");
        eventually("the arm has stopped", PATIENCE, || {
            (largest_rate(&mut peer)? < 2e-3).then_some(())
        });
        let (resumed, said) = call(&mut peer, "resume");
        assert!(resumed, "{said}");
        reach(&mut peer, "approach");
        eventually("the arm moves again", PATIENCE, || {
            (largest_rate(&mut peer)? > 5e-3).then_some(())
        });
        let (aborted, said) = call(&mut peer, "abort");
        assert!(aborted, "{said}");
        let said = eventually("the mission is over", PATIENCE, || {
            let (held, said) = call(&mut peer, "hold");
            (!held).then_some(said)
        });
        assert_eq!(said, "the mission is over: aborted");
        eventually("the arm rests", PATIENCE, || {
            (largest_rate(&mut peer)? < 2e-3).then_some(())
        });
        let ended = launch.interrupt();
        assert!(
            ended.stderr.contains("aborted by the operator"),
            "{}",
            ended.stderr
        );
        let states = read::<MissionState>(&launch.bag(), "/mission/state");
        let last = states.last().expect("states of the mission");
        assert_eq!(last.phase, "aborted");
        assert!(
            states
                .iter()
                .any(|state| state.is_held && state.phase == "approach")
        );
        assert_eq!(
            last.outcome.last().map(String::as_str),
            Some("aborted by the operator")
        );
        // Every effort that was commanded is a number.
        let commands = read::<JointState>(&launch.bag(), "/joint_commands");
        assert!(!commands.is_empty());
        assert!(
            commands
                .iter()
                .all(|c| c.effort.iter().all(|x| x.is_finite()))
        );
    });
}

// Fails if the mission's goals do not reach the gripper, if it goes on before the fingers press, if the servo shakes the grip loose, or if a
// slip of the target goes unseen: the fingers are where the post is, and what is identified has the client's mass.
#[test]
fn two_fingers_capture_over_dds() {
    repeat_if_late(|| {
        let mut launch = Running::launch(163, &source("config/capture_gripper.yaml"), &[]);
        launch.wait(6 * PATIENCE).well();
        let states = read::<MissionState>(&launch.bag(), "/mission/state");
        let last = states.last().expect("states of the mission");
        assert_eq!(last.phase, "done", "{:?}", last.outcome);
        let mass = last.figure_name.iter().position(|name| name == "mass");
        let mass = last.figure_value[mass.expect("an identified mass")];
        assert!((mass / 300.0 - 1.0).abs() < 0.01, "{mass}");
        let joints = read::<JointState>(&launch.bag(), "/joint_states");
        let joints = joints.last().expect("states of the joints");
        let finger = joints
            .name
            .iter()
            .position(|name| name == "left_finger_joint");
        // The gap of 60 mm less the radius of the post.
        let position = joints.position[finger.expect("a finger")];
        assert!((position - 0.035).abs() < 1e-3, "{position}");
        // The estimator, which nobody needs once the target is held, may fall behind on a busy machine.
        let mut failed = Check::of(&launch.bag()).failed();
        failed.retain(|check| !(check.contains("gaps in time") && check.contains("/estimator/")));
        assert_eq!(failed, Vec::<String>::new());
    });
}

// Fails if a state is answered without the speeds of the wheels that belong to it, if wheels or thrusters do not get their commands, or if
// the momentum of the wheels falsifies the identification. The wheels are smaller than the momentum: thrusters must fire as well.
#[test]
fn wheels_and_thrusters_stop_the_target_over_dds() {
    repeat_if_late(|| {
        let mut launch =
            Running::launch(DOMAIN_OF_WHEELS, &source("config/capture_wheels.yaml"), &[]);
        launch.wait(6 * PATIENCE).well();
        let states = read::<MissionState>(&launch.bag(), "/mission/state");
        let last = states.last().expect("states of the mission");
        assert_eq!(last.phase, "done", "{:?}", last.outcome);
        let figure = |name: &str| {
            let at = last.figure_name.iter().position(|known| known == name);
            last.figure_value[at.unwrap_or_else(|| panic!("no {name}: {:?}", last.figure_name))]
        };
        let mass = figure("mass");
        assert!((mass / 300.0 - 1.0).abs() < 0.01, "{mass}");
        let wheels = read::<JointState>(&launch.bag(), "/wheel_states");
        let wheels = wheels.last().expect("states of the wheels");
        let fullest = wheels.velocity.iter().map(|v| v.abs()).fold(0.0, f64::max);
        // 1 N m s of 0.005 kg m².
        assert!(fullest > 150.0 && fullest < 200.1, "{:?}", wheels.velocity);
        let pulses = read::<ThrusterCommands>(&launch.bag(), "/thruster_commands");
        assert!(
            pulses
                .iter()
                .any(|command| command.on_time.iter().any(|t| *t > 0.0))
        );
        // Whether the graph kept time is the subject of other tests.
        let mut failed = Check::of(&launch.bag()).failed();
        failed.retain(|check| !check.contains("gaps in time"));
        assert_eq!(failed, Vec::<String>::new());
    });
}
