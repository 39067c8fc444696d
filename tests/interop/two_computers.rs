//! A robot on two computers: dynamics, camera, an echo and an rclpy node on the near one; controller, recorder and an rclpy
//! node on the far one.

use fuyu::{bag::Bag, msg::sensor_msgs::JointState};
use serde_json::{Value, json};
use std::{
    path::{Path, PathBuf},
    process::Command,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use crate::{
    binaries::binary,
    child::{Running, executable},
    peer::{Peer, python},
    waiting::{PATIENCE, eventually},
    wire::Wire,
};

const NUMBER: &str = "std_msgs/msg/Int64";
const TEXT: &str = "std_msgs/msg/String";
const JOINT_STATE: &str = "sensor_msgs/msg/JointState";

/// The computer's time \[s\].
pub fn now() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.expect("a time after 1970").as_secs_f64()
}

/// What is different from a robot with the positioning scenario.
#[derive(Default, Clone, Copy)]
pub struct Settings<'a> {
    /// Variables of all processes on each computer, as `env` takes them.
    pub environment: [&'a [&'a str]; 2],
    /// Whether the dynamics node starts before rclpy is there: the motion begins without it.
    pub dynamics_first: bool,
    /// More arguments of the dynamics node.
    pub dynamics: &'a [&'a str],
    /// More arguments of the controller.
    pub controller: &'a [&'a str],
}

/// The running robot.
pub struct TwoComputers {
    pub wire: Wire,
    /// fuyu's processes: dynamics, camera, echo, controller, recorder.
    pub nodes: [Running; 5],
    /// rclpy on the near and on the far computer.
    pub observers: [Peer; 2],
    folder: tempfile::TempDir,
}

