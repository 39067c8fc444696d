//! The estimator node: feature tracks of a tumbling target in, its motion and its future out.
//!
//! It sees what the camera sees and what the base's gyro measures, nothing else. Batch solutions over a window
//! of frames run on a thread of their own; every frame in between is answered with the last of them.

mod camera_attitude;
mod messages;
mod params;
mod solver;

pub use camera_attitude::StaticRotations;
pub use messages::Moment;
pub use params::EstimatorParams;

use std::time::Duration;

use super::{
    features::{pinhole_from_msg, sighting_from_msg},
    topics,
};
use crate::{
    estimation::{Estimated, Tracks, bundle},
    msg::{fuyu_msgs, geometry_msgs, nav_msgs, sensor_msgs, tf2_msgs},
    ros::{Node, NodeError, Publisher, Status, Subscription},
    vision::{Pinhole, Sighting},
};
use camera_attitude::CameraAttitude;
use solver::{Job, Solved, Solver};

/// How long the node waits for something to arrive before it looks after the solver.
const PATIENCE: Duration = Duration::from_millis(50);

/// Silence of the features that is worth a warning.
const SILENCE: Duration = Duration::from_secs(2);

/// The node's program.
///
/// # Errors
/// For wrong parameters, or when DDS refuses.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = EstimatorParams::declare(&mut declare);
    declare.finish()?;
    let params = params.map_err(|e| NodeError::Input(format!("node {}: {e}", node.name())))?;
    let mut topics = Topics::new(node)?;
    let mut estimator = Estimator::new(params, node);
    while node.wait_for(PATIENCE) {
        estimator.listen(&topics);
        while let Some(sighting) = topics.next_sighting(&mut estimator) {
            estimator.see(sighting, &topics);
        }
        estimator.solve();
        estimator.take_solution(&topics);
        topics.notice_silence(&estimator);
    }
    Ok(())
}

/// Endpoints of the estimator node.
struct Topics {
    features: Subscription<fuyu_msgs::FeatureTracks>,
    camera_info: Subscription<sensor_msgs::CameraInfo>,
    imu: Subscription<sensor_msgs::Imu>,
    tf_static: Subscription<tf2_msgs::TFMessage>,
    angular_velocity: Publisher<geometry_msgs::Vector3Stamped>,
    motion: Publisher<fuyu_msgs::MotionEstimate>,
    prediction: Publisher<nav_msgs::Path>,
    status: Status,
}

impl Topics {
    fn new(node: &Node) -> Result<Self, NodeError> {
        let features = topics::FEATURES.subscribe(node)?;
        let status = node.diagnostics().status("features");
        status.warn(format!("nothing has arrived on {} yet", features.topic()));
        Ok(Self {
            features,
            camera_info: topics::CAMERA_INFO.subscribe(node)?,
            imu: topics::IMU.subscribe(node)?,
            tf_static: topics::TF_STATIC.subscribe(node)?,
            angular_velocity: topics::TARGET_RATE.advertise(node)?,
            motion: topics::TARGET_MOTION.advertise(node)?,
            prediction: topics::PREDICTION.advertise(node)?,
            status,
        })
    }

    /// The next sound frame that waits; one that is not is reported.
    fn next_sighting(&mut self, estimator: &mut Estimator) -> Option<Sighting> {
        while let Some(received) = self.features.take() {
            match sighting_from_msg(&received.message) {
                Ok(sighting) => {
                    estimator.camera_frame = received.message.header.frame_id;
                    self.status.ok("frames arrive");
                    self.status
                        .set("features in sight", sighting.features.len());
                    return Some(sighting);
                }
                Err(problem) => {
                    let topic = self.features.topic();
                    self.status
                        .warn(format!("{topic}: {problem}; the frame is ignored"));
                }
            }
        }
        None
    }

    fn notice_silence(&self, estimator: &Estimator) {
        if let Some(age) = self.features.age().filter(|age| *age > SILENCE)
            && !estimator.tracks.sightings().is_empty()
        {
            let (topic, seconds) = (self.features.topic(), age.as_secs_f64());
            self.status
                .warn(format!("{topic} has been silent for {seconds:.0} s"));
        }
    }
}

/// What has been seen, and what follows from it.
struct Estimator {
    params: EstimatorParams,
    camera: Option<Pinhole>,
    camera_frame: String,
    attitude: CameraAttitude,
    tracks: Tracks,
    solver: Solver,
    /// Time of the newest frame when the last job was given \[s\].
    solved_at: Option<f64>,
    estimated: Option<Estimated>,
    camera_status: Status,
    motion_status: Status,
}

impl Estimator {
    fn new(params: EstimatorParams, node: &Node) -> Self {
        let motion_status = node.diagnostics().status("motion");
        motion_status.warn("not estimated yet: no frames");
        Self {
            camera: params.camera,
            camera_frame: super::camera::CAMERA_FRAME.to_owned(),
            attitude: CameraAttitude::default(),
            tracks: Tracks::default(),
            solver: Solver::start(),
            solved_at: None,
            estimated: None,
            camera_status: node.diagnostics().status("camera"),
            motion_status,
            params,
        }
    }

