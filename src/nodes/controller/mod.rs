//! The controller node: joint states and camera measurements in, joint efforts out.
//!
//! It never learns where the base is: it subscribes to nothing under `ground_truth/`, nor to `/tf`.

mod params;

pub use params::ControllerParams;
use params::Live;

use std::{collections::VecDeque, time::Duration};

use nalgebra::Vector3;

use super::{
    geometry::{pose_from_msg, vector_from_msg, vector_to_msg, with_matrix},
    joint_vectors,
    robot_description::{Robot, RobotDescription},
    stamp_pairs::StampPairs,
    tip_frame, topics,
};
use crate::{
    control::{ControlReport, Controller, ControllerConfig, GoalRate, Measurement, TipMeasurement},
    model::{Frame, Model},
    msg::{
        fuyu_msgs::ControllerState,
        geometry_msgs::{PoseStamped, Vector3Stamped},
        sensor_msgs::{Imu, JointState},
        std_msgs::Header,
    },
    ros::{
        Lifecycle, Node, NodeError, Publisher, Received, Status, Subscription, Time, Transition,
    },
    spatial::Pose,
};

/// Silence of `joint_states` that is worth a warning.
const SILENCE: Duration = Duration::from_secs(1);

/// The node's program.
///
/// # Errors
/// For wrong parameters, or when DDS refuses.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let (params, mut live) = ControllerParams::declare_live(&mut declare);
    declare.finish()?;
    let lifecycle = Lifecycle::new(node)?;
    let mut work: Option<Work> = None;
    let pass = |transition, work: &mut Option<Work>| {
        match transition {
            Transition::Configure => *work = Some(Work::new(node, &params)?),
            Transition::CleanUp | Transition::Shutdown => *work = None,
            Transition::Activate | Transition::Deactivate => {}
        }
        Ok(())
    };
    if params.autostart {
        lifecycle.start(|transition| pass(transition, &mut work))?;
    }
    loop {
        lifecycle.follow(|transition| pass(transition, &mut work));
        match &mut work {
            Some(work) if lifecycle.is_active() => work.turn(node, &params, &mut live)?,
            Some(work) => work.ignore(),
            None => {}
        }
        if !node.wait_for(SILENCE) {
            return Ok(());
        }
    }
}

/// A controller and what it hears and tells.
struct Work {
    description: RobotDescription,
    topics: Topics,
    /// `None` before the robot is known.
    controller: Option<Controller>,
}

impl Work {
    fn new(node: &Node, params: &ControllerParams) -> Result<Self, NodeError> {
        Ok(Self {
            description: RobotDescription::new(node, params.tip_link.clone())?,
            topics: Topics::new(node, params)?,
            controller: None,
        })
    }

    /// Takes in what has come, and answers the states that are to be answered.
    fn turn(
        &mut self,
        node: &Node,
        params: &ControllerParams,
        live: &mut Live,
    ) -> Result<(), NodeError> {
        let second = &params.second_tip_link;
        if let Some(robot) = self.description.changed() {
            match controller(robot, second, live.get()) {
                Ok(new) => {
                    live.fit(new.model().dof());
                    self.controller = Some(new);
                }
                Err(e) if self.controller.is_none() => {
                    let node = node.name();
                    return Err(NodeError::Input(format!("node {node}: parameter {e}")));
                }
                Err(e) => self.description.refuse(&format!("parameter {e}")),
            }
        }
        let Some(controller) = &mut self.controller else {
            return Ok(());
        };
        if let Some(config) = live.changed()
            && let Err(e) = controller.set_config(config)
        {
            (self.topics.status).warn(format!("parameter {e}; the gains before stay in force"));
        }
        if self.topics.listen() {
            controller.restart();
        }
        while let Some(joints) = self.topics.next_state() {
            self.topics.answer(controller, &joints);
        }
        self.topics.notice_silence();
        Ok(())
    }

    /// Takes in what has come, and leaves it unanswered: the node is not active.
    fn ignore(&mut self) {
        if self.topics.listen()
            && let Some(controller) = &mut self.controller
        {
            controller.restart();
        }
        self.topics.states.clear();
        (self.topics.status).warn("the node is not active: no commands are given");
    }
}

