//! The mission node: captures a target that the estimator observes.
//!
//! The node feeds a [`CaptureMission`] with joint states, gyro rates, measured poses of the grasp frame and the
//! estimator's prediction. It answers every state with joint efforts. While it detumbles, the robot's wheels absorb
//! momentum by torques on `wheel_commands`. The external couple is produced by its thrusters (`thruster_commands`);
//! without thrusters it is published on `wrench`, as from ideal thrusters. The node does not subscribe to
//! `ground_truth/`.
//!
//! A mission begins with the action `capture`, or automatically with `autostart`. If a mission with `autostart` is
//! aborted, except by an operator, the process exits with status 1. The operator's services are `~/hold`, `~/resume`,
//! `~/skip` and `~/abort` (`std_srvs/Trigger`).

mod actuators;
mod gripper;
mod messages;
mod operator_services;
mod params;

pub use actuators::Actuators;
pub use messages::{StateTimer, couple, efforts, forecast, on_times, state};
pub use params::{Fingers, Grip, MissionParams};

use std::time::{Duration, Instant};

use super::{
    geometry::{pose_from_msg, vector_from_msg, with_matrix},
    joint_vectors,
    robot_description::{Robot, RobotDescription},
    topics,
};
use crate::{
    control::{
        StampPairs,
        capture::{CaptureMission, Sample},
    },
    msg::{
        fuyu_msgs::{
            MissionState, ThrusterCommands,
            capture::{Capture, Outcome},
        },
        geometry_msgs::{PoseStamped, WrenchStamped},
        nav_msgs::Path,
        sensor_msgs::{Imu, JointState},
        std_msgs::Header,
    },
    ros::{
        ActionServer, Goal, Node, NodeError, Publisher, Status, Subscription, Time,
        publish_together,
    },
};
use gripper::GripperDriver;
use operator_services::Operator;

/// Longest wait for a message before goals and service calls are checked.
const PATIENCE: Duration = Duration::from_millis(100);
/// Time without an answered state after which cancelling a goal ends it at once.
const SILENCE: Duration = Duration::from_secs(1);
/// Queue length for inputs that must not be lost.
const QUEUE: usize = 100;

/// The node's program.
///
/// # Errors
/// For invalid parameters, or when DDS reports an error.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = MissionParams::declare(&mut declare);
    declare.finish()?;
    let input = |e: String| NodeError::Input(format!("node {}: {e}", node.name()));
    let params = params.map_err(input)?;
    let mut description = RobotDescription::new(node, params.tip_link.clone())?;
    let mut mission_node = MissionNode::new(node, params)?;
    let Some(robot) = description.wait(node) else {
        return Ok(());
    };
    // Refuses at once settings that do not fit the robot.
    mission_node.params.mission(&robot.model).map_err(input)?;
    mission_node.robot = Some(robot);
    while node.wait_for(PATIENCE) {
        if let Some(robot) = description.changed() {
            mission_node.abort("the robot has changed");
            mission_node.robot = Some(robot);
            mission_node.mission = None;
        }
        mission_node.take_goals();
        mission_node.operator.follow(mission_node.mission.as_mut());
        mission_node.update();
    }
    mission_node.verdict()
}

struct MissionNode {
    params: MissionParams,
    joint_states: Subscription<JointState>,
    imu: Subscription<Imu>,
    grasp_poses: Subscription<PoseStamped>,
    predictions: Subscription<Path>,
    /// `None` unless wheels are in use.
    wheel_states: Option<Subscription<JointState>>,
    wheel_commands: Option<Publisher<JointState>>,
    /// `None` unless thrusters are in use.
    thruster_commands: Option<Publisher<ThrusterCommands>>,
    commands: Publisher<JointState>,
    wrench: Publisher<WrenchStamped>,
    mission_state: Publisher<MissionState>,
    action: ActionServer<Capture>,
    operator: Operator,
    gripper: GripperDriver,
    status: Status,
    states: StampPairs<Time, JointState, Imu>,
    /// States paired with wheel states, which arrive on a separate topic.
    states_with_wheels: StampPairs<Time, (JointState, Imu), JointState>,
    robot: Option<Robot>,
    mission: Option<CaptureMission>,
    goal: Option<Goal<Capture>>,
    /// Whether the mission with `autostart` has begun.
    has_begun: bool,
    pushes: bool,
    timer: StateTimer,
    reported: usize,
    /// Instant at which the last state was answered.
    answered: Instant,
}

