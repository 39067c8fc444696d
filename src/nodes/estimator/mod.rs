//! The estimator node: estimates the motion of a tumbling target from feature tracks, and predicts its attitude.
//!
//! Inputs are the camera's features and calibration, the base's gyro, the mounting of both sensors (`/tf_static`), and
//! point clouds, which give the scale of lengths. Batch solutions over a window of frames are computed in a separate
//! thread; between them, a [`MotionTracker`](crate::estimation::MotionTracker) updates the solution with every frame.

mod batch_schedule;
mod camera_attitude;
mod frame_queue;
mod health;
mod messages;
mod monotonic;
mod observer;
mod params;
mod ranges;
mod solver;

pub use camera_attitude::{CameraAttitude, StaticRotations, variance_of};
pub use messages::Snapshot;
pub use params::EstimatorParams;
pub(crate) use ranges::Ranges;

use std::time::{Duration, Instant};

use super::{features::feature_frame_from_msg, topics};
use crate::{
    msg::{fuyu_msgs, geometry_msgs, nav_msgs, sensor_msgs, tf2_msgs},
    ros::{Node, NodeError, Publisher, Status, Subscription},
    vision::FeatureFrame,
};
use observer::Observer;

/// Longest wait for a message before the node checks the solver again.
const PATIENCE: Duration = Duration::from_millis(50);

/// Queue length for frames and gyro samples, which accumulate when a recording is played fast. If a gyro sample is
/// lost, a part of the camera's rotation is unknown.
const QUEUE: usize = 1000;

/// Time without features after which the node warns.
const SILENCE: Duration = Duration::from_secs(2);

/// The node's program.
///
/// # Errors
/// For invalid parameters, or when DDS reports an error.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = EstimatorParams::declare(&mut declare);
    declare.finish()?;
    let params = params.map_err(|e| NodeError::Input(format!("node {}: {e}", node.name())))?;
    let mut topics = Topics::new(node)?;
    let mut observer = Observer::new(params, node);
    while node.wait_for(PATIENCE) {
        observer.update_camera(&topics);
        while let Some(frame) = topics.next_frame(&mut observer) {
            observer.queue_frame(frame, Instant::now());
        }
        observer.update_motion(node.now(), &topics);
        observer.update_ranges(&topics);
        observer.solve(node.now());
        observer.take_solution(&topics);
        observer.coast(node.now(), &topics);
        topics.notice_silence(&observer);
    }
    Ok(())
}

/// Endpoints of the estimator node.
struct Topics {
    features: Subscription<fuyu_msgs::FeatureTracks>,
    points: Subscription<sensor_msgs::PointCloud2>,
    camera_info: Subscription<sensor_msgs::CameraInfo>,
    imu: Subscription<sensor_msgs::Imu>,
    tf_static: Subscription<tf2_msgs::TFMessage>,
    angular_velocity: Publisher<geometry_msgs::Vector3Stamped>,
    motion: Publisher<fuyu_msgs::MotionEstimate>,
    prediction: Publisher<nav_msgs::Path>,
    status: Status,
    range_status: Status,
}

impl Topics {
    fn new(node: &Node) -> Result<Self, NodeError> {
        let features = topics::FEATURES.subscribe_deep(node, QUEUE)?;
        let status = node.diagnostics().status("features");
        status.warn(format!("nothing has arrived on {} yet", features.topic()));
        let range_status = node.diagnostics().status("ranges");
        range_status
            .ok("no cloud has arrived; the scale comes from a known distance, if one is given");
        Ok(Self {
            features,
            points: topics::POINTS.subscribe(node)?,
            camera_info: topics::CAMERA_INFO.subscribe(node)?,
            imu: topics::IMU.subscribe_deep(node, QUEUE)?,
            tf_static: topics::TF_STATIC.subscribe(node)?,
            angular_velocity: topics::TARGET_RATE.advertise(node)?,
            motion: topics::TARGET_MOTION.advertise(node)?,
            prediction: topics::PREDICTION.advertise(node)?,
            status,
            range_status,
        })
    }

    /// The next valid frame in the queue; invalid frames are reported.
    fn next_frame(&mut self, observer: &mut Observer) -> Option<FeatureFrame> {
        while let Some(received) = self.features.take() {
            match feature_frame_from_msg(&received.message) {
                Ok(frame) => {
                    observer.camera_frame = received.message.header.frame_id;
                    self.status.ok("frames arrive");
                    self.status.set("features in sight", frame.features.len());
                    return Some(frame);
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

    fn notice_silence(&self, observer: &Observer) {
        if let Some(age) = self.features.age().filter(|age| *age > SILENCE)
            && observer.has_frames()
        {
            let (topic, seconds) = (self.features.topic(), age.as_secs_f64());
            self.status
                .warn(format!("{topic} has been silent for {seconds:.0} s"));
        }
    }
}
