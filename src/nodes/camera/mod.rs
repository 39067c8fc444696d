//! The camera node: simulates measurements of a camera on the moving base from the true state of the simulation.
//!
//! The node reads ground truth, so that controller and estimator need none. It publishes the poses of tip and goal in
//! the base frame, and the feature points of a target in the image, with the rate, latency, noise and losses set by its
//! parameters. On request it renders images ([`images`]).

mod feature_params;
pub mod images;
mod params;
mod second_arm;
mod target;
mod target_camera;

pub use feature_params::{FeatureParams, pinhole};
pub use params::CameraParams;
pub use second_arm::second_camera;
pub use target_camera::{CAMERA_FRAME, TargetCamera, camera_frame};

use std::time::Duration;

use super::{
    geometry::{pose_from_msg, pose_to_msg, with_matrix},
    joint_vectors,
    robot_description::{Robot, RobotDescription},
    topics,
};
use crate::{
    control::StampPairs,
    dynamics::Workspace,
    msg::{geometry_msgs::PoseStamped, nav_msgs, sensor_msgs, std_msgs::Header},
    ros::{Node, NodeError, Publisher, Status, Subscription, Time, publish_together},
    spatial::Pose,
    vision::{Pinhole, PoseCamera, PoseFrame},
};
use images::ImageTopics;
use second_arm::SecondArm;
use target::TargetTopics;

/// Silence of `joint_states` after which a warning is reported.
const SILENCE: Duration = Duration::from_secs(1);

/// The node's program.
///
/// # Errors
/// For invalid parameters, or when DDS reports an error.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = CameraParams::declare_live(&mut declare);
    declare.finish()?;
    let (params, live) =
        params.map_err(|e| NodeError::Input(format!("node {}: {e}", node.name())))?;
    let mut description = RobotDescription::new(node, params.tip_link.clone())?;
    let mut topics = Topics::new(node, &params)?;
    let Some(robot) = description.wait(node) else {
        return Ok(());
    };
    let mut kinematics = Kinematics::new(robot);
    let mut images = match &params.images {
        None => None,
        Some(images) => {
            let mut topics = ImageTopics::new(node, images)?;
            topics.set_robot(description.text());
            Some(topics)
        }
    };
    let lens = params.lens();
    let mut tracked = match &params.features {
        None => None,
        Some(features) => {
            let camera = TargetCamera::new(features).with_lens(lens);
            let topics = TargetTopics::new(node, &camera)?;
            Some((camera, topics))
        }
    };
    let mut camera = PoseCamera::new(params.quality.clone());
    let mut second = SecondArm::new(node, &params)?;
    let mut goal = params.goal.as_ref().map(with_matrix);
    while node.wait_for(SILENCE) {
        if let Some(robot) = description.changed() {
            kinematics = Kinematics::new(robot);
            if let Some(images) = &mut images {
                images.set_robot(description.text());
            }
        }
        if live.quality.changed() {
            camera.set_config(live.quality.get());
            second.set_config(live.quality.get());
        }
        topics.take_goal(&mut goal);
        while let Some((stamp, joints, base, X_WT)) = topics.next_state() {
            if let Some(images) = &mut images {
                images.add_state(stamp, &joints, &base);
            }
            // A goal on a target moves with the target.
            let X_WD = goal.map(|X_TD| X_WT * X_TD);
            match kinematics.show(&mut camera, stamp, &joints, &base, X_WD.as_ref()) {
                Ok(X_WB) => {
                    topics.publish(&mut camera, stamp, &kinematics.base);
                    second.measure(&kinematics, stamp, &X_WB, &topics.status);
                    if let Some((_, target)) = &mut tracked {
                        target.camera_at(stamp, kinematics.X_WC(&X_WB));
                    }
                }
                Err(problem) => topics.status.warn(problem),
            }
        }
        if let Some((target_camera, target)) = &mut tracked {
            if live.tracking.changed() {
                target_camera.set_config(live.tracking.get(params.image));
            }
            target.track(target_camera);
        }
        if let Some(images) = &mut images {
            images.update(&live.images);
            images.work();
        }
        topics.report(&camera, goal.is_some());
    }
    Ok(())
}