impl MissionNode {
    fn new(node: &Node, params: MissionParams) -> Result<Self, NodeError> {
        let status = node.diagnostics().status("mission");
        status.ok("no mission has begun");
        Ok(Self {
            joint_states: topics::JOINT_STATES.subscribe_deep(node, QUEUE)?,
            imu: topics::IMU.subscribe_deep(node, QUEUE)?,
            grasp_poses: topics::MEASURED_GOAL.subscribe_deep(node, QUEUE)?,
            predictions: topics::PREDICTION.subscribe(node)?,
            wheel_states: (params.actuators.has_wheels())
                .then(|| topics::WHEEL_STATES.subscribe_deep(node, QUEUE))
                .transpose()?,
            wheel_commands: (params.actuators.has_wheels())
                .then(|| topics::WHEEL_COMMANDS.advertise(node))
                .transpose()?,
            thruster_commands: (params.actuators.has_thrusters())
                .then(|| topics::THRUSTER_COMMANDS.advertise(node))
                .transpose()?,
            commands: topics::JOINT_COMMANDS.advertise(node)?,
            wrench: topics::WRENCH.advertise(node)?,
            mission_state: topics::MISSION_STATE.advertise(node)?,
            action: ActionServer::with_requests(node, "capture")?,
            operator: Operator::new(node)?,
            gripper: GripperDriver::new(node, &params.grip)?,
            status,
            states: StampPairs::default(),
            states_with_wheels: StampPairs::default(),
            robot: None,
            mission: None,
            goal: None,
            has_begun: false,
            pushes: false,
            timer: StateTimer::default(),
            reported: 0,
            answered: Instant::now(),
            params,
        })
    }

    /// Accepts a goal if none is active. The goal follows the running mission, or begins a new one.
    fn take_goals(&mut self) {
        while let Some(request) = self.action.take_request() {
            if self.goal.is_some() || self.robot.is_none() {
                tracing::warn!("capture: refused, another goal is being executed");
                request.reject();
                continue;
            }
            if self.mission.as_ref().is_some_and(|m| m.phase().is_over()) {
                self.mission = None;
            }
            self.goal = request.accept();
            self.answered = Instant::now();
        }
        if !self.goal.as_ref().is_some_and(Goal::is_canceling) {
            return;
        }
        if let Some(mission) = &mut self.mission {
            // If the mission is over already, its goal ends below.
            let _ = mission.abort("cancelled by the client");
        }
        // Without states, no mission step would end the goal.
        if self.answered.elapsed() > SILENCE
            && let Some(goal) = self.goal.take()
        {
            goal.canceled(Outcome {
                reason: "cancelled by the client; no states arrive that can be answered".to_owned(),
                ..Outcome::default()
            });
            self.mission = None;
        }
    }

    fn abort(&mut self, reason: &str) {
        if let Some(goal) = self.goal.take() {
            goal.abort(Outcome {
                reason: reason.to_owned(),
                ..Outcome::default()
            });
        }
    }

