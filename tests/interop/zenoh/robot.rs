//! A robot on two computers: dynamics and camera on the near one, controller and recorder on the far one.

use fuyu::{bag::Bag, msg::sensor_msgs::JointState, ros::Time};
use std::{
    path::PathBuf,
    time::{Duration, Instant},
};

use super::{network::Network, watch::Watch};
use crate::{binaries::binary, child::Running, two_computers::START, waiting::eventually};

/// The running robot.
pub struct Robot {
    pub network: Network,
    /// On the near and on the far computer.
    pub watches: [Watch; 2],
    /// Dynamics, camera, controller, recorder.
    pub nodes: [Running; 4],
    folder: tempfile::TempDir,
}

impl Robot {
    /// The positioning scenario without an end, with these arguments of dynamics and controller.
    pub fn start(network: Network, dynamics: &[&str], controller: &[&str]) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/positioning.yaml");
        let node = |end: usize, name: &str, args: &[&str]| {
            let mut command = network.command(end, binary(name));
            command
                .args(["--ros-args", "--params-file", config])
                .args(args)
                .current_dir(folder.path());
            Running::start(command, network.domain)
        };
        let watches = [0, 1].map(|end| Watch::start(&network, end));
        let controller = node(1, "controller", controller);
        let bag = format!("bag:={}", folder.path().join("bag").display());
        let recorder = node(1, "recorder", &["-p", "topics:=[joint_states]", "-p", &bag]);
        let camera = node(0, "camera", &[]);
        recorder.says("recording to");
        let endless = ["-p", "duration:=0.0"];
        let dynamics = node(0, "dynamics", &[&endless[..], dynamics].concat());
        Self {
            nodes: [dynamics, camera, controller, recorder],
            watches,
            network,
            folder,
        }
    }

    /// Waits until both computers hear states and commands, and the controller acts. How long that took \[s\].
    pub fn all_receive(&self, patience: Duration) -> f64 {
        let start = Instant::now();
        let before = [0, 1].map(|end| self.watches[end].heard());
        for end in [0, 1] {
            let what = ["the near computer hears", "the far computer hears"][end];
            eventually(what, patience, || {
                let heard = self.watches[end].heard();
                let more = heard.states >= before[end].states + 20.0
                    && heard.commands >= before[end].commands + 20.0;
                (more && heard.effort != 0.0).then_some(())
            });
        }
        start.elapsed().as_secs_f64()
    }

    /// Waits for this stamp of the states \[s\]. The rate of simulated time since the first state by that of the computer.
    pub fn run_until(&self, stamp: f64) -> f64 {
        let near = &self.watches[0];
        eventually("the first state", START, || {
            (near.heard().stamp > 0.0).then_some(())
        });
        let (start, first) = (Instant::now(), near.heard().stamp);
        eventually("the last state", 2 * START, || {
            (near.heard().stamp >= stamp).then_some(())
        });
        (near.heard().stamp - first) / start.elapsed().as_secs_f64()
    }

    /// Ends the recorder; stamps of the joint states in its bag \[s\].
    pub fn recorded(self) -> Vec<f64> {
        let [_, _, _, recorder] = self.nodes;
        recorder.interrupt();
        let bag: PathBuf = self.folder.path().join("bag");
        let bag = Bag::open(bag).expect("a bag");
        let states = bag.read::<JointState>("/joint_states");
        let states = states.expect("joint states").into_iter();
        let stamp = |s: JointState| Time::from(s.header.stamp).as_secs_f64();
        states.map(|state| stamp(state.message)).collect()
    }
}
