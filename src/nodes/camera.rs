//! The camera node: turns the truth into what a camera on the moving base measures.
//!
//! It is the only node that may know where the base is: the poses that it publishes are those of the tip
//! and of the goal object in the base frame, with the rate, latency, noise and losses of its parameters.

use std::collections::VecDeque;

use nalgebra::{DVector, Isometry3};

use super::{
    geometry::{pose_from_msg, pose_to_msg, with_matrix},
    placement::declare_pose,
    robot_description::{Robot, RobotDescription},
};
use crate::{
    dynamics::Workspace,
    msg::{geometry_msgs::PoseStamped, nav_msgs, sensor_msgs, std_msgs::Header},
    ros::{Declare, Node, NodeError, Param, Publisher, Qos, Status, Subscription, Time},
    spatial::Pose,
    vision::{PoseCamera, PoseCameraConfig, PoseFrame},
};

/// What the camera node is told at its start.
#[derive(Debug, Clone)]
pub struct CameraParams {
    /// Link whose frame is the tip.
    pub tip_link: String,
    /// Goal in the world until `goal_pose` gives another.
    pub goal: Option<Isometry3<f64>>,
    /// How good the camera is.
    pub quality: PoseCameraConfig,
    /// Image size \[px\] and focal length \[px\].
    pub image: (u32, u32, f64),
}

/// The parameters of the camera's quality, which may change while it runs.
struct Quality {
    rate: Param<f64>,
    latency: Param<f64>,
    position_noise: Param<f64>,
    attitude_noise: Param<f64>,
    dropout: Param<f64>,
    seed: Param<i64>,
}

impl Quality {
    fn declare(declare: &mut Declare) -> Self {
        let mut positive =
            |name: &str, to: f64, text: &str| declare.param(name, 0.0, text).range(0.0, to).live();
        Self {
            rate: positive(
                "rate",
                1000.0,
                "Frames per second [Hz]; 0 is a frame for every state",
            ),
            latency: positive("latency", 10.0, "Delay from exposure to publication [s]"),
            position_noise: positive(
                "position_noise",
                10.0,
                "Standard deviation of each coordinate of a measured position [m]",
            ),
            attitude_noise: positive(
                "attitude_noise",
                1.0,
                "Standard deviation of each component of a measured attitude [rad]",
            ),
            dropout: positive("dropout", 1.0, "Probability that a frame is lost"),
            seed: declare.param("seed", 1, "Seed of noise and losses").live(),
        }
    }

    fn get(&self) -> PoseCameraConfig {
        PoseCameraConfig {
            rate: self.rate.get(),
            latency: self.latency.get(),
            position_noise: self.position_noise.get(),
            attitude_noise: self.attitude_noise.get(),
            dropout: self.dropout.get(),
            seed: self.seed.get().unsigned_abs(),
        }
    }

    fn changed(&self) -> bool {
        let floats = [
            &self.rate,
            &self.latency,
            &self.position_noise,
            &self.attitude_noise,
        ];
        // Every handle must be asked, or it will report its change later.
        let changed = floats.iter().filter(|p| p.changed()).count();
        changed > 0 || self.dropout.changed() || self.seed.changed()
    }
}

impl CameraParams {
    /// Declares the parameters and reads them. `finish` of `declare` is the caller's.
    ///
    /// # Errors
    /// A line that names the parameter whose values do not fit together.
    pub fn declare(declare: &mut Declare) -> Result<Self, String> {
        Self::declare_live(declare).map(|(params, _)| params)
    }

    fn declare_live(declare: &mut Declare) -> Result<(Self, Quality), String> {
        let tip_link = declare
            .param("tip_link", "tool0", "Link whose frame is the tip")
            .read_only()
            .value();
        let goal = declare_pose(declare, "goal", "goal object", true);
        let quality = Quality::declare(declare);
        let mut pixels = |name: &str, text: &str| {
            let value = declare
                .param(name, 1024, text)
                .range(16, 65_536)
                .read_only()
                .value();
            u32::try_from(value).unwrap_or(1024)
        };
        let width = pixels("image_width", "Width of the image [px]");
        let height = pixels("image_height", "Height of the image [px]");
        let focal_length = declare
            .param("focal_length", 1024.0, "Focal length [px]")
            .range(1.0, 1e6)
            .read_only()
            .value();
        let params = Self {
            tip_link,
            goal: goal?,
            quality: quality.get(),
            image: (width, height, focal_length),
        };
        Ok((params, quality))
    }
}

