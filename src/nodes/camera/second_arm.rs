//! Camera measurements of a second arm.

use super::{CameraParams, Kinematics, pose_message};
use crate::{
    model::Frame,
    msg::geometry_msgs::PoseStamped,
    nodes::{geometry::with_matrix, tip_frame, topics},
    ros::{Node, NodeError, Publisher, Status, Time},
    spatial::Pose,
    vision::{PoseCamera, PoseCameraConfig},
};

/// Camera and endpoints of the second tip; does nothing without a second arm.
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

/// The camera settings of the second tip: those of the first with another seed.
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
            goal_pose: topics::SECOND_MEASURED_GOAL.advertise(node)?,
        };
        Ok(Self { arm: Some(arm) })
    }

    /// Changes the camera's settings.
    pub fn set_config(&mut self, quality: PoseCameraConfig) {
        if let Some(arm) = &mut self.arm {
            arm.camera.set_config(second_camera(quality));
        }
    }

    /// Exposes the camera to the last state of `kinematics`, and publishes the frames that are due.
    pub fn measure(&mut self, kinematics: &Kinematics, stamp: Time, X_WB: &Pose, status: &Status) {
        let Some(arm) = &mut self.arm else {
            return;
        };
        let tip: Frame = match tip_frame(&kinematics.robot.model, &arm.link) {
            Ok(tip) => tip,
            Err(problem) => {
                status.error(format!("second_{problem}"));
                return;
            }
        };
        let X_BE = kinematics.workspace.X_BF(&tip);
        let X_BD = arm.X_WD.map(|X_WD| X_WB.inverse() * X_WD);
        let time = stamp.as_secs_f64();
        arm.camera.show(time, &X_BE, X_BD.as_ref());
        while let Some(frame) = arm.camera.deliver(time) {
            arm.tip_pose
                .publish(&pose_message(frame.time, &kinematics.base, &frame.X_BE));
            if let Some(X_BD) = &frame.X_BD {
                arm.goal_pose
                    .publish(&pose_message(frame.time, &kinematics.base, X_BD));
            }
        }
    }
}