/// The robot with its joint positions at the last state.
struct Kinematics {
    robot: Robot,
    workspace: Workspace,
    base: String,
}

impl Kinematics {
    fn new(robot: Robot) -> Self {
        let workspace = Workspace::new(&robot.model);
        let base = robot.model.frames()[0].name.clone();
        Self {
            robot,
            workspace,
            base,
        }
    }

    /// Exposes the camera to the true poses of one state. Returns the base's pose. Invalid messages are refused.
    fn show(
        &mut self,
        camera: &mut PoseCamera,
        stamp: Time,
        joints: &sensor_msgs::JointState,
        base: &nav_msgs::Odometry,
        X_WD: Option<&Pose>,
    ) -> Result<Pose, String> {
        let q = joint_vectors::positions(&self.robot.model, joints)
            .map_err(|e| format!("joint_states: {e}"))?;
        let X_WB = pose_from_msg(&base.pose.pose).map_err(|e| format!("ground_truth/odom: {e}"))?;
        self.workspace.set_positions(&q);
        let X_BE = self.workspace.X_BF(&self.robot.tip);
        let X_WB = with_matrix(&X_WB);
        let X_BD = X_WD.map(|X_WD| X_WB.inverse() * X_WD);
        camera.show(stamp.as_secs_f64(), &X_BE, X_BD.as_ref());
        Ok(X_WB)
    }

    /// Pose of the camera in the world at the last state.
    fn X_WC(&self, X_WB: &Pose) -> Result<Pose, String> {
        let camera = camera_frame(&self.robot.model)?;
        Ok(X_WB * self.workspace.X_BF(camera))
    }
}

/// Endpoints of the camera node.
struct Topics {
    joint_states: Subscription<sensor_msgs::JointState>,
    odometry: Subscription<nav_msgs::Odometry>,
    goal: Subscription<PoseStamped>,
    /// Name of the frame in which the goal is given.
    goal_frame: String,
    /// Odometry of the target on which the goal is.
    carrier: Option<Subscription<nav_msgs::Odometry>>,
    tip_pose: Publisher<PoseStamped>,
    goal_pose: Publisher<PoseStamped>,
    /// Calibration of the camera that sees the features; `None` if its images are rendered, since they come with a
    /// calibration.
    _camera_info: Option<Publisher<sensor_msgs::CameraInfo>>,
    truth: StampPairs<Time, sensor_msgs::JointState, nav_msgs::Odometry>,
    /// States paired with the pose of the target on which the goal is.
    carried: StampPairs<Time, (sensor_msgs::JointState, nav_msgs::Odometry), Pose>,
    /// Frames of the last state, published again if the state is repeated.
    last: Option<(Time, Vec<PoseFrame>)>,
    status: Status,
    goal_status: Status,
}

impl Topics {
    fn new(node: &Node, params: &CameraParams) -> Result<Self, NodeError> {
        let is_rendered =
            (params.images.as_ref()).is_some_and(|images| images.main_lens().is_some());
        let camera_info = match is_rendered {
            true => None,
            false => {
                let camera_info = topics::CAMERA_INFO.advertise(node)?;
                camera_info.publish(&calibration(params.image));
                Some(camera_info)
            }
        };
        let status = node.diagnostics().status("frames");
        status.warn("no state of the robot has arrived yet");
        Ok(Self {
            joint_states: topics::JOINT_STATES.subscribe(node)?,
            odometry: topics::ODOMETRY.subscribe(node)?,
            goal: topics::GOAL.subscribe(node)?,
            goal_frame: (params.goal_target.clone()).unwrap_or_else(|| params::WORLD.to_owned()),
            carrier: (params.goal_target.as_ref())
                .map(|body| topics::TARGET_ODOMETRY.subscribe(node, body))
                .transpose()?,
            tip_pose: topics::TIP_POSE.advertise(node)?,
            goal_pose: topics::MEASURED_GOAL.advertise(node)?,
            _camera_info: camera_info,
            truth: StampPairs::default(),
            carried: StampPairs::default(),
            last: None,
            status,
            goal_status: node.diagnostics().status("goal"),
        })
    }

