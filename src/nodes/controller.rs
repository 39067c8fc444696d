//! The controller node: joint states and camera measurements in, joint efforts out.
//!
//! It never learns where the base is: it subscribes to nothing under `ground_truth/`, nor to `/tf`.

use std::{
    cmp,
    collections::VecDeque,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use nalgebra::DVector;

use super::{
    choice,
    geometry::{pose_from_msg, vector_to_msg, with_matrix},
    robot_description::{Robot, RobotDescription},
};
use crate::{
    control::{Acted, Controller, ControllerConfig, Gains, JacobianKind, LawKind, Saturation},
    msg::{
        fuyu_msgs::ControllerState, geometry_msgs::PoseStamped, sensor_msgs::JointState,
        std_msgs::Header,
    },
    ros::{Declare, Node, NodeError, Param, Publisher, Qos, Received, Status, Subscription, Time},
    spatial::Pose,
};

/// What the controller node is told at its start.
#[derive(Debug, Clone)]
pub struct ControllerParams {
    /// Link whose frame is the tip.
    pub tip_link: String,
    /// Law and gains.
    pub config: ControllerConfig,
    /// Age of the camera's measurement beyond which the joints are only damped \[s\].
    pub measurement_timeout: f64,
    /// Whether every joint state waits for the camera frame of the same time.
    pub lockstep: bool,
}

/// Law and gains, which may change while the node runs.
struct Live {
    law: Param<String>,
    jacobian: Param<String>,
    k_p: Param<f64>,
    k_o: Param<f64>,
    k_v: Param<Vec<f64>>,
    e_p_max: Param<f64>,
    e_o_max: Param<f64>,
    joint_k_p: Param<Vec<f64>>,
    /// Joints of the robot that the gains must fit; zero until one is known.
    joints: Arc<AtomicUsize>,
}

const SMALLEST_GAIN: f64 = 1e-9;
const LARGEST_GAIN: f64 = 1e9;

impl Live {
    fn declare(declare: &mut Declare) -> Self {
        let law = choice::declare(declare, "law", &LawKind::NAMES, "Control law").live();
        let jacobian = choice::declare(
            declare,
            "jacobian",
            &JacobianKind::NAMES,
            "Jacobian of the law",
        )
        .live();
        let mut positive = |name: &str, default: f64, text: &str| {
            declare
                .param(name, default, text)
                .range(SMALLEST_GAIN, LARGEST_GAIN)
                .live()
        };
        let k_p = positive("k_p", 75.0, "Gain on the position error [N/m]");
        let k_o = positive("k_o", 100.0, "Gain on the orientation error [N m]");
        let e_p_max = positive(
            "e_p_max",
            0.2,
            "Position error beyond which the pull is constant [m]",
        );
        let e_o_max = positive(
            "e_o_max",
            0.1,
            "Orientation error beyond which the pull is constant",
        );
        let joints = Arc::new(AtomicUsize::new(0));
        let mut per_joint = |name: &str, text: &str| {
            let joints = Arc::clone(&joints);
            declare
                .param(name, Vec::<f64>::new(), text)
                .range(SMALLEST_GAIN, LARGEST_GAIN)
                .check("one value per joint of the robot", move |values| {
                    one_per_joint(values, joints.load(Ordering::Acquire))
                })
                .live()
        };
        Self {
            law,
            jacobian,
            k_p,
            k_o,
            e_p_max,
            e_o_max,
            k_v: per_joint(
                "k_v",
                "Gains on the joint rates, one per joint [N m s/rad or N s/m]",
            ),
            joint_k_p: per_joint(
                "joint_k_p",
                "Gains on the joint positions for joint_pd, one per joint [N m/rad or N/m]",
            ),
            joints,
        }
    }

    /// From here on the gains must fit this robot.
    fn fit(&self, robot: &Robot) {
        self.joints.store(robot.model.dof(), Ordering::Release);
    }

    fn get(&self) -> ControllerConfig {
        ControllerConfig {
            // Any other text has been refused by the declaration.
            law: choice::find(&LawKind::NAMES, &self.law.get())
                .unwrap_or(LawKind::TransposeJacobian),
            jacobian: choice::find(&JacobianKind::NAMES, &self.jacobian.get())
                .unwrap_or(JacobianKind::Generalized),
            gains: Gains {
                k_p: self.k_p.get(),
                k_o: self.k_o.get(),
                k_v: self.k_v.get(),
                saturation: Saturation {
                    position: self.e_p_max.get(),
                    orientation: self.e_o_max.get(),
                },
            },
            joint_k_p: self.joint_k_p.get(),
        }
    }

    fn changed(&self) -> bool {
        let numbers = [&self.k_p, &self.k_o, &self.e_p_max, &self.e_o_max];
        let texts = [&self.law, &self.jacobian];
        let lists = [&self.k_v, &self.joint_k_p];
        // Every handle must be asked, or it will report its change later.
        let changed = numbers.iter().filter(|p| p.changed()).count()
            + texts.iter().filter(|p| p.changed()).count()
            + lists.iter().filter(|p| p.changed()).count();
        changed > 0
    }
}

/// Refuses gains that do not fit a robot with so many joints; with none, as long as none is known.
fn one_per_joint(values: &[f64], joints: usize) -> Result<(), String> {
    match values.len() {
        n if n == joints || joints == 0 => Ok(()),
        n => Err(format!(
            "{values:?} has {n} values; the robot has {joints} joints, so give {joints}"
        )),
    }
}

impl ControllerParams {
    /// Declares the parameters and reads them. `finish` of `declare` is the caller's.
    pub fn declare(declare: &mut Declare) -> Self {
        Self::declare_live(declare).0
    }

    fn declare_live(declare: &mut Declare) -> (Self, Live) {
        let tip_link = declare
            .param("tip_link", "tool0", "Link whose frame is the tip")
            .read_only()
            .value();
        let live = Live::declare(declare);
        let measurement_timeout = declare
            .param(
                "measurement_timeout",
                1.0,
                "Age of the camera's measurement beyond which the joints are only damped [s]",
            )
            .range(1e-3, 1e6)
            .read_only()
            .value();
        let lockstep = declare
            .param(
                "lockstep",
                false,
                "Answer a joint state only once its camera frame has come",
            )
            .read_only()
            .value();
        let config = live.get();
        (
            Self {
                tip_link,
                config,
                measurement_timeout,
                lockstep,
            },
            live,
        )
    }
}

/// The node's program.
///
/// # Errors
/// For wrong parameters, or when DDS refuses.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let (params, live) = ControllerParams::declare_live(&mut declare);
    declare.finish()?;
    let mut description = RobotDescription::new(node, params.tip_link.clone())?;
    let mut topics = Topics::new(node)?;
    let Some(robot) = description.wait(node) else {
        return Ok(());
    };
    let refuse = |e: crate::control::GainError| {
        NodeError::Input(format!("node {}: parameter {e}", node.name()))
    };
    live.fit(&robot);
    let mut controller = controller(robot, live.get()).map_err(refuse)?;
    loop {
        if let Some(robot) = description.changed() {
            live.fit(&robot);
            controller = self::controller(robot, live.get()).map_err(refuse)?;
        }
        if live.changed()
            && let Err(e) = controller.set_config(live.get())
        {
            topics
                .status
                .warn(format!("parameter {e}; the gains before stay in force"));
        }
        topics.listen();
        while let Some(joints) = topics.next_state(params.lockstep) {
            topics.answer(&mut controller, &joints, params.measurement_timeout);
        }
        if !node.wait_for(Duration::from_secs(1)) {
            return Ok(());
        }
    }
}

