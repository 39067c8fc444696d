//! Jumps of time: a simulation whose `/clock` and stamps jump ahead, and the nodes that follow it.

use fuyu::{
    bag::Bag,
    msg::{
        rosgraph_msgs::Clock,
        std_msgs::{Float64, String as Text},
    },
    nodes::{
        dynamics::{FrameTree, World, imu, joint_states, odometry},
        scenario::Scenario,
        topics,
    },
    ros::{Node, NodeError, Qos, Time},
};
use serde_json::{Value, json};
use std::{process::Command, time::Duration};

use crate::{
    child::{Running, executable},
    dynamics_restart::{now, since},
    lateness::repeat_if_late,
    peer::Peer,
    waiting::{PATIENCE, eventually},
};

const DOMAIN: u16 = 69;
const CONFIG: &str = "config/servicing.yaml";
/// States per second \[Hz\].
const RATE: f64 = 50.0;
/// A jump of time \[s\].
const LEAP: f64 = 100.0;
/// A jump as from simulated time to a wall clock \[s\].
const TO_WALL_TIME: f64 = 1.7e9;
/// From a jump until commands answer the new time \[s\].
const BACK_WITHIN: f64 = 3.0;

const STATE: &str = "sensor_msgs/msg/JointState";
const VECTOR: &str = "geometry_msgs/msg/Vector3Stamped";
const DIAGNOSTICS: &str = "diagnostic_msgs/msg/DiagnosticArray";

/// The world of the dynamics node, whose stamps are ahead of it by the sum of what comes on `leap` \[s\]. It waits for
/// the answer to each state, so that a late machine does not make the loop unstable.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let params = Scenario::read(&format!("package://fuyu/{CONFIG}")).and_then(|s| s.dynamics());
    let mut params = params.map_err(NodeError::Failed)?;
    params.state_rate = RATE;
    let mut world = World::new(&params).map_err(NodeError::Failed)?;
    let frames = FrameTree::new(&world.robot);
    let description = topics::ROBOT_DESCRIPTION.advertise(node)?;
    description.publish(&Text {
        data: params.robot.xml.clone(),
    });
    let fixed = topics::TF_STATIC.advertise(node)?;
    fixed.publish(&frames.static_transforms(&world.targets));
    let clock = topics::CLOCK.advertise(node)?;
    let states = topics::JOINT_STATES.advertise(node)?;
    let bases = topics::ODOMETRY.advertise(node)?;
    let targets = topics::TARGET_ODOMETRY.advertise(node, "target")?;
    let gyro = topics::IMU.advertise(node)?;
    let commands = topics::JOINT_COMMANDS.subscribe(node)?;
    let leaps = node.subscribe::<Float64>("leap", Qos::RELIABLE)?;
    tracing::info!("ready to jump");
    let mut ahead = 0.0;
    let mut efforts = vec![0.0; world.robot.model().dof()];
    while node.ok() {
        while let Some(leap) = leaps.take() {
            ahead += leap.message.data;
        }
        let stamp = Time::from_secs_f64(world.time() + ahead);
        clock.publish(&Clock {
            clock: stamp.into(),
        });
        states.publish(&joint_states(stamp, frames.base(), &world));
        bases.publish(&odometry(stamp, frames.base(), &world.robot));
        targets.publish(&odometry(stamp, "target", &world.targets[0].body));
        gyro.publish(&imu(stamp, frames.base(), &mut world));
        std::thread::sleep(Duration::from_secs_f64(1.0 / RATE));
        if let Some(command) = commands.wait_next(Duration::from_millis(500)) {
            let command = commands.latest().unwrap_or(command).message;
            efforts.copy_from_slice(&command.effort);
        }
        world.hold_efforts(efforts.iter().copied().enumerate());
        world.step_to_tick();
    }
    Ok(())
}

fn node(name: &str, more: &[&str]) -> Running {
    Running::node(name, CONFIG, DOMAIN, more)
}

fn stamp(message: &Value) -> f64 {
    let stamp = &message["message"]["header"]["stamp"];
    let part = |name: &str| stamp[name].as_f64().expect("a time");
    part("sec") + 1e-9 * part("nanosec")
}

/// Waits for a diagnostic message of a part of a node, after a time.
fn wait_for_diagnostic(peer: &mut Peer, time: f64, part: &str, enough: impl Fn(u64, &str) -> bool) {
    eventually(part, 3 * PATIENCE, || {
        let reports = since(peer, "diagnostics", time);
        let mut statuses = reports
            .iter()
            .flat_map(|r| r["message"]["status"].as_array().expect("a list"));
        let found = statuses.find(|status| {
            let level = status["level"][0].as_u64().expect("a level");
            let text = status["message"].as_str().expect("a text");
            status["name"] == part && enough(level, text)
        })?;
        println!("{part}: {}", found["message"]);
        Some(())
    });
}

/// Makes time jump; returns when \[s\].
fn leap(peer: &mut Peer, by: f64) -> f64 {
    let at = now();
    let message = json!({"data": by});
    peer.does(json!({
        "do": "publish", "topic": "leap", "type": "std_msgs/msg/Float64", "message": message,
    }));
    at
}

