//! The teleop node: joint rates from an operator's joystick or twists.
//!
//! The last valid message on `joy` or `cmd_vel` is in force for `command_timeout`. While its button is pressed, the
//! joystick has priority over twists. A released button, an invalid message or a timeout stops the arm at once, with
//! zero rates. Nothing is commanded before the operator has moved the arm for the first time.
//!
//! Commands are in the axes of the base, of the tip or of the world. The node knows the base's attitude from the gyro
//! only: `base_orientation` at the first measurement, integrated with `imu` since. So the assumed world axes drift with
//! the gyro. The method ([`Resolution`]) determines whether a command is motion in inertial space or relative to the
//! base.

mod base_attitude;
mod input_arbitration;
mod operator_command;
mod params;
mod steering;

pub use operator_command::{CommandFrame, OperatorCommand};
pub use params::{SimulatedOperator, TeleopParams};
pub use steering::{Steered, Steering, SteeringConfig};

use nalgebra::DVector;
use std::time::{Duration, Instant};

use super::{
    choice, joint_vectors,
    robot_description::{Robot, RobotDescription},
    topics,
};
use crate::{
    control::Resolution,
    model::Model,
    msg::{
        geometry_msgs::TwistStamped,
        sensor_msgs::{Imu, JointState, Joy},
        std_msgs::Header,
    },
    ros::{Node, NodeError, Publisher, Status, Subscription},
};
use base_attitude::BaseAttitude;
use input_arbitration::{OperatorInput, Request};
use operator_command::FrameNames;
use params::Live;

/// Shortest time between two commands.
const MIN_PERIOD: Duration = Duration::from_millis(10);

/// How long diagnostics keep reporting an invalid message although valid ones follow.
const REFUSAL_SHOWN: Duration = Duration::from_secs(5);

/// The node's program.
///
/// # Errors
/// For invalid parameters, or when DDS reports an error.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let declared = TeleopParams::declare_live(&mut declare);
    declare.finish()?;
    let (params, live) =
        declared.map_err(|e| NodeError::Input(format!("node {}: {e}", node.name())))?;
    let mut description = RobotDescription::new(node, params.tip_link.clone())?;
    let mut teleop = Teleop::new(node, params, live)?;
    let Some(robot) = description.wait(node) else {
        return Ok(());
    };
    teleop.take_robot(robot);
    while teleop.wait() {
        if let Some(robot) = description.changed() {
            teleop.take_robot(robot);
        }
        teleop.listen();
        teleop.command_if_due();
    }
    Ok(())
}

/// The robot, its steering and its state.
struct SteeredArm {
    steering: Steering,
    names: FrameNames,
    /// Joint positions, or the reason why they are invalid, with the time of arrival.
    state: Option<(Instant, Result<DVector<f64>, String>)>,
}

struct Teleop<'a> {
    node: &'a Node,
    params: TeleopParams,
    live: Live,
    joint_states: Subscription<JointState>,
    imu: Subscription<Imu>,
    joy: Subscription<Joy>,
    cmd_vel: Subscription<TwistStamped>,
    commands: Publisher<JointState>,
    arm: Option<SteeredArm>,
    attitude: BaseAttitude,
    input: OperatorInput,
    /// Whether the operator has sent a message since the last command.
    new_message: bool,
    commanded: Option<Instant>,
    operator_status: Status,
    steering_status: Status,
    imu_status: Status,
    refused: u64,
    /// Time and reason of the last refusal of a message.
    refusal: Option<(Instant, String)>,
}

impl<'a> Teleop<'a> {
    fn new(node: &'a Node, params: TeleopParams, live: Live) -> Result<Self, NodeError> {
        let imu_status = node.diagnostics().status("imu");
        imu_status.ok("not measured yet; needed for commands in the world's axes only");
        Ok(Self {
            joint_states: topics::JOINT_STATES.subscribe(node)?,
            imu: topics::IMU.subscribe(node)?,
            joy: topics::JOY.subscribe(node)?,
            cmd_vel: topics::CMD_VEL.subscribe(node)?,
            commands: topics::JOINT_COMMANDS.advertise(node)?,
            operator_status: node.diagnostics().status("operator"),
            steering_status: node.diagnostics().status("steering"),
            imu_status,
            attitude: BaseAttitude::new(params.base_orientation),
            arm: None,
            input: OperatorInput::default(),
            new_message: false,
            commanded: None,
            refused: 0,
            refusal: None,
            node,
            params,
            live,
        })
    }

    fn take_robot(&mut self, Robot { model, tip }: Robot) {
        let names = FrameNames {
            base: model.frames()[0].name.clone(),
            tip: tip.name.clone(),
        };
        self.arm = Some(SteeredArm {
            steering: Steering::new(model, &tip, self.live.steering()),
            names,
            state: None,
        });
    }

    /// Time until the next command is due.
    fn until_due(&self) -> Duration {
        let period = match self.new_message {
            true => MIN_PERIOD,
            false => Duration::from_secs_f64(1.0 / self.params.rate),
        };
        let since = self.commanded.map_or(Duration::MAX, |last| last.elapsed());
        period.saturating_sub(since)
    }

    fn wait(&self) -> bool {
        // Before the first command there is no deadline.
        let timeout = match self.input.has_moved() {
            true => self.until_due(),
            false => Duration::from_millis(100),
        };
        self.node.wait_for(timeout)
    }