    fn take_goal(&mut self, goal: &mut Option<Pose>) {
        while let Some(received) = self.goal.take() {
            let message = received.message;
            let pose = match message.header.frame_id.as_str() {
                frame if frame.is_empty() || frame == self.goal_frame => {
                    pose_from_msg(&message.pose)
                }
                other => Err(format!(
                    "frame_id is '{other}'; give the goal in {}",
                    self.goal_frame
                )),
            };
            match pose {
                Ok(pose) => {
                    *goal = Some(with_matrix(&pose));
                    self.goal_status.ok("following goal_pose");
                }
                Err(problem) => {
                    let problem = format!(
                        "{}: {problem}; the previous goal is kept",
                        self.goal.topic()
                    );
                    tracing::warn!("{problem}");
                    self.goal_status.warn(problem);
                }
            }
        }
    }

    /// The next state with joint states and base pose, and the pose of the goal's frame in the world.
    fn next_state(&mut self) -> Option<(Time, sensor_msgs::JointState, nav_msgs::Odometry, Pose)> {
        while let Some(received) = self.joint_states.take() {
            let stamp = Time::from(&received.message.header.stamp);
            self.truth.push_first(stamp, received.message);
        }
        while let Some(received) = self.odometry.take() {
            let stamp = Time::from(&received.message.header.stamp);
            self.truth.push_second(stamp, received.message);
        }
        let Some(carrier) = &self.carrier else {
            let (stamp, joints, base) = self.truth.pop()?;
            return Some((stamp, joints, base, Pose::identity()));
        };
        while let Some(received) = carrier.take() {
            let stamp = Time::from(&received.message.header.stamp);
            match pose_from_msg(&received.message.pose.pose) {
                Ok(X_WT) => self.carried.push_second(stamp, with_matrix(&X_WT)),
                Err(e) => self.status.warn(format!("{}: {e}", carrier.topic())),
            }
        }
        while let Some((stamp, joints, base)) = self.truth.pop() {
            self.carried.push_first(stamp, (joints, base));
        }
        let (stamp, (joints, base), X_WT) = self.carried.pop()?;
        Some((stamp, joints, base, X_WT))
    }

    fn publish(&mut self, camera: &mut PoseCamera, stamp: Time, base: &str) {
        let mut frames = Vec::new();
        while let Some(frame) = camera.deliver(stamp.as_secs_f64()) {
            frames.push(frame);
        }
        match &self.last {
            Some((last, answered)) if *last == stamp && frames.is_empty() => {
                frames.clone_from(answered);
            }
            _ => self.last = Some((stamp, frames.clone())),
        }
        publish_together(|| {
            for frame in &frames {
                self.tip_pose
                    .publish(&pose_message(frame.time, base, &frame.X_BE));
                if let Some(X_BD) = &frame.X_BD {
                    self.goal_pose
                        .publish(&pose_message(frame.time, base, X_BD));
                }
            }
        });
        self.status.ok("measuring the tip");
    }

    fn report(&self, camera: &PoseCamera, has_goal: bool) {
        self.status.set("frames lost", camera.lost());
        if let Some(age) = self.joint_states.age().filter(|age| *age > SILENCE) {
            let seconds = age.as_secs_f64();
            let topic = self.joint_states.topic();
            self.status
                .warn(format!("{topic} has been silent for {seconds:.0} s"));
        }
        if !has_goal {
            self.goal_status
                .warn("there is no goal: give goal.position or publish goal_pose");
        }
    }
}

/// A pose in the base frame, measured at `time` \[s\], as a message.
pub fn pose_message(time: f64, base: &str, X: &Pose) -> PoseStamped {
    let stamp = Time::from_secs_f64(time).into();
    PoseStamped {
        header: Header {
            stamp,
            frame_id: base.to_owned(),
        },
        pose: pose_to_msg(X),
    }
}

/// The calibration for an image of (width, height, focal length) pixels.
pub fn calibration(image: (u32, u32, f64)) -> sensor_msgs::CameraInfo {
    let (width, height, f) = image;
    let Pinhole { cx, cy, .. } = pinhole(image);
    sensor_msgs::CameraInfo {
        header: Header {
            frame_id: CAMERA_FRAME.to_owned(),
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
