//! The camera node's endpoints for the target that it watches.

use super::watch::{CAMERA_FRAME, Watch};
use crate::{
    control::StampPairs,
    msg::{fuyu_msgs::FeatureTracks, nav_msgs::Odometry},
    nodes::{
        dynamics,
        features::sighting_to_msg,
        geometry::{pose_from_msg, with_matrix},
        topics,
    },
    ros::{Node, NodeError, Publisher, Status, Subscription, Time},
    spatial::Pose,
};

/// The truth about a target, and what the camera tracks of it.
pub struct TargetTopics {
    odometry: Subscription<Odometry>,
    features: Publisher<FeatureTracks>,
    /// Poses of the camera and of the target in the world.
    truth: StampPairs<Time, Pose, Pose>,
    status: Status,
}

impl TargetTopics {
    /// Endpoints to watch the target called `target`.
    ///
    /// # Errors
    /// When the node cannot subscribe or publish.
    pub fn new(node: &Node, target: &str) -> Result<Self, NodeError> {
        let topic = dynamics::odometry_topic(target);
        let status = node.diagnostics().status("features");
        status.warn(format!("nothing has arrived on {topic} yet"));
        Ok(Self {
            odometry: node.subscribe(&topic, topics::ODOMETRY.qos)?,
            features: topics::FEATURES.advertise(node)?,
            truth: StampPairs::default(),
            status,
        })
    }

    /// Takes in where the camera is in the world.
    pub fn camera_at(&mut self, stamp: Time, X_WC: Result<Pose, String>) {
        match X_WC {
            Ok(X_WC) => self.truth.push_first(stamp, X_WC),
            Err(problem) => self.status.error(problem),
        }
    }

    /// Shows the camera every instant of which all is known, and publishes what it delivers.
    pub fn watch(&mut self, watch: &mut Watch) {
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
            watch.show(time, &X_WC, &X_WT);
            while let Some(sighting) = watch.deliver(time) {
                self.features
                    .publish(&sighting_to_msg(&sighting, CAMERA_FRAME));
                let seen = sighting.features.len();
                if seen == 0 {
                    self.status.warn("the target is out of sight");
                } else {
                    self.status.ok(format!("tracking {}", watch.target));
                }
                self.status.set("features in sight", seen);
            }
        }
        self.status.set("frames lost", watch.lost());
    }
}