    /// Reads received messages.
    fn listen(&mut self) {
        let Some(arm) = &mut self.arm else { return };
        if self.live.changed() {
            arm.steering.set_config(self.live.steering());
        }
        let now = Instant::now();
        if let Some(received) = self.joint_states.latest() {
            let q = joint_vectors::positions(arm.steering.model(), &received.message);
            arm.state = Some((now, q));
        }
        while let Some(received) = self.imu.take() {
            match self.attitude.take(&received.message, &arm.names.base) {
                Ok(()) => match self.attitude.R_WB() {
                    Ok(_) => self.imu_status.ok("the attitude of the base is integrated"),
                    Err(lost) => self.imu_status.warn(lost),
                },
                Err(problem) => (self.imu_status).warn(format!("{}: {problem}", self.imu.topic())),
            }
        }
        let mut refuse = |topic: &str, problem: String| {
            let text = format!("{topic}: {problem}; the arm is stopped");
            self.refused += 1;
            if self.refused == 1 {
                tracing::warn!("{text}");
            }
            self.refusal = Some((now, text));
        };
        while let Some(received) = self.joy.take() {
            self.new_message = true;
            let taken = (self.input).take_joy(&received.message, &self.params.joystick, now);
            if let Err(problem) = taken {
                refuse(self.joy.topic(), problem);
            }
        }
        while let Some(received) = self.cmd_vel.take() {
            self.new_message = true;
            let (message, frame) = (&received.message, self.live.frame());
            let taken = self.input.take_cmd_vel(message, &arm.names, frame, now);
            if let Err(problem) = taken {
                refuse(self.cmd_vel.topic(), problem);
            }
        }
    }

    fn command_if_due(&mut self) {
        let now = Instant::now();
        let timeout = self.params.command_timeout;
        let request = self.input.request(self.live.frame(), timeout, now);
        self.report(&request);
        if !self.input.has_moved() || !self.until_due().is_zero() {
            return;
        }
        let Some(arm) = &mut self.arm else { return };
        let stamp = self.node.now();
        let time = stamp.as_secs_f64();
        let status = &self.steering_status;
        match steer(arm, &request, &self.attitude, time, timeout) {
            Ok(Some(steered)) => report_steering(status, &arm.steering, &steered),
            Ok(None) => status.ok("the arm is stopped"),
            Err(problem) => {
                arm.steering.stop(time);
                status.warn(format!("{problem}; the arm is stopped"));
            }
        }
        let header = Header {
            stamp: stamp.into(),
            frame_id: arm.names.base.clone(),
        };
        self.commands.publish(&message(&arm.steering, header));
        self.commanded = Some(now);
        self.new_message = false;
    }

    /// Reports the state of the operator's inputs.
    fn report(&self, request: &Request) {
        let status = &self.operator_status;
        status.set("refused", self.refused);
        if let Some((at, text)) = &self.refusal
            && at.elapsed() < REFUSAL_SHOWN
        {
            status.warn(text.clone());
            return;
        }
        match request {
            Request::Nothing => status.warn(format!(
                "no message on {} or {} yet",
                self.joy.topic(),
                self.cmd_vel.topic()
            )),
            Request::Move(_) => status.ok("steering"),
            Request::Released => status.ok("enable_button is not pressed: the arm is stopped"),
            Request::Lost(problem) => status.warn(format!("{problem}: the arm is stopped")),
        }
    }
}

/// Computes the joint rates for a request. Returns the limits that acted, or `None` if the arm must stop.
fn steer(
    arm: &mut SteeredArm,
    request: &Request,
    attitude: &BaseAttitude,
    time: f64,
    timeout: Duration,
) -> Result<Option<Steered>, String> {
    let Request::Move(command) = request else {
        arm.steering.stop(time);
        return Ok(None);
    };
    let (at, q) = (arm.state.as_ref()).ok_or("no joint_states have arrived yet")?;
    let q = q.as_ref().map_err(|e| format!("joint_states: {e}"))?;
    let age = at.elapsed();
    if age > timeout {
        let seconds = age.as_secs_f64();
        return Err(format!("joint_states has been silent for {seconds:.1} s"));
    }
    let V_B = (arm.steering).in_base_axes(command, q, attitude.R_WB())?;
    Ok(Some(arm.steering.steer(time, q, &V_B)))
}

/// Reports the limits that act on a command.
fn report_steering(status: &Status, steering: &Steering, steered: &Steered) {
    let config = steering.config();
    let method = choice::name_of(&Resolution::NAMES, &config.resolution.method);
    let weakest = steered.resolved.smallest_singular_value;
    status.set("method", method);
    status.set("smallest singular value [m]", format!("{weakest:.4}"));
    let joint = |j: usize| joint_name(steering.model(), j);
    if let Some(j) = steered.limited.position {
        status.warn(format!(
            "joint '{}' is near its position limit: the arm slows down",
            joint(j)
        ));
    } else if steered.resolved.damped {
        status.warn(format!(
            "near a singular posture (singular value {weakest:.4} m, damping_threshold is {} m): the tip does not exactly follow",
            config.resolution.damping_threshold
        ));
    } else if let Some(j) = steered.limited.rate {
        status.warn(format!(
            "joint '{}' is at its rate limit: the tip is slower than commanded",
            joint(j)
        ));
    } else if steered.too_fast {
        status.warn("the command is faster than max_linear_speed or max_angular_speed: it is cut");
    } else {
        status.ok(format!("steering by {method}"));
    }
}

fn joint_name(model: &Model, j: usize) -> &str {
    &model.joints()[j].name
}

/// The commanded joint rates as a message.
pub fn message(steering: &Steering, header: Header) -> JointState {
    let joints = steering.model().joints().iter();
    JointState {
        header,
        name: joints.map(|j| j.name.clone()).collect(),
        velocity: steering.rates().as_slice().to_vec(),
        ..JointState::default()
    }
}