fn controller(
    robot: Robot,
    config: ControllerConfig,
) -> Result<Controller, crate::control::GainError> {
    Controller::new(robot.model, robot.tip, config)
}

/// A camera measurement: tip and goal in the base frame, of one exposure.
struct Seen {
    stamp: Time,
    X_BE: Pose,
    X_BD: Pose,
}

/// Endpoints of the controller node and what has come from them.
struct Topics {
    joint_states: Subscription<JointState>,
    tip_pose: Subscription<PoseStamped>,
    goal_pose: Subscription<PoseStamped>,
    commands: Publisher<JointState>,
    state: Publisher<ControllerState>,
    states: VecDeque<JointState>,
    /// Tip poses whose goal pose is on its way, and the other way round.
    tips: VecDeque<(Time, Pose)>,
    goals: VecDeque<(Time, Pose)>,
    seen: Option<Seen>,
    /// Stamp of the newest joint state.
    last_state: Time,
    status: Status,
}

/// Halves of measurements kept while the other half is on its way.
const WAITING: usize = 64;

impl Topics {
    fn new(node: &Node) -> Result<Self, NodeError> {
        let status = node.diagnostics().status("control");
        status.warn("no joint_states have arrived yet");
        Ok(Self {
            joint_states: node.subscribe("joint_states", Qos::RELIABLE)?,
            tip_pose: node.subscribe("camera/tip_pose", Qos::RELIABLE)?,
            goal_pose: node.subscribe("camera/goal_pose", Qos::RELIABLE)?,
            commands: node.advertise("joint_commands", Qos::RELIABLE)?,
            state: node.advertise("controller/state", Qos::RELIABLE)?,
            states: VecDeque::new(),
            tips: VecDeque::new(),
            goals: VecDeque::new(),
            seen: None,
            last_state: Time::ZERO,
            status,
        })
    }

