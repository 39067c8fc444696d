//! The network between two computers is interrupted for less and for longer than the leases of DDS.

use serde_json::json;
use std::{
    process::Command,
    thread,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use crate::{
    binaries::binary,
    child::{Running, executable},
    namespace::Namespace,
    peer::{Peer, python},
    waiting::{PATIENCE, eventually},
    wire::Wire,
};

const NUMBER: &str = "std_msgs/msg/Int64";
const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
/// Within this time after an interruption everything is exchanged again: rustdds announces a participant every 10 s, a
/// process looks once a second for peers that have returned, and this machine may be busy.
const BACK_WITHIN: Duration = Duration::from_secs(30);

pub fn now() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.expect("a time after 1970").as_secs_f64()
}

/// A robot on two computers: dynamics, camera and an echo on one, the controller and an rclpy node on the other.
pub struct Split {
    pub wire: Wire,
    pub near: Vec<Running>,
    pub controller: Running,
    pub observer: Peer,
}

impl Split {
    /// On the two computers at the ends of a wire. `environment` are variables of all processes on each computer, `args`
    /// more arguments of the dynamics node.
    pub fn new(wire: Wire, domain: u16, environment: [&[&str]; 2], args: &[&str]) -> Self {
        let command = |end: usize, program: &std::path::Path| {
            let namespace: &Namespace = &wire.ends[end];
            let mut command: Command = namespace.command("env");
            command.args(environment[end]).arg(program);
            // What `Running` and `Peer` would set otherwise; `env` has priority.
            command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET");
            command
        };
        let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/positioning.yaml");
        let node = |end: usize, name: &str, args: &[&str]| {
            let mut command = command(end, binary(name).as_ref());
            command
                .args(["--ros-args", "--params-file", config])
                .args(args);
            Running::start(command, domain)
        };
        // Before rclpy listens to multicast on this computer: with static peers it does without.
        let controller = node(1, "controller", &[]);
        let mut observer = Peer::start_with(command(1, &python()), "observer", domain);
        for topic in ["joint_states", "joint_commands"] {
            observer.subscribe(topic, JOINT_STATE, "reliable");
        }
        observer.subscribe("out/std_msgs/Int64", NUMBER, "reliable");
        let echo = ["--ros-args", "-r", "__node:=echo"];
        let echo = Running::program(command(0, &executable()), "echo", domain, &echo);
        let camera = node(0, "camera", &[]);
        let dynamics = node(0, "dynamics", &[&["-p", "duration:=0.0"], args].concat());
        Self {
            near: vec![dynamics, camera, echo],
            controller,
            observer,
            wire,
        }
    }

    /// Waits until everybody receives from everybody, from `since` on: how long that took \[s\].
    pub fn all_receive(&mut self, since: f64, patience: Duration) -> f64 {
        let start = Instant::now();
        let observer = &mut self.observer;
        eventually(
            "the dynamics node has the controller's efforts",
            patience,
            || {
                let wait =
                    json!({"do": "wait", "topic": "joint_states", "since": since, "timeout": 0.5});
                let states = observer.does(wait);
                let last = states.as_array()?.last()?;
                let efforts = last["message"]["effort"].as_array()?;
                efforts
                    .iter()
                    .any(|e| e.as_f64() != Some(0.0))
                    .then_some(())
            },
        );
        let commands =
            json!({"do": "wait", "topic": "joint_commands", "since": since, "timeout": 30.0});
        assert!(
            observer.does(commands)[0].is_object(),
            "the controller has the states"
        );
        eventually("an answer of the echo", patience, || {
            observer.does(json!({
                "do": "publish", "topic": "in/std_msgs/Int64", "type": NUMBER, "message": {"data": 1},
                "matched": 0
            }));
            let out = "out/std_msgs/Int64";
            let wait = json!({"do": "wait", "topic": out, "since": since, "timeout": 0.5});
            observer.does(wait)[0].is_object().then_some(())
        });
        start.elapsed().as_secs_f64()
    }

    /// Stderr of all of fuyu's nodes.
    pub fn said(&self) -> String {
        let near = self.near.iter().map(Running::said);
        near.chain([self.controller.said()]).collect()
    }
}

/// Interrupts the network for these times \[s\], one after the other.
fn interrupt(names: [&str; 2], domain: u16, seconds: &[u64]) {
    let Some(wire) = Wire::new(names, 0.0, 0.0) else {
        return;
    };
    let mut robot = Split::new(wire, domain, [&[], &[]], &[]);
    robot.all_receive(0.0, 3 * PATIENCE);
    for &seconds in seconds {
        robot.wire.set(1.0, 0.0);
        // A second for what is on its way.
        thread::sleep(Duration::from_secs(seconds));
        robot.wire.set(0.0, 0.0);
        let back = robot.all_receive(now(), BACK_WITHIN);
        println!("after an interruption of {seconds} s everything is exchanged within {back:.1} s");
        if seconds >= 30 {
            assert!(
                robot.said().contains("joined the graph again"),
                "{}",
                robot.said()
            );
        }
    }
}

// Fails if a participant that is lost and returns stays unmatched (docs/upstream.md): the lease of Fast DDS is 20 s,
// that of rustdds 50 s.
#[test]
fn a_robot_survives_short_interruptions() {
    interrupt(["cut", "cutfar"], 112, &[5, 30]);
}

#[test]
#[ignore = "takes seven minutes"]
fn a_robot_survives_long_interruptions() {
    interrupt(["long", "longfar"], 113, &[15, 60, 300]);
}
