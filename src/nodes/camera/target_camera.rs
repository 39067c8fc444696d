//! The feature camera for a target.

use fuyu_render::Distortion;

use super::feature_params::FeatureParams;
use crate::{
    model::{Frame, Model},
    msg::fuyu_msgs::FeatureTracks,
    nodes::topics::{self, Topic},
    spatial::Pose,
    vision::{FeatureCamera, FeatureCameraConfig, FeatureFrame},
};

/// Name of the camera's optical frame.
pub const CAMERA_FRAME: &str = "camera_optical_frame";

/// The camera on the robot that tracks the features of a target.
pub struct TargetCamera {
    /// The target's name.
    pub target: String,
    /// Whether its features are published as the truth, next to those of a tracker.
    pub is_truth: bool,
    camera: FeatureCamera,
}

impl TargetCamera {
    /// With the target and settings of the parameters.
    pub fn new(params: &FeatureParams) -> Self {
        Self {
            target: params.target.clone(),
            is_truth: params.is_truth,
            camera: FeatureCamera::new(params.quality.clone(), params.points.clone()),
        }
    }

    /// The same with a distorting lens.
    #[must_use]
    pub fn with_lens(self, lens: Option<Distortion>) -> Self {
        let Some(lens) = lens.filter(|lens| *lens != Distortion::None) else {
            return self;
        };
        Self {
            target: self.target,
            is_truth: self.is_truth,
            camera: self.camera.with_lens(move |point| lens.distort(point)),
        }
    }

    /// Topic of the features.
    pub fn topic(&self) -> Topic<FeatureTracks> {
        match self.is_truth {
            true => topics::TRUE_FEATURES,
            false => topics::FEATURES,
        }
    }

    /// Changes the camera's settings.
    pub fn set_config(&mut self, config: FeatureCameraConfig) {
        self.camera.set_config(config);
    }

    /// Shows the camera, at pose `X_WC` in the world, the target at pose `X_WT` at `time` \[s\].
    pub fn show(&mut self, time: f64, X_WC: &Pose, X_WT: &Pose) {
        self.camera.show(time, &(X_WC.inverse() * X_WT));
    }

    /// The next frame that is delivered at `time` \[s\].
    pub fn deliver(&mut self, time: f64) -> Option<FeatureFrame> {
        self.camera.deliver(time)
    }

    /// Frames lost so far.
    pub fn lost(&self) -> u64 {
        self.camera.lost()
    }
}

/// The camera's optical frame on a robot.
///
/// # Errors
/// When the robot has no such link.
pub fn camera_frame(model: &Model) -> Result<&Frame, String> {
    model.frame(CAMERA_FRAME).ok_or_else(|| {
        format!(
            "robot '{}' has no link '{CAMERA_FRAME}', which features.target needs: the camera's optical frame, z forward (REP-103)",
            model.name()
        )
    })
}