    /// Takes received messages, and answers states.
    fn update(&mut self) {
        while let Some(received) = self.joint_states.take() {
            let stamp = Time::from(&received.message.header.stamp);
            self.states.push_first(stamp, received.message);
        }
        while let Some(received) = self.imu.take() {
            let stamp = Time::from(&received.message.header.stamp);
            self.states.push_second(stamp, received.message);
        }
        let is_wanted = self.goal.is_some() || (self.params.autostart && !self.has_begun);
        if self.mission.is_none()
            && is_wanted
            && let Some(robot) = &self.robot
        {
            match self.params.mission(&robot.model) {
                Ok(mission) => {
                    self.mission = Some(mission);
                    self.has_begun = true;
                    self.reported = 0;
                    self.timer = StateTimer::default();
                }
                Err(problem) => self.abort(&problem),
            }
        }
        self.take_measurements();
        while let Some((stamp, joints, imu, wheels)) = self.next_state() {
            if let Err(problem) = self.answer(stamp, &joints, &imu, wheels.as_ref()) {
                self.status.warn(problem);
            }
        }
    }

    /// The next complete state of joints and base, and of the wheels if they are in use.
    fn next_state(&mut self) -> Option<(Time, JointState, Imu, Option<JointState>)> {
        let Some(wheel_states) = &self.wheel_states else {
            let (stamp, joints, imu) = self.states.pop()?;
            return Some((stamp, joints, imu, None));
        };
        while let Some(received) = wheel_states.take() {
            let stamp = Time::from(&received.message.header.stamp);
            self.states_with_wheels.push_second(stamp, received.message);
        }
        let is_silent = wheel_states.age().is_none_or(|age| age > SILENCE);
        while let Some((stamp, joints, imu)) = self.states.pop() {
            if is_silent && self.answered.elapsed() > SILENCE {
                self.status.warn(format!(
                    "{} is silent; states are answered with the speeds of the wheels, or use_wheels must be false",
                    wheel_states.topic()
                ));
            }
            self.states_with_wheels.push_first(stamp, (joints, imu));
        }
        let (stamp, (joints, imu), wheels) = self.states_with_wheels.pop()?;
        Some((stamp, joints, imu, Some(wheels)))
    }

    fn take_measurements(&mut self) {
        while let Some(received) = self.grasp_poses.take() {
            let time = Time::from(&received.message.header.stamp).as_secs_f64();
            match (pose_from_msg(&received.message.pose), &mut self.mission) {
                (Ok(pose), Some(mission)) => mission.add_grasp_pose(time, with_matrix(&pose)),
                (Ok(_), None) => {}
                (Err(e), _) => self
                    .status
                    .warn(format!("{}: {e}", self.grasp_poses.topic())),
            }
        }
        while let Some(received) = self.predictions.take() {
            match (forecast(&received.message), &mut self.mission) {
                (Ok(forecast), Some(mission)) => mission.add_forecast(forecast),
                (Ok(_), None) => {}
                (Err(e), _) => self
                    .status
                    .warn(format!("{}: {e}", self.predictions.topic())),
            }
        }
    }