    /// Takes in what is known of the camera.
    fn listen(&mut self, topics: &Topics) {
        let beginnings = self.attitude.beginnings();
        if let Some(received) = topics.camera_info.latest()
            && self.params.camera.is_none()
        {
            match pinhole_from_msg(&received.message) {
                Ok(camera) => self.camera = Some(camera),
                Err(problem) => {
                    let topic = topics.camera_info.topic();
                    self.camera_status.error(format!("{topic}: {problem}"));
                }
            }
        }
        while let Some(received) = topics.tf_static.take() {
            if let Err(problem) = self.attitude.take_frames(received.message) {
                let topic = topics.tf_static.topic();
                self.camera_status.warn(format!("{topic}: {problem}"));
            }
        }
        while let Some(received) = topics.imu.take() {
            if !self.params.use_imu {
                continue;
            }
            let taken = self
                .attitude
                .take_imu(&received.message, &self.camera_frame);
            if let Err(problem) = taken {
                let topic = topics.imu.topic();
                self.camera_status.warn(format!("{topic}: {problem}"));
            }
        }
        if self.attitude.beginnings() != beginnings {
            self.forget_solutions("the gyro has just begun, or had a gap");
        }
        match (&self.camera, self.attitude.known_since()) {
            (None, _) => self.camera_status.warn(format!(
                "{} has not arrived, and camera.fx is not given",
                topics.camera_info.topic()
            )),
            (Some(_), Some(_)) => self
                .camera_status
                .ok("calibrated; its rotation is known from the gyro"),
            (Some(_), None) if self.params.use_imu => self.camera_status.ok(format!(
                "calibrated; taken not to turn, for nothing has arrived on {}",
                topics.imu.topic()
            )),
            (Some(_), None) => self.camera_status.ok("calibrated; taken not to turn"),
        }
    }

    /// Takes in a frame and answers it.
    fn see(&mut self, sighting: Sighting, topics: &Topics) {
        let time = sighting.time;
        match self.tracks.span() {
            Some((_, last)) if time == last => return,
            Some((_, last)) if time < last => {
                tracing::info!("time went back from {last:.3} s to {time:.3} s: starting anew");
                self.restart();
            }
            _ => {}
        }
        if let Err(e) = self.tracks.push(sighting) {
            // What is left to be wrong is a time that is not finite.
            topics.status.warn(format!("{e}; the frame is ignored"));
            return;
        }
        let oldest = time - self.params.window;
        self.tracks.forget_before(oldest);
        self.attitude.forget_before(oldest);
        if let Some(since) = self.attitude.known_since() {
            // How the camera turned before that is not known.
            self.tracks.forget_before(since.min(time));
        }
        if let Some(moment) = self.moment(time) {
            topics.angular_velocity.publish(&moment.angular_velocity());
        }
    }

    fn restart(&mut self) {
        self.tracks = Tracks::default();
        self.attitude.clear();
        self.forget_solutions("time went back");
    }

    /// Gives up what was found, and whatever is still being solved.
    fn forget_solutions(&mut self, why: &str) {
        self.estimated = None;
        self.solved_at = None;
        self.solver = Solver::start();
        self.motion_status.warn(format!("not estimated yet: {why}"));
    }

    fn moment(&self, time: f64) -> Option<Moment<'_>> {
        Some(Moment {
            estimated: self.estimated.as_ref()?,
            time,
            camera: &self.camera_frame,
            R_IC: self.attitude.R_GC(time),
        })
    }

    /// Gives the solver the frames of the window, if it is idle and new ones have come.
    fn solve(&mut self) {
        let (Some(camera), Some((_, newest))) = (self.camera, self.tracks.span()) else {
            return;
        };
        let due = self
            .solved_at
            .is_none_or(|at| newest >= at + self.params.solve_period);
        if self.solver.is_busy() || !due {
            return;
        }
        self.solved_at = Some(newest);
        self.solver.give(Job {
            method: self.params.method,
            tracks: self.tracks.clone(),
            camera,
            options: bundle::Options {
                pixel_noise: self.params.pixel_noise,
                estimate_focal_length: self.params.estimate_focal_length,
                camera_motion: self.attitude.motion(),
                ..bundle::Options::default()
            },
        });
    }

    /// Publishes a solution that has come.
    fn take_solution(&mut self, topics: &Topics) {
        let solved = match self.solver.take() {
            Ok(None) => return,
            Ok(Some(solved)) => solved,
            Err(problem) => {
                self.motion_status.error(problem);
                return;
            }
        };
        let Solved { job, result } = solved;
        let estimated = match result {
            Ok(estimated) => estimated,
            Err(e) => {
                let before = match self.estimated {
                    Some(_) => "the motion before stays",
                    None => "not estimated yet",
                };
                self.motion_status.warn(format!("{before}: {e}"));
                return;
            }
        };
        let motion = &estimated.motion;
        let model = motion.model().name();
        match estimated.diagnosis.as_slice() {
            [] => self.motion_status.ok(model),
            notes => self
                .motion_status
                .warn(format!("{model}: {}", notes.join("; "))),
        }
        self.motion_status.set("model", model);
        self.motion_status
            .set("residual", format!("{:.3}", motion.rms()));
        let sightings = job.tracks.sightings();
        self.motion_status.set("frames", sightings.len());
        let (first, last) = job.tracks.span().unwrap_or_default();
        self.estimated = Some(estimated);
        if let Some(moment) = self.moment(last) {
            topics
                .motion
                .publish(&moment.motion(sightings.len(), last - first));
            let (horizon, rate) = (self.params.horizon, self.params.prediction_rate);
            topics.prediction.publish(&moment.prediction(horizon, rate));
        }
    }
}