fn controller(robot: Robot, second: &str, config: ControllerConfig) -> Result<Controller, String> {
    let more_tips = second_tip(&robot.model, second)?;
    Controller::with_tips(robot.model, robot.tip, more_tips, config).map_err(|e| e.to_string())
}

/// The frame of the second tip, if `link` names one.
///
/// # Errors
/// Names the links that there are.
pub fn second_tip(model: &Model, link: &str) -> Result<Vec<Frame>, String> {
    if link.is_empty() {
        return Ok(Vec::new());
    }
    let tip = tip_frame(model, link).map_err(|e| format!("second_{e}"))?;
    Ok(vec![tip])
}

/// Endpoints of the controller node and what has come from them.
struct Topics {
    joint_states: Subscription<JointState>,
    tip_pose: Subscription<PoseStamped>,
    goal_pose: Subscription<PoseStamped>,
    second: Option<SecondArm>,
    imu: Subscription<Imu>,
    target_rate: Subscription<Vector3Stamped>,
    commands: Publisher<JointState>,
    state: Publisher<ControllerState>,
    states: VecDeque<JointState>,
    poses: StampPairs<Pose, Pose>,
    /// The newest pair of camera poses, with its stamp.
    seen: Option<(Time, TipMeasurement)>,
    /// What the gyro measured last, with its stamp.
    gyro: Option<(Time, Vector3<f64>)>,
    /// The estimator's last answer, in the axes of the camera that it names.
    rate: Option<Vector3Stamped>,
    /// Stamp of the newest joint state.
    last_state: Option<Time>,
    /// A pair of poses that is further from a joint state is not acted on \[s\].
    timeout: f64,
    lockstep: bool,
    status: Status,
}

/// What the camera sees of a second tip.
struct SecondArm {
    tip_pose: Subscription<PoseStamped>,
    goal_pose: Subscription<PoseStamped>,
    poses: StampPairs<Pose, Pose>,
    seen: Option<(Time, TipMeasurement)>,
}

impl SecondArm {
    fn new(node: &Node) -> Result<Self, NodeError> {
        Ok(Self {
            tip_pose: topics::SECOND_TIP_POSE.subscribe(node)?,
            goal_pose: topics::SECOND_SEEN_GOAL.subscribe(node)?,
            poses: StampPairs::default(),
            seen: None,
        })
    }

    fn listen(&mut self, latest: Time, status: &Status) {
        let sight = newest_pair(&self.tip_pose, &self.goal_pose, &mut self.poses, status);
        if let Some(sight) = sight.filter(|(stamp, _)| *stamp <= latest) {
            self.seen = Some(sight);
        }
    }
}

/// Joint states kept, in lockstep, until their camera frame comes.
const WAITING: usize = 64;

impl Topics {
    fn new(node: &Node, params: &ControllerParams) -> Result<Self, NodeError> {
        let two_arms = !params.second_tip_link.is_empty();
        let status = node.diagnostics().status("control");
        status.warn("no joint_states have arrived yet");
        Ok(Self {
            joint_states: topics::JOINT_STATES.subscribe(node)?,
            tip_pose: topics::TIP_POSE.subscribe(node)?,
            goal_pose: topics::SEEN_GOAL.subscribe(node)?,
            second: two_arms.then(|| SecondArm::new(node)).transpose()?,
            imu: topics::IMU.subscribe(node)?,
            target_rate: topics::TARGET_RATE.subscribe(node)?,
            commands: topics::JOINT_COMMANDS.advertise(node)?,
            state: topics::CONTROLLER_STATE.advertise(node)?,
            states: VecDeque::new(),
            poses: StampPairs::default(),
            seen: None,
            gyro: None,
            rate: None,
            last_state: None,
            timeout: params.measurement_timeout,
            lockstep: params.lockstep,
            status,
        })
    }

