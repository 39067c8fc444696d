//! A node that says what it hears of a robot.

use fuyu::{
    msg::sensor_msgs::JointState,
    ros::{Node, NodeError, Qos, Time},
};
use std::time::{Duration, Instant};

use super::network::Network;
use crate::{
    child::{Running, executable},
    speed::after,
};

/// How often it says it.
const PERIOD: Duration = Duration::from_millis(100);

/// What has been heard so far.
#[derive(Debug, Clone, Copy, Default)]
pub struct Heard {
    /// Joint states.
    pub states: f64,
    /// Commands.
    pub commands: f64,
    /// Stamp of the last state \[s\].
    pub stamp: f64,
    /// Largest effort in the last state.
    pub effort: f64,
    /// Largest joint rate in any state \[rad/s\].
    pub rate: f64,
    /// Largest change of a joint position since the first state \[rad\].
    pub moved: f64,
}

/// The program of the node.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let qos = Qos::RELIABLE.depth(500);
    let states = node.subscribe::<JointState>("joint_states", qos)?;
    let commands = node.subscribe::<JointState>("joint_commands", qos)?;
    let (mut heard, mut first) = (Heard::default(), None);
    let largest = |values: &[f64]| values.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let mut said = Instant::now();
    while node.wait_for(PERIOD) {
        while let Some(state) = states.take() {
            let state = state.message;
            let first = first.get_or_insert_with(|| state.position.clone());
            let changes = state.position.iter().zip(first.iter()).map(|(a, b)| a - b);
            heard.states += 1.0;
            heard.stamp = Time::from(state.header.stamp).as_secs_f64();
            heard.effort = largest(&state.effort);
            heard.rate = heard.rate.max(largest(&state.velocity));
            heard.moved = heard.moved.max(largest(&changes.collect::<Vec<_>>()));
        }
        while commands.take().is_some() {
            heard.commands += 1.0;
        }
        if said.elapsed() >= PERIOD {
            said = Instant::now();
            let Heard {
                states,
                commands,
                stamp,
                effort,
                rate,
                moved,
            } = heard;
            tracing::info!(
                "hears states {states} commands {commands} stamp {stamp} effort {effort} rate {rate} moved {moved}"
            );
        }
    }
    Ok(())
}

/// Such a node in a process.
pub struct Watch(pub Running);

impl Watch {
    /// On the near (0) or far (1) computer.
    pub fn start(network: &Network, end: usize) -> Self {
        let command = network.command(end, executable());
        let name = format!("__node:=watch_{}", ["near", "far"][end]);
        let args = ["--ros-args", "-r", &name];
        Self(Running::program(command, "watch", network.domain, &args))
    }

    pub fn heard(&self) -> Heard {
        let said = self.0.said();
        let Some(line) = said.lines().rfind(|line| line.contains("hears states")) else {
            return Heard::default();
        };
        Heard {
            states: after(line, "states"),
            commands: after(line, "commands"),
            stamp: after(line, "stamp"),
            effort: after(line, "effort"),
            rate: after(line, "rate"),
            moved: after(line, "moved"),
        }
    }
}
