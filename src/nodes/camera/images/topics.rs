//! The camera node's endpoints for images.

use std::collections::VecDeque;

use super::{
    Body, BodyState, ImageParams, ImageScene, Imager, LiveImageSettings, Shape, Shot,
    thread::ImageThread,
};
use crate::{
    model::Model,
    msg::{nav_msgs::Odometry, sensor_msgs::JointState, std_msgs},
    nodes::topics,
    ros::{Node, NodeError, Status, Subscription, Time},
    vision::{DueExposure, FrameStream},
};

/// Number of states that are kept until the states of all bodies have arrived.
const KEPT: usize = 64;

/// Renders the cameras' images in a separate thread whenever an exposure is due.
pub struct ImageTopics {
    params: ImageParams,
    thread: ImageThread,
    targets: Vec<TargetSource>,
    robot: VecDeque<(Time, (JointState, Odometry))>,
    image_scene: Option<ImageScene>,
    /// The robot description from which the scene is built.
    description: String,
    /// Exposed frames whose latency has not passed; their images are in the thread.
    stream: FrameStream<()>,
    status: Status,
    skipped: u64,
    /// Meshes that cannot be drawn, one line each.
    problems: Vec<String>,
}

/// Subscriptions for a target that is drawn.
struct TargetSource {
    name: String,
    description: Subscription<std_msgs::String>,
    odometry: Subscription<Odometry>,
    joints: Subscription<JointState>,
    /// Its model and shape, once its description has arrived.
    known: Option<(Model, Shape)>,
    poses: VecDeque<(Time, Odometry)>,
    positions: VecDeque<(Time, JointState)>,
}

impl TargetSource {
    fn new(node: &Node, name: &str) -> Result<Self, NodeError> {
        Ok(Self {
            name: name.to_owned(),
            description: topics::TARGET_DESCRIPTION.subscribe(node, name)?,
            odometry: topics::TARGET_ODOMETRY.subscribe(node, name)?,
            joints: topics::TARGET_JOINT_STATES.subscribe(node, name)?,
            known: None,
            poses: VecDeque::new(),
            positions: VecDeque::new(),
        })
    }

    fn has_joints(&self) -> bool {
        (self.known.as_ref()).is_some_and(|(model, _)| model.dof() > 0)
    }

    /// Takes received messages. Returns whether the description has changed.
    fn receive(&mut self, status: &Status) -> bool {
        while let Some(received) = self.odometry.take() {
            let stamp = Time::from(&received.message.header.stamp);
            keep(&mut self.poses, stamp, received.message);
        }
        while let Some(received) = self.joints.take() {
            let stamp = Time::from(&received.message.header.stamp);
            keep(&mut self.positions, stamp, received.message);
        }
        let Some(received) = self.description.latest() else {
            return false;
        };
        let (xml, source) = (received.message.data, self.description.topic());
        match Model::repaired_from_urdf(&xml, source) {
            Ok(repaired) => {
                let shape = Shape::of_urdf(&xml, source);
                log_shape(&shape);
                self.known = Some((repaired.model, shape));
                true
            }
            Err(problem) => {
                status.error(problem.to_string());
                false
            }
        }
    }

    /// The messages with this stamp; `None` if they were lost, `Err` while they may still arrive.
    fn at(&mut self, stamp: Time) -> Result<Option<(Odometry, Option<JointState>)>, ()> {
        let pose = take_at(&mut self.poses, stamp)?;
        if !self.has_joints() {
            return Ok(pose.map(|pose| (pose, None)));
        }
        let joints = match take_at(&mut self.positions, stamp) {
            Ok(joints) => joints,
            Err(()) => {
                // The pose is needed again when the joint states have arrived.
                if let Some(pose) = pose {
                    self.poses.push_front((stamp, pose));
                }
                return Err(());
            }
        };
        Ok(pose.zip(joints).map(|(pose, joints)| (pose, Some(joints))))
    }
}