    /// Takes in what has arrived. Gives whether time began anew: what went before is of another run.
    fn listen(&mut self) -> bool {
        let mut anew = false;
        while let Some(received) = self.joint_states.take() {
            let stamp = Time::from(&received.message.header.stamp);
            if self.last_state.is_some_and(|last| stamp < last) {
                anew = true;
                self.states.clear();
                self.poses.clear();
                (self.seen, self.gyro, self.rate) = (None, None, None);
                if let Some(second) = &mut self.second {
                    second.poses.clear();
                    second.seen = None;
                }
            }
            self.last_state = Some(stamp);
            if self.states.len() == WAITING {
                self.states.pop_front();
            }
            self.states.push_back(received.message);
        }
        // Poses may overtake their joint state, but what is much later is left over from another run.
        let timeout = Duration::try_from_secs_f64(self.timeout).unwrap_or(Duration::MAX);
        let latest = self.last_state.map_or(Time::MAX, |last| last + timeout);
        let (tip, goal) = (&self.tip_pose, &self.goal_pose);
        let sight = newest_pair(tip, goal, &mut self.poses, &self.status);
        if let Some(sight) = sight.filter(|(stamp, _)| *stamp <= latest) {
            self.seen = Some(sight);
        }
        if let Some(second) = &mut self.second {
            second.listen(latest, &self.status);
        }
        while let Some(received) = self.imu.take() {
            let stamp = Time::from(&received.message.header.stamp);
            let w = vector_from_msg(&received.message.angular_velocity);
            if w.iter().all(|w| w.is_finite()) {
                self.gyro = Some((stamp, w));
            } else {
                let topic = self.imu.topic();
                self.status.warn(format!(
                    "{topic}: angular_velocity is not finite; it is ignored"
                ));
            }
        }
        while let Some(received) = self.target_rate.take() {
            let w = vector_from_msg(&received.message.vector);
            if w.iter().all(|w| w.is_finite()) {
                self.rate = Some(received.message);
            }
        }
        anew
    }

    /// The goal's angular velocity in base axes, if the estimator tells it for a camera that the base carries. Not in lockstep:
    /// the estimator answers when it is done, so that no two runs would be the same.
    fn goal_rate(&self, model: &Model) -> Option<GoalRate> {
        let rate = self.rate.as_ref().filter(|_| !self.lockstep)?;
        let camera = model.frame(&rate.header.frame_id).filter(|f| f.body == 0)?;
        Some(GoalRate {
            time: Time::from(&rate.header.stamp).as_secs_f64(),
            w_ID_B: camera.X_BF.rotation * vector_from_msg(&rate.vector),
        })
    }

    /// The joint state to answer now: the newest, or in lockstep the one of the camera's last frame.
    fn next_state(&mut self) -> Option<JointState> {
        if !self.lockstep {
            let newest = self.states.pop_back();
            self.states.clear();
            return newest;
        }
        let seen = self.seen.as_ref()?.0;
        // Whatever else belongs to that state has to be there.
        if let Some(second) = &self.second
            && second.seen.as_ref()?.0 < seen
        {
            return None;
        }
        if self.gyro?.0 < seen {
            return None;
        }
        while let Some(state) = self.states.pop_front() {
            let stamp = Time::from(&state.header.stamp);
            if stamp == seen {
                return Some(state);
            }
            if stamp > seen {
                // Its frame is on its way.
                self.states.push_front(state);
                return None;
            }
        }
        None
    }

    fn notice_silence(&self) {
        if let Some(age) = self.joint_states.age().filter(|age| *age > SILENCE) {
            self.status.warn(format!(
                "{} has been silent for {:.0} s: no commands are given",
                self.joint_states.topic(),
                age.as_secs_f64()
            ));
        }
    }

