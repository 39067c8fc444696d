//! Endpoints of the camera node for the target whose features are tracked.

use super::target_camera::{CAMERA_FRAME, TargetCamera};
use crate::{
    control::StampPairs,
    msg::{fuyu_msgs::FeatureTracks, nav_msgs::Odometry},
    nodes::{
        features::feature_frame_to_msg,
        geometry::{pose_from_msg, with_matrix},
        topics,
    },
    ros::{Node, NodeError, Publisher, Status, Subscription, Time},
    spatial::Pose,
};

/// A target's true pose, and the features that the camera tracks.
pub struct TargetTopics {
    odometry: Subscription<Odometry>,
    features: Publisher<FeatureTracks>,
    /// Poses of the camera and of the target in the world.
    truth: StampPairs<Time, Pose, Pose>,
    status: Status,
}

impl TargetTopics {
    /// Endpoints for the target of `camera`.
    ///
    /// # Errors
    /// When the node cannot subscribe or publish.
    pub fn new(node: &Node, camera: &TargetCamera) -> Result<Self, NodeError> {
        let odometry = topics::TARGET_ODOMETRY.subscribe(node, &camera.target)?;
        let status = node.diagnostics().status("features");
        status.warn(format!("nothing has arrived on {} yet", odometry.topic()));
        Ok(Self {
            odometry,
            features: match camera.is_truth {
                true => topics::TRUE_FEATURES.advertise(node)?,
                false => topics::FEATURES.advertise(node)?,
            },
            truth: StampPairs::default(),
            status,
        })
    }

    /// Adds the camera's pose in the world at `stamp`.
    pub fn camera_at(&mut self, stamp: Time, X_WC: Result<Pose, String>) {
        match X_WC {
            Ok(X_WC) => self.truth.push_first(stamp, X_WC),
            Err(problem) => self.status.error(problem),
        }
    }

    /// Exposes the camera to every state for which both poses have arrived, and publishes the frames that are due.
    pub fn track(&mut self, camera: &mut TargetCamera) {
        while let Some(received) = self.odometry.take() {
            let message = received.message;
            match pose_from_msg(&message.pose.pose) {
                Ok(X_WT) => {
                    let stamp = Time::from(&message.header.stamp);
                    self.truth.push_second(stamp, with_matrix(&X_WT));
                }
                Err(e) => self.status.warn(format!("{}: {e}", self.odometry.topic())),
            }
        }
        while let Some((stamp, X_WC, X_WT)) = self.truth.pop() {
            let time = stamp.as_secs_f64();
            camera.show(time, &X_WC, &X_WT);
            while let Some(frame) = camera.deliver(time) {
                self.features
                    .publish(&feature_frame_to_msg(&frame, CAMERA_FRAME));
                let count = frame.features.len();
                if count == 0 {
                    self.status.warn("the target is out of sight");
                } else {
                    self.status.ok(format!("tracking {}", camera.target));
                }
                self.status.set("features in sight", count);
            }
        }
        self.status.set("frames lost", camera.lost());
    }
}