/// Adds a sample. If time has jumped back, samples of the previous run are dropped.
fn keep<T>(queue: &mut VecDeque<(Time, T)>, stamp: Time, sample: T) {
    if queue.back().is_some_and(|(last, _)| *last > stamp) {
        queue.clear();
    }
    if queue.len() >= KEPT {
        queue.pop_front();
    }
    queue.push_back((stamp, sample));
}

/// Removes the samples up to this stamp and returns the one with this stamp. `Err` if no sample of this time or later
/// has arrived.
fn take_at<T>(queue: &mut VecDeque<(Time, T)>, stamp: Time) -> Result<Option<T>, ()> {
    while let Some((first, _)) = queue.front() {
        if *first > stamp {
            return Ok(None);
        }
        let is_it = *first == stamp;
        let found = queue.pop_front();
        if is_it {
            return Ok(found.map(|(_, sample)| sample));
        }
    }
    Err(())
}

fn log_shape(shape: &Shape) {
    for note in &shape.notes {
        tracing::info!("{note}");
    }
    for problem in &shape.problems {
        tracing::error!("{problem}; it is not drawn");
    }
}

impl ImageTopics {
    /// Advertises the images, and subscribes to the targets that are drawn.
    ///
    /// # Errors
    /// For invalid cameras, or when the node cannot publish or subscribe.
    pub fn new(node: &Node, params: &ImageParams) -> Result<Self, NodeError> {
        let at = |e: String| NodeError::Input(format!("node {}: {e}", node.name()));
        let imager = Imager::new(params).map_err(at)?;
        let outputs = Imager::outputs(params);
        let status = node.diagnostics().status("images");
        status.warn("no image has been rendered yet");
        let targets = params.bodies.iter();
        let targets = targets.map(|name| TargetSource::new(node, name));
        Ok(Self {
            targets: targets.collect::<Result<_, _>>()?,
            thread: ImageThread::start(node, imager, &outputs)?,
            robot: VecDeque::new(),
            image_scene: None,
            description: String::new(),
            stream: FrameStream::new(params.settings.stream),
            status,
            skipped: 0,
            problems: Vec::new(),
            params: params.clone(),
        })
    }

    /// Sets a new description of the robot; the scene will be rebuilt.
    pub fn set_robot(&mut self, description: &str) {
        self.description = description.to_owned();
        self.image_scene = None;
    }

    /// Updates rate, exposure, noise and lights if their parameters have changed.
    pub fn update(&mut self, live: &LiveImageSettings) {
        if !live.changed() {
            return;
        }
        self.params.settings = live.get();
        self.stream.set_config(self.params.settings.stream);
        if let Some(image_scene) = &mut self.image_scene {
            image_scene.set_settings(self.params.settings.clone());
        }
    }

    /// Adds a state of the robot.
    pub fn add_state(&mut self, stamp: Time, joints: &JointState, base: &Odometry) {
        keep(&mut self.robot, stamp, (joints.clone(), base.clone()));
    }

    /// Renders due exposures, and publishes images after their latency.
    pub fn work(&mut self) {
        let mut changed = false;
        for target in &mut self.targets {
            changed |= target.receive(&self.status);
        }
        if changed || (self.image_scene.is_none() && !self.description.is_empty()) {
            self.build_stage();
        }
        while let Some((stamp, _)) = self.robot.front() {
            let stamp = *stamp;
            let mut of_targets = Vec::new();
            for target in &mut self.targets {
                match target.at(stamp) {
                    Ok(found) => of_targets.push(found),
                    Err(()) => {
                        self.wait_for_targets(stamp, of_targets);
                        self.report();
                        return;
                    }
                }
            }
            let Some((_, (joints, base))) = self.robot.pop_front() else {
                break;
            };
            let of_targets: Option<Vec<_>> = of_targets.into_iter().collect();
            if let Some(of_targets) = of_targets {
                self.see(stamp.as_secs_f64(), &joints, &base, &of_targets);
            }
        }
        self.report();
    }