    fn answer(&mut self, controller: &mut Controller, joints: &JointState) {
        let timeout = self.timeout;
        let model = controller.model();
        let vectors = joint_vectors::positions(model, joints)
            .and_then(|q| Ok((q, joint_vectors::velocities(model, joints)?)));
        let (q, qd) = match vectors {
            Ok(vectors) => vectors,
            Err(problem) => {
                self.status
                    .warn(format!("{}: {problem}", self.joint_states.topic()));
                return;
            }
        };
        let now = Time::from(&joints.header.stamp);
        let age = self.seen.as_ref().map(|(stamp, _)| now - *stamp);
        let young = self
            .seen
            .as_ref()
            .filter(|_| age.is_some_and(|age| age.abs() <= timeout));
        let second = self.second.as_ref().and_then(|second| second.seen.as_ref());
        let second = second.filter(|(stamp, _)| (now - *stamp).abs() <= timeout);
        let more_tips = [second.map(|(_, sight)| *sight)];
        let goal_rate = self.goal_rate(model);
        let seen = Measurement {
            more_tips: &more_tips,
            goal_rate: goal_rate.as_ref(),
            ..Measurement::new(now.as_secs_f64(), &q, &qd)
        };
        let seen = seen
            .with_tip(young.map(|(_, sight)| sight))
            .with_gyro(self.gyro.as_ref().map(|(_, w)| w));
        let report = controller.update(&seen);
        match (&report, age) {
            (Err(e), _) => self.status.error(format!("no effort is given: {e}")),
            (Ok(_), None) => self.status.warn("no camera measurement has come yet: only damping"),
            (Ok(_), Some(age)) if age.abs() > timeout => self.status.warn(format!(
                "the last camera measurement is {age:.2} s old (measurement_timeout is {timeout} s): only damping"
            )),
            (Ok(ControlReport { convergence_failure: Some(failure), .. }), Some(_)) => self.status.warn(failure.to_string()),
            (Ok(_), Some(_)) => self.status.ok("steering the tip to the goal"),
        }
        self.commands.publish(&command(controller, &joints.header));
        let seen_age = age.unwrap_or(f64::MAX).min(1e9);
        if let Ok(report) = report {
            self.state.publish(&state_message(
                controller,
                &joints.header,
                &report,
                seen_age,
            ));
        }
    }
}

fn joint_names(controller: &Controller) -> Vec<String> {
    controller
        .model()
        .joints()
        .iter()
        .map(|j| j.name.clone())
        .collect()
}

/// The efforts of the last update, as an answer to the joint state with `header`.
pub fn command(controller: &Controller, header: &Header) -> JointState {
    JointState {
        header: header.clone(),
        name: joint_names(controller),
        effort: controller.efforts().as_slice().to_vec(),
        ..JointState::default()
    }
}

/// What the controller saw, decided and sent; `age` is that of the camera's measurement \[s\].
pub fn state_message(
    controller: &Controller,
    header: &Header,
    report: &ControlReport,
    age: f64,
) -> ControllerState {
    let config = controller.config();
    let mut state = ControllerState {
        header: header.clone(),
        law: config.law.name().to_owned(),
        position_saturated: report.position_saturated,
        orientation_saturated: report.orientation_saturated,
        k_p: config.gains.k_p,
        k_o: config.gains.k_o,
        joint_names: joint_names(controller),
        k_v: config.gains.k_v.clone(),
        effort: controller.efforts().as_slice().to_vec(),
        tip_pose_age: age,
        goal_pose_age: age,
        ..ControllerState::default()
    };
    if let Some(error) = &report.error {
        state.position_error = vector_to_msg(&error.position);
        state.orientation_error = vector_to_msg(&error.orientation);
        state.position_error_norm = error.position.norm();
        state.attitude_error_angle = error.angle;
    }
    if let Some(error) = &report.second_error {
        state.second_tip_seen = true;
        state.second_position_error = vector_to_msg(&error.position);
        state.second_orientation_error = vector_to_msg(&error.orientation);
        state.second_position_error_norm = error.position.norm();
        state.second_attitude_error_angle = error.angle;
    }
    state
}

/// What came last of tip and goal poses of one stamp.
fn newest_pair(
    tip: &Subscription<PoseStamped>,
    goal: &Subscription<PoseStamped>,
    poses: &mut StampPairs<Pose, Pose>,
    status: &Status,
) -> Option<(Time, TipMeasurement)> {
    while let Some((stamp, pose)) = next_pose(tip, status) {
        poses.push_first(stamp, pose);
    }
    while let Some((stamp, pose)) = next_pose(goal, status) {
        poses.push_second(stamp, pose);
    }
    let pairs = std::iter::from_fn(|| poses.pop());
    let (stamp, X_BE, X_BD) = pairs.last()?;
    Some((stamp, TipMeasurement::new(stamp.as_secs_f64(), X_BE, X_BD)))
}

/// The next sound pose that waits, with its stamp; an unsound one is reported.
fn next_pose(topic: &Subscription<PoseStamped>, status: &Status) -> Option<(Time, Pose)> {
    while let Some(Received { message, .. }) = topic.take() {
        match pose_from_msg(&message.pose) {
            Ok(pose) => return Some((Time::from(&message.header.stamp), with_matrix(&pose))),
            Err(problem) => status.warn(format!("{}: {problem}; it is ignored", topic.topic())),
        }
    }
    None
}