/// The node's program.
///
/// # Errors
/// For wrong parameters, or when DDS refuses.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = CameraParams::declare_live(&mut declare);
    declare.finish()?;
    let (params, quality) =
        params.map_err(|e| NodeError::Input(format!("node {}: {e}", node.name())))?;
    let mut description = RobotDescription::new(node, params.tip_link.clone())?;
    let mut topics = Topics::new(node, &params)?;
    let Some(robot) = description.wait(node) else {
        return Ok(());
    };
    let mut sight = Sight::new(robot);
    let mut camera = PoseCamera::new(params.quality.clone());
    let mut goal = params.goal.as_ref().map(with_matrix);
    while node.wait() {
        if let Some(robot) = description.changed() {
            sight = Sight::new(robot);
        }
        if quality.changed() {
            camera.set_config(quality.get());
        }
        topics.take_goal(&mut goal);
        for instant in topics.instants() {
            sight.look(&mut camera, &instant, goal.as_ref());
            topics.publish(&mut camera, &instant, &sight.base);
        }
        topics.report(&camera, goal.is_some());
    }
    Ok(())
}

/// The truth at one time.
struct Instant {
    stamp: Time,
    joints: sensor_msgs::JointState,
    X_WB: Pose,
}

/// The robot as the camera sees it.
struct Sight {
    robot: Robot,
    workspace: Workspace,
    q: DVector<f64>,
    base: String,
}

impl Sight {
    fn new(robot: Robot) -> Self {
        let workspace = Workspace::new(&robot.model);
        let q = DVector::zeros(robot.model.dof());
        let base = robot.model.frames()[0].name.clone();
        Self {
            robot,
            workspace,
            q,
            base,
        }
    }

    fn look(&mut self, camera: &mut PoseCamera, instant: &Instant, X_WD: Option<&Pose>) {
        for (name, position) in instant.joints.name.iter().zip(&instant.joints.position) {
            if let Some(j) = self.robot.model.joint_index(name) {
                self.q[j] = *position;
            }
        }
        self.workspace.set_positions(&self.robot.model, &self.q);
        let X_BE = self.workspace.X_BF(&self.robot.tip);
        let X_BD = X_WD.map(|X_WD| instant.X_WB.inverse() * X_WD);
        camera.show(instant.stamp.as_secs_f64(), &X_BE, X_BD.as_ref());
    }
}

/// Endpoints of the camera node.
struct Topics {
    joint_states: Subscription<sensor_msgs::JointState>,
    odometry: Subscription<nav_msgs::Odometry>,
    goal: Subscription<PoseStamped>,
    tip_pose: Publisher<PoseStamped>,
    goal_pose: Publisher<PoseStamped>,
    _camera_info: Publisher<sensor_msgs::CameraInfo>,
    /// Halves of instants that wait for the other half.
    joints: VecDeque<sensor_msgs::JointState>,
    bases: VecDeque<nav_msgs::Odometry>,
    /// Frames of the last instant, to answer a state that is published again.
    last: Option<(Time, Vec<PoseFrame>)>,
    status: Status,
    goal_status: Status,
}

/// Halves kept while the other half is on its way.
const WAITING: usize = 64;

impl Topics {
    fn new(node: &Node, params: &CameraParams) -> Result<Self, NodeError> {
        let camera_info = node.advertise("camera/camera_info", Qos::LATCHED)?;
        camera_info.publish(&calibration(params.image));
        Ok(Self {
            joint_states: node.subscribe("joint_states", Qos::RELIABLE)?,
            odometry: node.subscribe("ground_truth/odom", Qos::RELIABLE)?,
            goal: node.subscribe("goal_pose", Qos::RELIABLE)?,
            tip_pose: node.advertise("camera/tip_pose", Qos::RELIABLE)?,
            goal_pose: node.advertise("camera/goal_pose", Qos::RELIABLE)?,
            _camera_info: camera_info,
            joints: VecDeque::new(),
            bases: VecDeque::new(),
            last: None,
            status: node.diagnostics().status("frames"),
            goal_status: node.diagnostics().status("goal"),
        })
    }

