//! The camera's view of a target.

use super::feature_params::FeatureParams;
use crate::{
    model::{Frame, Model},
    spatial::Pose,
    vision::{FeatureCamera, FeatureCameraConfig, Sighting},
};

/// Name of the camera's optical frame.
pub const CAMERA_FRAME: &str = "camera_optical_frame";

/// What the camera on the robot tracks of a target.
pub struct Watch {
    /// The target's name.
    pub target: String,
    camera: FeatureCamera,
}

impl Watch {
    /// Watches what the parameters say.
    pub fn new(params: &FeatureParams) -> Self {
        Self {
            target: params.target.clone(),
            camera: FeatureCamera::new(params.quality.clone(), params.points.clone()),
        }
    }

    /// Changes how good the tracker is.
    pub fn set_config(&mut self, config: FeatureCameraConfig) {
        self.camera.set_config(config);
    }

    /// Shows the camera, at pose `X_WC`, the target at pose `X_WT`, at `time` \[s\].
    pub fn show(&mut self, time: f64, X_WC: &Pose, X_WT: &Pose) {
        self.camera.show(time, &(X_WC.inverse() * X_WT));
    }

    /// The next frame that has arrived at `time` \[s\].
    pub fn deliver(&mut self, time: f64) -> Option<Sighting> {
        self.camera.deliver(time)
    }

    /// Frames lost so far.
    pub fn lost(&self) -> u64 {
        self.camera.lost()
    }
}

/// The frame of the camera on a robot.
///
/// # Errors
/// Says that the robot has no such link.
pub fn camera_frame(model: &Model) -> Result<&Frame, String> {
    model.frame(CAMERA_FRAME).ok_or_else(|| {
        format!(
            "robot '{}' has no link '{CAMERA_FRAME}', which features.target needs: the camera's optical frame, z forward (REP-103)",
            model.name()
        )
    })
}