    /// Advances the mission by a state, and publishes its commands.
    fn answer(
        &mut self,
        stamp: Time,
        joints: &JointState,
        imu: &Imu,
        wheels: Option<&JointState>,
    ) -> Result<(), String> {
        let Some(mission) = &mut self.mission else {
            return Ok(());
        };
        let model = mission.model().clone();
        let model = &model;
        let at = |e: String| format!("joint_states: {e}");
        let q = joint_vectors::positions(model, joints).map_err(at)?;
        let qd = joint_vectors::velocities(model, joints).map_err(at)?;
        let w_B = vector_from_msg(&imu.angular_velocity);
        if !w_B.iter().all(|w| w.is_finite()) {
            return Err(format!(
                "{}: angular_velocity is {w_B:?}; it must be finite",
                self.imu.topic()
            ));
        }
        let actuators = &self.params.actuators;
        let wheel_speeds = wheels.map_or(Ok(Vec::new()), |message| {
            joint_vectors::wheel_speeds(actuators.wheels(), message)
        });
        let wheel_speeds = wheel_speeds.map_err(|e| format!("wheel_states: {e}"))?;
        let sample = Sample {
            time: stamp.as_secs_f64(),
            q: q.as_slice(),
            qd: qd.as_slice(),
            w_B,
            wheel_speeds: &wheel_speeds,
        };
        let command = mission.step(&sample).map_err(|e| e.to_string())?;
        let header = Header {
            stamp: stamp.into(),
            frame_id: model.frames()[0].name.clone(),
        };
        // Thrusters produce the couple if they are in use.
        let pushes = command.couple.norm() > 0.0 && self.thruster_commands.is_none();
        let couple =
            (pushes || self.pushes).then(|| messages::couple(header.clone(), &command.couple));
        let wheels = (self.wheel_commands.as_ref())
            .map(|_| messages::efforts(actuators.wheels(), header.clone(), command.wheel_torques));
        let on_times = (command.on_times)
            .map(|times| messages::on_times(actuators.thrusters(), header.clone(), times));
        let names = model.joints().iter().map(|joint| joint.name.as_str());
        let efforts = messages::efforts(names, header.clone(), command.efforts);
        let wanted = command.gripper;
        self.pushes = pushes;
        publish_together(|| {
            // Efforts come last: in lockstep they let time advance.
            if let Some(couple) = &couple {
                self.wrench.publish(couple);
            }
            if let (Some(thrusters), Some(on_times)) = (&self.thruster_commands, &on_times) {
                thrusters.publish(on_times);
            }
            if let (Some(publisher), Some(wheels)) = (&self.wheel_commands, &wheels) {
                publisher.publish(wheels);
            }
            self.commands.publish(&efforts);
        });
        mission.set_grip(self.gripper.follow(wanted, sample.time, joints));
        if self.timer.is_due(mission, sample.time) {
            (self.mission_state).publish(&messages::state(mission, header.clone()));
            if let Some(goal) = &self.goal {
                goal.feedback(messages::feedback(mission, header));
            }
            let phase = mission.phase().name();
            self.status.set("phase", phase);
            self.status
                .set("progress", format!("{:.2}", mission.progress()));
            match mission.waits_for() {
                "" => self.status.ok(phase.to_owned()),
                reason => self.status.ok(format!("{phase}: waits, {reason}")),
            }
        }
        self.answered = Instant::now();
        self.report();
        Ok(())
    }

    /// An error if a mission with `autostart` was aborted, except on request.
    fn verdict(&self) -> Result<(), NodeError> {
        let mission = self.mission.as_ref().filter(|_| self.params.autostart);
        let mission = mission.filter(|mission| !mission.is_aborted_on_request());
        match mission.and_then(CaptureMission::abort_reason) {
            Some(reason) => Err(NodeError::Failed(format!(
                "the mission was aborted: {reason}"
            ))),
            None => Ok(()),
        }
    }

    /// Logs finished phases, and ends the goal when the mission is over.
    fn report(&mut self) {
        let Some(mission) = &self.mission else {
            return;
        };
        let ended = mission.reports().iter().filter(|r| r.end.is_some());
        for report in ended.skip(self.reported) {
            self.reported += 1;
            let figures = report.figures.iter();
            let figures: Vec<_> = figures
                .map(|f| {
                    format!("{} {:.4} {}", f.name, f.value, f.unit)
                        .trim_end()
                        .to_owned()
                })
                .collect();
            tracing::info!(
                "{} from {:.1} s to {:.1} s: {}; {}",
                report.phase.name(),
                report.start,
                report.end.unwrap_or(report.start),
                report.outcome,
                figures.join(", ")
            );
        }
        if !mission.phase().is_over() {
            return;
        }
        let outcome = messages::outcome(mission);
        if let Some(goal) = self.goal.take() {
            match (outcome.captured, goal.is_canceling()) {
                (true, _) => goal.succeed(outcome),
                (false, true) => goal.canceled(outcome),
                (false, false) => goal.abort(outcome),
            }
        }
    }
}