    /// Takes in what has arrived.
    fn listen(&mut self) {
        while let Some(received) = self.joint_states.take() {
            let stamp = Time::from(&received.message.header.stamp);
            if stamp < self.last_state {
                // A simulation that began anew: what was seen before is of another run.
                self.states.clear();
                self.tips.clear();
                self.goals.clear();
                self.seen = None;
            }
            self.last_state = stamp;
            self.states.push_back(received.message);
        }
        collect(&self.tip_pose, &mut self.tips, &self.status);
        collect(&self.goal_pose, &mut self.goals, &self.status);
        while let (Some((tip, X_BE)), Some((goal, X_BD))) = (self.tips.front(), self.goals.front())
        {
            match tip.cmp(goal) {
                cmp::Ordering::Less => drop(self.tips.pop_front()),
                cmp::Ordering::Greater => drop(self.goals.pop_front()),
                cmp::Ordering::Equal => {
                    self.seen = Some(Seen {
                        stamp: *tip,
                        X_BE: *X_BE,
                        X_BD: *X_BD,
                    });
                    self.tips.pop_front();
                    self.goals.pop_front();
                }
            }
        }
    }

    /// The joint state to answer now: the newest, or in lockstep the oldest whose camera frame is here.
    fn next_state(&mut self, lockstep: bool) -> Option<JointState> {
        if !lockstep {
            let newest = self.states.pop_back();
            self.states.clear();
            return newest;
        }
        let stamp = Time::from(&self.states.front()?.header.stamp);
        self.seen.as_ref().filter(|seen| seen.stamp == stamp)?;
        self.states.pop_front()
    }

    fn answer(&mut self, controller: &mut Controller, joints: &JointState, timeout: f64) {
        let (q, qd) = match joint_vectors(controller, joints) {
            Ok(vectors) => vectors,
            Err(problem) => {
                self.status
                    .warn(format!("{}: {problem}", self.joint_states.topic()));
                return;
            }
        };
        let now = Time::from(&joints.header.stamp);
        let age = self.seen.as_ref().map(|seen| now - seen.stamp);
        let young = self
            .seen
            .as_ref()
            .filter(|_| age.is_some_and(|age| age.abs() <= timeout));
        let acted = controller.update(&q, &qd, young.map(|seen| (&seen.X_BE, &seen.X_BD)));
        match (&acted, age) {
            (Err(e), _) => self.status.error(format!("no effort is given: {e}")),
            (Ok(_), None) => self.status.warn("no camera measurement has come yet: only damping"),
            (Ok(_), Some(age)) if age.abs() > timeout => self.status.warn(format!(
                "the last camera measurement is {age:.2} s old (measurement_timeout is {timeout} s): only damping"
            )),
            (Ok(_), Some(_)) => self.status.ok("steering the tip to the goal"),
        }
        self.commands.publish(&command(controller, &joints.header));
        let seen_age = age.unwrap_or(f64::MAX).min(1e9);
        if let Ok(acted) = acted {
            self.state
                .publish(&report(controller, &joints.header, &acted, seen_age));
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
pub fn report(
    controller: &Controller,
    header: &Header,
    acted: &Acted,
    age: f64,
) -> ControllerState {
    let config = controller.config();
    let mut state = ControllerState {
        header: header.clone(),
        law: choice::name_of(&LawKind::NAMES, &config.law).to_owned(),
        position_saturated: acted.position_saturated,
        orientation_saturated: acted.orientation_saturated,
        k_p: config.gains.k_p,
        k_o: config.gains.k_o,
        joint_names: joint_names(controller),
        k_v: config.gains.k_v.clone(),
        effort: controller.efforts().as_slice().to_vec(),
        tip_pose_age: age,
        goal_pose_age: age,
        ..ControllerState::default()
    };
    if let Some(error) = &acted.error {
        state.position_error = vector_to_msg(&error.position);
        state.orientation_error = vector_to_msg(&error.orientation);
        state.position_error_norm = error.position.norm();
        state.attitude_error_angle = error.angle;
    }
    state
}

/// Queues the poses that have come, by stamp.
fn collect(topic: &Subscription<PoseStamped>, into: &mut VecDeque<(Time, Pose)>, status: &Status) {
    while let Some(Received { message, .. }) = topic.take() {
        match pose_from_msg(&message.pose) {
            Ok(pose) => into.push_back((Time::from(&message.header.stamp), with_matrix(&pose))),
            Err(problem) => status.warn(format!("{}: {problem}; it is ignored", topic.topic())),
        }
    }
    while into.len() > WAITING {
        into.pop_front();
    }
}

/// Positions and rates in the model's order.
fn joint_vectors(
    controller: &Controller,
    joints: &JointState,
) -> Result<(DVector<f64>, DVector<f64>), String> {
    let model = controller.model();
    let (mut q, mut qd) = (DVector::zeros(model.dof()), DVector::zeros(model.dof()));
    for (j, joint) in model.joints().iter().enumerate() {
        let at = joints.name.iter().position(|name| *name == joint.name);
        let values = at.and_then(|at| Some((joints.position.get(at)?, joints.velocity.get(at)?)));
        let Some((&position, &velocity)) = values else {
            return Err(format!(
                "has no position and velocity for joint '{}'",
                joint.name
            ));
        };
        if !(position.is_finite() && velocity.is_finite()) {
            return Err(format!(
                "joint '{}' has position {position} and velocity {velocity}; both must be finite",
                joint.name
            ));
        }
        (q[j], qd[j]) = (position, velocity);
    }
    Ok((q, qd))
}
