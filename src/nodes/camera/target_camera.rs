//! The camera that tracks the features of a target.

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
    /// Whether its features are published as ground truth, because a tracker publishes measured ones.
    pub is_truth: bool,
    camera: FeatureCamera,
}

impl TargetCamera {
    /// A camera with the target and settings in `params`.
    pub fn new(params: &FeatureParams) -> Self {
        Self {
            target: params.target.clone(),
            is_truth: params.is_truth,
            camera: FeatureCamera::new(params.quality.clone(), params.points.clone()),
        }
    }

    /// Adds a distorting lens.
    #[must_use]
    pub fn with_lens(self, lens: Option<Distortion>) -> Self {
        let Some(lens) = lens.filter(|lens| *lens != Distortion::None) else {
            return self;
        };
        Self {
            target: self.target,
            is_truth: self.is_truth,
            camera: self
                .camera
                .with_lens(move |point| seen(&lens, point).unwrap_or([f64::INFINITY; 2])),
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

    /// Exposes the camera, at pose `X_WC` in the world, to the target at pose `X_WT` at `time` \[s\].
    pub fn show(&mut self, time: f64, X_WC: &Pose, X_WT: &Pose) {
        self.camera.show(time, &(X_WC.inverse() * X_WT));
    }

    /// The next frame that is due at `time` \[s\].
    pub fn deliver(&mut self, time: f64) -> Option<FeatureFrame> {
        self.camera.deliver(time)
    }

    /// Number of frames lost so far.
    pub fn lost(&self) -> u64 {
        self.camera.lost()
    }
}

/// The distorted image of the point `[x, y]` in the plane at distance 1; `None` outside the valid range of the lens,
/// where the distortion polynomial folds back onto the images of other points.
fn seen(lens: &Distortion, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let shown = lens.distort([x, y]);
    let [u, v] = lens.undistort(shown)?;
    ((u - x).hypot(v - y) < 1e-6 * (1.0 + x.hypot(y))).then_some(shown)
}

/// The camera's optical frame on a robot.
///
/// # Errors
/// If the robot has no such link.
pub fn camera_frame(model: &Model) -> Result<&Frame, String> {
    model.frame(CAMERA_FRAME).ok_or_else(|| {
        format!(
            "robot '{}' has no link '{CAMERA_FRAME}', which features.target needs: the camera's optical frame, z forward (REP-103)",
            model.name()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    // The polynomial folds a point at 58 degrees onto the image of a point at 22 degrees. Fails if it is seen there.
    #[test]
    fn points_beyond_the_range_of_a_lens_are_not_seen() {
        let lens = Distortion::PlumbBob([-0.3, 0.0, 0.0, 0.0, 0.0]);
        let [x, _] = lens.distort([1.6, 0.0]);
        assert!((x - 0.3712).abs() < 1e-9, "{x}");
        assert_eq!(seen(&lens, [1.6, 0.0]), None);
        assert_eq!(seen(&lens, [0.3, 0.1]), Some(lens.distort([0.3, 0.1])));
        assert_eq!(seen(&Distortion::None, [1.6, 0.0]), Some([1.6, 0.0]));
    }
}