    /// Puts back the messages of targets for a stamp for which another target's messages are still missing.
    fn wait_for_targets(
        &mut self,
        stamp: Time,
        found: Vec<Option<(Odometry, Option<JointState>)>>,
    ) {
        for (target, found) in self.targets.iter_mut().zip(found) {
            let Some((pose, joints)) = found else {
                continue;
            };
            target.poses.push_front((stamp, pose));
            if let Some(joints) = joints {
                target.positions.push_front((stamp, joints));
            }
        }
    }

    /// Processes the states of all bodies at `time` \[s\]: exposes if an exposure is due, and publishes images that are
    /// due.
    fn see(
        &mut self,
        time: f64,
        joints: &JointState,
        base: &Odometry,
        of_targets: &[(Odometry, Option<JointState>)],
    ) {
        if let Some(exposure) = self.stream.expose(time) {
            match self.shot(time, joints, base, of_targets, exposure) {
                Ok(Some(shot)) => {
                    self.thread.render(shot);
                    self.stream.push(time, (), exposure);
                }
                Ok(None) => {}
                Err(problem) => self.status.warn(problem),
            }
        }
        while self.stream.deliver(time).is_some() {
            self.thread.publish();
        }
    }

    fn shot(
        &mut self,
        time: f64,
        joints: &JointState,
        base: &Odometry,
        of_targets: &[(Odometry, Option<JointState>)],
        exposure: DueExposure,
    ) -> Result<Option<Shot>, String> {
        if exposure.first_of_run {
            // Needed without a scene, too: the stream has discarded its waiting frames.
            self.thread.clear();
        }
        let Some(image_scene) = &mut self.image_scene else {
            return Ok(None);
        };
        if exposure.first_of_run {
            image_scene.restart();
        }
        if exposure.lost {
            self.stream.push(time, (), exposure);
            return Ok(None);
        }
        if !self.thread.is_free() {
            self.skipped += 1;
            return Ok(None);
        }
        let bodies = image_scene.bodies();
        let mut states: Vec<BodyState> = vec![bodies[0].state(Some(joints), base)?];
        for (body, (pose, joints)) in bodies[1..].iter().zip(of_targets) {
            states.push(body.state(joints.as_ref(), pose)?);
        }
        Ok(Some(image_scene.shot(time, &states)))
    }

    fn build_stage(&mut self) {
        self.image_scene = None;
        let mut targets = Vec::new();
        for target in &self.targets {
            let Some((model, shape)) = &target.known else {
                self.status
                    .warn(format!("no description of {} has arrived yet", target.name));
                return;
            };
            targets.push(Body::new(model.clone(), shape));
        }
        let source = topics::ROBOT_DESCRIPTION.name;
        let model = match Model::repaired_from_urdf(&self.description, source) {
            Ok(repaired) => repaired.model,
            Err(problem) => return self.status.error(problem.to_string()),
        };
        let shape = Shape::of_urdf(&self.description, source);
        log_shape(&shape);
        self.problems.clone_from(&shape.problems);
        for (_, shape) in self
            .targets
            .iter()
            .filter_map(|target| target.known.as_ref())
        {
            self.problems.extend_from_slice(&shape.problems);
        }
        match ImageScene::new(&self.params, Body::new(model, &shape), targets) {
            Ok(image_scene) => self.image_scene = Some(image_scene),
            Err(problem) => {
                tracing::error!("{problem}");
                self.status.error(problem);
                // Do not retry until another description arrives.
                self.description.clear();
            }
        }
    }

    fn report(&mut self) {
        loop {
            match self.thread.report() {
                Ok(Some(rendered)) => {
                    let milliseconds = rendered.duration * 1e3;
                    self.status
                        .set("time per image [ms]", format!("{milliseconds:.1}"));
                    match (self.problems.first(), rendered.enclosed.first()) {
                        (Some(problem), _) => {
                            self.status.error(format!("{problem}; it is not drawn"));
                        }
                        (None, Some(line)) => self.status.warn(line.clone()),
                        (None, None) => self.status.ok("rendering"),
                    }
                }
                Ok(None) => break,
                Err(problem) => {
                    self.status.error(problem);
                    break;
                }
            }
        }
        self.status.set("images lost", self.stream.lost());
        self.status
            .set("images skipped, renderer busy", self.skipped);
    }
}