impl TwoComputers {
    /// On the two computers at the ends of a wire.
    pub fn start(wire: Wire, domain: u16, settings: Settings) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let command = |end: usize, program: &Path| {
            let mut command: Command = wire.ends[end].command("env");
            command.args(settings.environment[end]).arg(program);
            // What `Running` and `Peer` would set otherwise; `env` has priority.
            command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET");
            command
        };
        let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/positioning.yaml");
        let node = |end: usize, name: &str, args: &[&str]| {
            let mut command = command(end, binary(name).as_ref());
            command
                .args(["--ros-args", "--params-file", config])
                .args(args)
                .current_dir(folder.path());
            Running::start(command, domain)
        };
        let controller = node(1, "controller", settings.controller);
        let bag = format!("bag:={}", bag_in(folder.path()).display());
        let recorder = node(1, "recorder", &["-p", "topics:=[joint_states]", "-p", &bag]);
        let echo = ["--ros-args", "-r", "__node:=echo"];
        let echo = Running::program(command(0, &executable()), "echo", domain, &echo);
        let camera = node(0, "camera", &[]);
        echo.says("echoes");
        recorder.says("recording to");
        // With static peers fuyu does without multicast, if no other process of the computer listens to it yet.
        let start = || {
            node(
                0,
                "dynamics",
                &[&["-p", "duration:=0.0"], settings.dynamics].concat(),
            )
        };
        let early = settings.dynamics_first.then(start);
        let far = Peer::start_with(command(1, &python()), "far", domain);
        let near = Peer::start_with(command(0, &python()), "near", domain);
        let mut observers = [near, far];
        for observer in &mut observers {
            observer.subscribe("joint_states", JOINT_STATE, "reliable");
            observer.subscribe("joint_commands", JOINT_STATE, "reliable");
        }
        observers[0].subscribe("from_far", TEXT, "reliable");
        observers[1].subscribe("from_near", TEXT, "reliable");
        observers[1].subscribe("out/std_msgs/Int64", NUMBER, "reliable");
        let dynamics = early.unwrap_or_else(start);
        Self {
            nodes: [dynamics, camera, echo, controller, recorder],
            observers,
            wire,
            folder,
        }
    }

    /// Waits until everybody receives from everybody what is sent after `since`: fuyu from fuyu, rclpy from fuyu and fuyu from
    /// rclpy in both directions, and rclpy from rclpy. How long that took \[s\].
    pub fn all_receive(&mut self, since: f64, patience: Duration) -> f64 {
        let start = Instant::now();
        let [near, far] = &mut self.observers;
        eventually(
            "rclpy on the far computer has the efforts of the controller",
            patience,
            || {
                let efforts = last_efforts(far, since)?;
                efforts.iter().any(|e| *e != 0.0).then_some(())
            },
        );
        eventually(
            "rclpy on the near computer has the controller's commands",
            patience,
            || {
                let wait = json!({"do": "wait", "topic": "joint_commands", "since": since, "timeout": 0.5});
                near.does(wait)[0].is_object().then_some(())
            },
        );
        eventually(
            "an answer of the echo to the far computer",
            patience,
            || {
                say(far, "in/std_msgs/Int64", NUMBER, json!({"data": 1}));
                heard(far, "out/std_msgs/Int64", since)
            },
        );
        eventually(
            "rclpy on the far computer hears the near one",
            patience,
            || {
                say(near, "from_near", TEXT, json!({"data": "here"}));
                heard(far, "from_near", since)
            },
        );
        eventually(
            "rclpy on the near computer hears the far one",
            patience,
            || {
                say(far, "from_far", TEXT, json!({"data": "here"}));
                heard(near, "from_far", since)
            },
        );
        start.elapsed().as_secs_f64()
    }

    /// The efforts in the newest joint states that rclpy on the near computer has received after `since`.
    pub fn efforts(&mut self, since: f64) -> Option<Vec<f64>> {
        last_efforts(&mut self.observers[0], since)
    }

    /// How often each of fuyu's processes has said this.
    pub fn count(&self, word: &str) -> [usize; 5] {
        let count = |node: &Running| node.said().matches(word).count();
        std::array::from_fn(|i| count(&self.nodes[i]))
    }

    /// Stderr of all of fuyu's processes.
    pub fn said(&self) -> String {
        self.nodes.iter().map(Running::said).collect()
    }

    /// Ends the recorder; stamps of the joint states in its bag \[s\].
    pub fn recorded(self) -> Vec<f64> {
        let [_, _, _, _, recorder] = self.nodes;
        recorder.interrupt();
        let bag = Bag::open(bag_in(self.folder.path())).expect("a bag");
        let states = bag.read::<JointState>("/joint_states");
        let states = states.expect("joint states").into_iter();
        let stamp = |s: &JointState| {
            f64::from(s.header.stamp.sec) + 1e-9 * f64::from(s.header.stamp.nanosec)
        };
        states.map(|state| stamp(&state.message)).collect()
    }
}

fn bag_in(folder: &Path) -> PathBuf {
    folder.join("bag")
}

fn say(peer: &mut Peer, topic: &str, kind: &str, message: Value) {
    peer.does(json!({
        "do": "publish", "topic": topic, "type": kind, "message": message, "matched": 0
    }));
}

fn heard(peer: &mut Peer, topic: &str, since: f64) -> Option<()> {
    let wait = json!({"do": "wait", "topic": topic, "since": since, "timeout": 0.5});
    peer.does(wait)[0].is_object().then_some(())
}

fn last_efforts(peer: &mut Peer, since: f64) -> Option<Vec<f64>> {
    let wait = json!({"do": "wait", "topic": "joint_states", "since": since, "timeout": 0.5});
    let states = peer.does(wait);
    let last = states.as_array()?.last()?;
    let efforts = last["message"]["effort"].as_array()?;
    Some(efforts.iter().filter_map(Value::as_f64).collect())
}

/// The start of a robot may take several times as long as anything else.
pub const START: Duration = Duration::from_secs(3 * PATIENCE.as_secs());
