//! What the camera sees of a second arm.

use super::{CameraParams, Sight, seen};
use crate::{
    model::Frame,
    msg::geometry_msgs::PoseStamped,
    nodes::{geometry::with_matrix, tip_frame, topics},
    ros::{Node, NodeError, Publisher, Status, Time},
    spatial::Pose,
    vision::{PoseCamera, PoseCameraConfig},
};

/// The second tip's camera and endpoints; idle if there is no second arm.
pub struct SecondArm {
    arm: Option<Arm>,
}

struct Arm {
    link: String,
    X_WD: Option<Pose>,
    camera: PoseCamera,
    tip_pose: Publisher<PoseStamped>,
    goal_pose: Publisher<PoseStamped>,
}

/// How good the camera is at the second tip: as at the first, with noise of its own.
pub fn second_camera(quality: PoseCameraConfig) -> PoseCameraConfig {
    PoseCameraConfig {
        seed: quality.seed.wrapping_add(1),
        ..quality
    }
}

impl SecondArm {
    /// Endpoints of the second arm, if the parameters name one.
    ///
    /// # Errors
    /// When the node cannot publish.
    pub fn new(node: &Node, params: &CameraParams) -> Result<Self, NodeError> {
        if params.second_tip_link.is_empty() {
            return Ok(Self { arm: None });
        }
        let arm = Arm {
            link: params.second_tip_link.clone(),
            X_WD: params.second_goal.as_ref().map(with_matrix),
            camera: PoseCamera::new(second_camera(params.quality.clone())),
            tip_pose: topics::SECOND_TIP_POSE.advertise(node)?,
            goal_pose: topics::SECOND_SEEN_GOAL.advertise(node)?,
        };
        Ok(Self { arm: Some(arm) })
    }

    /// Changes how good the camera is.
    pub fn set_config(&mut self, quality: PoseCameraConfig) {
        if let Some(arm) = &mut self.arm {
            arm.camera.set_config(second_camera(quality));
        }
    }

    /// Shows the camera the instant that `sight` has looked at last, and publishes what it delivers.
    pub fn look(&mut self, sight: &Sight, stamp: Time, X_WB: &Pose, status: &Status) {
        let Some(arm) = &mut self.arm else {
            return;
        };
        let tip: Frame = match tip_frame(&sight.robot.model, &arm.link) {
            Ok(tip) => tip,
            Err(problem) => {
                status.error(format!("second_{problem}"));
                return;
            }
        };
        let X_BE = sight.workspace.X_BF(&tip);
        let X_BD = arm.X_WD.map(|X_WD| X_WB.inverse() * X_WD);
        let time = stamp.as_secs_f64();
        arm.camera.show(time, &X_BE, X_BD.as_ref());
        while let Some(frame) = arm.camera.deliver(time) {
            arm.tip_pose
                .publish(&seen(frame.time, &sight.base, &frame.X_BE));
            if let Some(X_BD) = &frame.X_BD {
                arm.goal_pose.publish(&seen(frame.time, &sight.base, X_BD));
            }
        }
    }
}
