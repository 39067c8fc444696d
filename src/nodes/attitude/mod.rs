//! The attitude node: computes wheel torques and thruster on-times from gyro, star tracker, wheels and joints.
//!
//! The node feeds an [`AttitudeLoop`] and publishes its output; filter, law, feed-forward, allocation, ages and
//! fallbacks are in [`control::attitude`](crate::control::attitude). It does not subscribe to `ground_truth/`. Wheels,
//! thrusters and appendages are parameters of this node as well as of the dynamics node, so its model of the robot may
//! differ from the simulated robot. Parameters below `/**` in a file apply to both nodes.
//!
//! When it is deactivated, the node commands zero torque and closed valves once, and nothing afterwards.

mod attitude_loop;
mod health;
mod inputs;
mod law_monitor;
mod messages;
mod params;

pub use attitude_loop::AttitudeLoop;
pub use messages::AttitudeMessages;
pub use params::AttitudeParams;

use std::time::Duration;

use super::{robot_description::RobotDescription, topics};
use crate::{
    control::{Stamp, attitude::AttitudeMode},
    msg::{
        fuyu_msgs::{AttitudeState, ThrusterCommands},
        sensor_msgs::JointState,
    },
    ros::{Lifecycle, Node, NodeError, Publisher, Transition},
};
use health::{Health, Refusals};
use inputs::Inputs;
use law_monitor::LawMonitor;

/// Silence of `imu` and `joint_states` after which a warning is reported.
const SILENCE: Duration = Duration::from_secs(1);

/// The node's program.
///
/// # Errors
/// For invalid parameters, or when DDS reports an error.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = AttitudeParams::declare_live(&mut declare);
    declare.finish()?;
    let params = params.map_err(|e| NodeError::Input(format!("node {}: {e}", node.name())))?;
    let (mut params, law) = params;
    let lifecycle = Lifecycle::new(node)?;
    let mut configured: Option<AttitudeNode> = None;
    let release = |configured: &mut Option<AttitudeNode>| {
        if let Some(configured) = configured {
            configured.release();
        }
    };
    let pass = |transition, configured: &mut Option<AttitudeNode>| {
        match transition {
            Transition::Configure => *configured = Some(AttitudeNode::new(node)?),
            Transition::Activate => {
                if let Some(configured) = configured.as_mut() {
                    configured.is_active = true;
                }
            }
            Transition::Deactivate => release(configured),
            Transition::CleanUp | Transition::Shutdown => {
                release(configured);
                *configured = None;
            }
        }
        Ok(())
    };
    if params.autostart {
        lifecycle.start(|transition| pass(transition, &mut configured))?;
    }
    loop {
        lifecycle.follow(|transition| pass(transition, &mut configured));
        if law.changed() {
            params.law = params.named(&law.get());
        }
        if let Some(configured) = &mut configured {
            configured.update(node, &params)?;
        }
        if !node.wait_for(SILENCE) {
            return Ok(());
        }
    }
}

/// Endpoints and attitude loop of a configured node.
struct AttitudeNode {
    description: RobotDescription,
    inputs: Inputs,
    wheels: Publisher<JointState>,
    thrusters: Publisher<ThrusterCommands>,
    state: Publisher<AttitudeState>,
    health: Health,
    refusals: Refusals,
    law: LawMonitor,
    /// Whether the node is active: then it gives commands.
    is_active: bool,
    /// Whether the last step commanded zero torque, a problem that is reported with priority over refused messages.
    is_torque_zero: bool,
    /// `None` before a robot description has arrived.
    attitude: Option<(AttitudeLoop, AttitudeMessages)>,
    /// Stamp of the last answered state.
    answered: Option<Stamp>,
}

impl AttitudeNode {
    fn new(node: &Node) -> Result<Self, NodeError> {
        Ok(Self {
            description: RobotDescription::new(node, String::new())?,
            health: Health::new(node),
            refusals: Refusals::default(),
            law: LawMonitor::default(),
            is_active: false,
            is_torque_zero: false,
            inputs: Inputs::new(node)?,
            wheels: topics::WHEEL_COMMANDS.advertise(node)?,
            thrusters: topics::THRUSTER_COMMANDS.advertise(node)?,
            state: topics::ATTITUDE_STATE.advertise(node)?,
            attitude: None,
            answered: None,
        })
    }

    /// Takes received messages, and answers the newest state if the node is active.
    fn update(&mut self, node: &Node, params: &AttitudeParams) -> Result<(), NodeError> {
        if let Some(robot) = self.description.changed() {
            match AttitudeLoop::new(params, &robot.model) {
                Ok(attitude) => {
                    let messages = AttitudeMessages::new(&attitude);
                    self.attitude = Some((attitude, messages));
                }
                Err(e) if self.attitude.is_none() => {
                    let node = node.name();
                    return Err(NodeError::Input(format!("node {node}: {e}")));
                }
                Err(e) => self.description.refuse(&e),
            }
        }
        let Some((attitude, messages)) = &mut self.attitude else {
            return Ok(());
        };
        self.inputs.feed(attitude, &mut self.refusals);
        self.law.follow(params.law, attitude, &self.health.law);
        if !self.is_active {
            (self.health.control).warn("the node is not active: no commands are given");
            self.refusals.report(&self.health.control);
            return Ok(());
        }
        let timeout = (!params.lockstep).then_some(params.controller.timeout);
        let state = self.inputs.state(timeout);
        let is_due = state != self.answered && attitude.controller().is_some();
        if let Some(now) = state.filter(|_| is_due) {
            self.answered = state;
            let report = attitude.step(now);
            if let Some(report) = &report {
                self.health.report(report);
                self.is_torque_zero = report.mode == AttitudeMode::ZeroTorque;
                messages.write_report(attitude, report);
                self.state.publish(&messages.state);
            }
            // Wheel commands come last: in lockstep they let time advance.
            if messages.write_commands(attitude, now) {
                self.thrusters.publish(&messages.thrusters);
            }
            self.wheels.publish(&messages.wheels);
            self.law.check(attitude, &self.health.law);
        }
        if let Some((age, [imu, joints])) = self.inputs.silence(SILENCE) {
            let seconds = age.as_secs_f64();
            self.health.control.warn(format!(
                "{imu} and {joints} have been silent for {seconds:.0} s: no commands are given"
            ));
        }
        if !self.is_torque_zero {
            self.refusals.report(&self.health.control);
        }
        Ok(())
    }

    /// If the node was active: commands zero torques and closed valves.
    fn release(&mut self) {
        if !std::mem::take(&mut self.is_active) {
            return;
        }
        let (Some((attitude, messages)), Some(now)) = (&mut self.attitude, self.answered) else {
            return;
        };
        attitude.release();
        messages.write_release(now);
        if !messages.thrusters.name.is_empty() {
            self.thrusters.publish(&messages.thrusters);
        }
        self.wheels.publish(&messages.wheels);
        self.answered = None;
    }
}
