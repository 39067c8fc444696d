//! The controller node: computes joint efforts from joint states and camera measurements.
//!
//! The node feeds a [`ControlLoop`] and publishes its output; the loop handles pairing of measurements, ages, timeouts
//! and fallbacks. The node does not use the base's pose in the world: it subscribes neither to `ground_truth/` nor to
//! `/tf`.

mod delay_notices;
mod health;
mod inputs;
mod messages;
mod params;

pub use messages::{ControllerMessages, measured_errors};
pub use params::ControllerParams;

use std::time::Duration;

use super::{
    robot_description::{Robot, RobotDescription},
    tip_frame, topics,
};
use crate::{
    control::{ControlLoop, ControlLoopConfig, Controller, ControllerConfig},
    model::{Frame, Model},
    msg::{fuyu_msgs::ControllerState, sensor_msgs::JointState},
    ros::{Lifecycle, Node, NodeError, Publisher, Transition},
};
use delay_notices::DelayNotices;
use health::Health;
use inputs::Inputs;
use params::Live;

/// Silence of `joint_states` after which a warning is reported.
const SILENCE: Duration = Duration::from_secs(1);

/// The node's program.
///
/// # Errors
/// For invalid parameters, or when DDS reports an error.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let (params, mut live) = ControllerParams::declare_live(&mut declare);
    declare.finish()?;
    let lifecycle = Lifecycle::new(node)?;
    let mut configured: Option<ControllerNode> = None;
    let pass = |transition, configured: &mut Option<ControllerNode>| {
        match transition {
            Transition::Configure => *configured = Some(ControllerNode::new(node, &params)?),
            Transition::CleanUp | Transition::Shutdown => *configured = None,
            Transition::Activate | Transition::Deactivate => {}
        }
        Ok(())
    };
    if params.autostart {
        lifecycle.start(|transition| pass(transition, &mut configured))?;
    }
    loop {
        lifecycle.follow(|transition| pass(transition, &mut configured));
        match &mut configured {
            Some(configured) if lifecycle.is_active() => {
                configured.update(node, &params, &mut live)?
            }
            Some(configured) => configured.ignore(),
            None => {}
        }
        if !node.wait_for(SILENCE) {
            return Ok(());
        }
    }
}

/// Endpoints and control loop of a configured node.
struct ControllerNode {
    description: RobotDescription,
    inputs: Inputs,
    commands: Publisher<JointState>,
    state: Publisher<ControllerState>,
    health: Health,
    delays: DelayNotices,
    /// `None` before a robot description has arrived.
    robot: Option<ControlledRobot>,
}

struct ControlledRobot {
    control_loop: ControlLoop,
    messages: ControllerMessages,
}

impl ControllerNode {
    fn new(node: &Node, params: &ControllerParams) -> Result<Self, NodeError> {
        Ok(Self {
            description: RobotDescription::new(node, params.tip_link.clone())?,
            health: Health::new(node),
            delays: DelayNotices::new(node),
            inputs: Inputs::new(
                node,
                !params.second_tip_link.is_empty(),
                params.delay_compensation,
            )?,
            commands: topics::JOINT_COMMANDS.advertise(node)?,
            state: topics::CONTROLLER_STATE.advertise(node)?,
            robot: None,
        })
    }

    /// While the node is active: takes received messages, and answers joint states with efforts.
    fn update(
        &mut self,
        node: &Node,
        params: &ControllerParams,
        live: &mut Live,
    ) -> Result<(), NodeError> {
        if let Some(robot) = self.description.changed() {
            match control_loop(robot, params, live.get()) {
                Ok(control_loop) => {
                    let controller = control_loop.controller();
                    live.fit(controller.model().dof());
                    self.robot = Some(ControlledRobot {
                        messages: ControllerMessages::new(controller),
                        control_loop,
                    });
                }
                Err(e) if self.robot.is_none() => {
                    let node = node.name();
                    return Err(NodeError::Input(format!("node {node}: parameter {e}")));
                }
                Err(e) => self.description.refuse(&format!("parameter {e}")),
            }
        }
        let Some(robot) = &mut self.robot else {
            return Ok(());
        };
        let ControlledRobot {
            control_loop,
            messages,
        } = robot;
        if let Some(config) = live.changed() {
            let controller = control_loop.controller();
            let config = params.complete(config, controller.model(), controller.tip());
            let set =
                |config| (control_loop.set_controller_config(config)).map_err(|e| e.to_string());
            if let Err(e) = config.and_then(set) {
                let warning = format!("parameter {e}; the gains before stay in force");
                self.health.control.warn(warning);
            }
        }
        self.inputs.feed(control_loop, &self.health.control);
        while let Some(report) = control_loop.step() {
            self.health.report(&report, params.measurement_timeout);
            let problem = self.delays.follow(&report, self.inputs.delay_topic());
            if let Some(problem) = problem {
                self.health.control.error(problem);
            }
            messages.write(control_loop, &report);
            self.commands.publish(&messages.command);
            if report.control.is_ok() {
                self.state.publish(&messages.state);
            }
        }
        if let Some((age, topic)) = self.inputs.silence(SILENCE) {
            let seconds = age.as_secs_f64();
            self.health.control.warn(format!(
                "{topic} has been silent for {seconds:.0} s: no commands are given"
            ));
        }
        Ok(())
    }

    /// While the node is inactive: takes received messages without answering them.
    fn ignore(&mut self) {
        if let Some(robot) = &mut self.robot {
            (self.inputs).feed(&mut robot.control_loop, &self.health.control);
            robot.control_loop.skip();
        }
        (self.health.control).warn("the node is not active: no commands are given");
    }
}

fn control_loop(
    robot: Robot,
    params: &ControllerParams,
    config: ControllerConfig,
) -> Result<ControlLoop, String> {
    let more_tips = second_tip(&robot.model, &params.second_tip_link)?;
    let config = params.complete(config, &robot.model, &robot.tip)?;
    let controller = Controller::with_tips(robot.model, robot.tip, more_tips, config);
    let config = ControlLoopConfig {
        timeout: params.measurement_timeout,
        lockstep: params.lockstep,
        compensates_delay: params.delay_compensation,
    };
    Ok(ControlLoop::new(
        controller.map_err(|e| e.to_string())?,
        config,
    ))
}

/// The frame of the second tip, if `link` names one.
///
/// # Errors
/// Lists the robot's links.
pub fn second_tip(model: &Model, link: &str) -> Result<Vec<Frame>, String> {
    if link.is_empty() {
        return Ok(Vec::new());
    }
    let tip = tip_frame(model, link).map_err(|e| format!("second_{e}"))?;
    Ok(vec![tip])
}