/// From a jump until a command answers a state after it \[s\].
fn until_answered(peer: &mut Peer, at: f64, before: f64, by: f64) -> f64 {
    let answer = eventually("an answer in the new time", PATIENCE, || {
        let answers = since(peer, "joint_commands", at);
        let new = answers.iter().find(|m| stamp(m) >= before + by)?;
        new["time"].as_f64()
    });
    answer - at
}

// Fails when a node ends, loops or commands nonsense after a jump, when it keeps its old time, when
// timers fire for the time that was skipped, or when the estimator publishes for a skipped time.
#[test]
fn nodes_survive_a_jump_of_time() {
    repeat_if_late(two_jumps_of_time);
}

fn two_jumps_of_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let bag = folder.path().join("bag");
    let dynamics = Running::program(Command::new(executable()), "leap", DOMAIN, &[]);
    dynamics.says("ready to jump");
    let gentle = [
        "-p",
        "k_o:=2.0",
        "-p",
        "k_v:=[400.0, 100.0, 200.0, 10.0, 2.0, 0.2]",
    ];
    let record = format!("bag:={}", bag.display());
    let mut nodes = vec![
        node("recorder", &["-p", &record]),
        node("controller", &gentle),
        node("estimator", &["-p", "window:=10.0"]),
        // Without a gyro it must detect the jump from the frames.
        node(
            "estimator",
            &[
                "-p",
                "window:=10.0",
                "-p",
                "use_imu:=false",
                "-r",
                "__ns:=/blind",
                "-r",
                "camera/features:=/camera/features",
                "-r",
                "camera/camera_info:=/camera/camera_info",
                "-r",
                "diagnostics:=/diagnostics",
            ],
        ),
        node("camera", &[]),
    ];
    let mut peer = Peer::start("observer", DOMAIN);
    for (topic, kind) in [
        ("joint_commands", STATE),
        ("estimator/angular_velocity", VECTOR),
        ("diagnostics", DIAGNOSTICS),
    ] {
        peer.subscribe(topic, kind, "reliable");
    }
    let steering = |level: u64, text: &str| level == 0 && text.starts_with("steering");
    wait_for_diagnostic(&mut peer, 0.0, "controller: control", steering);
    eventually("the target's motion is known", 3 * PATIENCE, || {
        since(&mut peer, "estimator/angular_velocity", 0.0).pop()
    });

    let mut leaps = Vec::new();
    let mut answered = |peer: &mut Peer, by: f64| {
        let last = since(peer, "joint_commands", 0.0).pop();
        let before = stamp(&last.expect("commands"));
        let at = leap(peer, by);
        leaps.push((before, by));
        let seconds = until_answered(peer, at, before, by);
        wait_for_diagnostic(peer, at, "controller: control", steering);
        wait_for_diagnostic(peer, at, "estimator: motion", |_, text| {
            text.contains("the gyro has just started, or had a gap")
                || text.contains("the target was out of sight for")
        });
        wait_for_diagnostic(peer, at, "blind/estimator: motion", |_, text| {
            text.contains("the target was out of sight for")
        });
        // Once a second from each of five nodes, and as many more as a late machine may have held back.
        let reports = since(peer, "diagnostics", at).len() as f64;
        assert!(reports <= 5.0 * (now() - at + 3.0), "{reports} reports");
        eventually("the motion is known in the new time", 3 * PATIENCE, || {
            let last = since(peer, "estimator/angular_velocity", at).pop()?;
            (stamp(&last) >= before + by).then_some(())
        });
        seconds
    };
    for by in [LEAP, TO_WALL_TIME] {
        let seconds = answered(&mut peer, by);
        println!("{seconds:.3} s until a command answers the time after a leap of {by} s");
        assert!(
            seconds < BACK_WITHIN,
            "no command for {seconds:.3} s after a leap of {by} s"
        );
    }
    for command in since(&mut peer, "joint_commands", 0.0) {
        let efforts = command["message"]["effort"].as_array().expect("a list");
        let finite = |e: &Value| e.as_f64().is_some_and(|e| e.abs() < 1e3);
        assert!(
            efforts.len() == 6 && efforts.iter().all(finite),
            "{command}"
        );
    }
    let stamps: Vec<_> = since(&mut peer, "estimator/angular_velocity", 0.0)
        .iter()
        .map(stamp)
        .collect();
    for (before, by) in leaps {
        // The last state before the leap is some states after the last command that was seen.
        let between = before + 0.1 * by..before + by;
        let unseen = stamps.iter().find(|t| between.contains(t));
        assert_eq!(unseen, None, "between {before} s and {by} s later");
    }
    for node in nodes.drain(..).rev() {
        node.interrupt();
    }
    dynamics.interrupt();
    let times: Vec<_> = Bag::open(&bag)
        .expect("a bag")
        .messages()
        .map(|m| m.log_time)
        .collect();
    assert!(times.is_sorted(), "time in the bag runs backwards");
    let last = times.last().copied().unwrap_or_default() as f64 * 1e-9;
    assert!(last > TO_WALL_TIME, "the bag ends at {last} s");
}