    fn take_goal(&mut self, goal: &mut Option<Pose>) {
        while let Some(received) = self.goal.take() {
            let message = received.message;
            let frame = message.header.frame_id.as_str();
            let pose = match frame {
                "world" | "" => pose_from_msg(&message.pose),
                other => Err(format!("frame_id is '{other}'; give the goal in world")),
            };
            match pose {
                Ok(pose) => *goal = Some(with_matrix(&pose)),
                Err(problem) => {
                    let problem = format!("{}: {problem}; the goal stays", self.goal.topic());
                    tracing::warn!("{problem}");
                    self.goal_status.warn(problem);
                    return;
                }
            }
            self.goal_status.ok("following goal_pose");
        }
    }

    /// Pairs of joint states and base poses with the same stamp, in order.
    fn instants(&mut self) -> Vec<Instant> {
        while let Some(received) = self.joint_states.take() {
            self.joints.push_back(received.message);
        }
        while let Some(received) = self.odometry.take() {
            self.bases.push_back(received.message);
        }
        let mut instants = Vec::new();
        while let (Some(joints), Some(base)) = (self.joints.front(), self.bases.front()) {
            let (j, b) = (&joints.header.stamp, &base.header.stamp);
            match Time::from(j).cmp(&Time::from(b)) {
                std::cmp::Ordering::Less => drop(self.joints.pop_front()),
                std::cmp::Ordering::Greater => drop(self.bases.pop_front()),
                std::cmp::Ordering::Equal => {
                    if let (Some(joints), Some(base)) =
                        (self.joints.pop_front(), self.bases.pop_front())
                    {
                        instants.extend(self.instant(joints, &base));
                    }
                }
            }
        }
        // A half whose other half was lost must not pile up.
        while self.joints.len() > WAITING {
            self.joints.pop_front();
        }
        while self.bases.len() > WAITING {
            self.bases.pop_front();
        }
        instants
    }

    fn instant(
        &self,
        joints: sensor_msgs::JointState,
        base: &nav_msgs::Odometry,
    ) -> Option<Instant> {
        match pose_from_msg(&base.pose.pose) {
            Ok(X_WB) => Some(Instant {
                stamp: (&base.header.stamp).into(),
                joints,
                X_WB: with_matrix(&X_WB),
            }),
            Err(problem) => {
                self.status
                    .error(format!("{}: {problem}", self.odometry.topic()));
                None
            }
        }
    }

    fn publish(&mut self, camera: &mut PoseCamera, instant: &Instant, base: &str) {
        let mut frames = Vec::new();
        while let Some(frame) = camera.deliver(instant.stamp.as_secs_f64()) {
            frames.push(frame);
        }
        match &self.last {
            Some((stamp, answered)) if *stamp == instant.stamp && frames.is_empty() => {
                frames.clone_from(answered);
            }
            _ => self.last = Some((instant.stamp, frames.clone())),
        }
        for frame in &frames {
            self.tip_pose.publish(&seen(frame.time, base, &frame.X_BE));
            if let Some(X_BD) = &frame.X_BD {
                self.goal_pose.publish(&seen(frame.time, base, X_BD));
            }
        }
    }

    fn report(&self, camera: &PoseCamera, has_goal: bool) {
        self.status.set("frames lost", camera.lost());
        if !has_goal {
            self.goal_status
                .warn("there is no goal: give goal.position or publish goal_pose");
        }
    }
}

/// A pose in the base frame that was seen at `time` \[s\].
pub fn seen(time: f64, base: &str, X: &Pose) -> PoseStamped {
    let stamp = Time::from_secs_f64(time).into();
    PoseStamped {
        header: Header {
            stamp,
            frame_id: base.to_owned(),
        },
        pose: pose_to_msg(X),
    }
}

fn calibration((width, height, focal_length): (u32, u32, f64)) -> sensor_msgs::CameraInfo {
    // Pixel centres are at integers, so the middle of the image is at half the size less a half.
    let (cx, cy) = (0.5 * f64::from(width) - 0.5, 0.5 * f64::from(height) - 0.5);
    let f = focal_length;
    sensor_msgs::CameraInfo {
        header: Header {
            frame_id: "camera_optical_frame".to_owned(),
            ..Header::default()
        },
        height,
        width,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: [f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..sensor_msgs::CameraInfo::default()
    }
}
