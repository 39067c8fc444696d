//! Parameters of the camera node.

use fuyu_render::Distortion;
use nalgebra::Isometry3;

use super::{
    feature_params::{FeatureParams, FeatureQuality},
    images::{ImageParams, LiveImageSettings},
};
use crate::{
    nodes::{
        placement::declare_pose,
        tip::{declare_second_tip_link, declare_tip_link},
    },
    ros::{Declare, Param},
    vision::PoseCameraConfig,
};

/// Parameters of the camera node.
#[derive(Debug, Clone)]
pub struct CameraParams {
    /// Link whose frame is the tip.
    pub tip_link: String,
    /// Goal in its frame, until another one arrives on `goal_pose`.
    pub goal: Option<Isometry3<f64>>,
    /// Target on which the goal is; `None` for a goal in the world.
    pub goal_target: Option<String>,
    /// Link whose frame is the tip of a second arm; empty without one.
    pub second_tip_link: String,
    /// Goal of the second tip in the world.
    pub second_goal: Option<Isometry3<f64>>,
    /// Accuracy and timing of the camera.
    pub quality: PoseCameraConfig,
    /// Image size \[px\] and focal length \[px\].
    pub image: (u32, u32, f64),
    /// Features to track on a target; `None` without a target.
    pub features: Option<FeatureParams>,
    /// Images to render; `None` without cameras.
    pub images: Option<ImageParams>,
}

/// The frame of a goal that does not move with a target.
pub const WORLD: &str = "world";

/// Live parameters of accuracy and timing.
pub(super) struct Quality {
    rate: Param<f64>,
    latency: Param<f64>,
    position_noise: Param<f64>,
    attitude_noise: Param<f64>,
    dropout: Param<f64>,
    seed: Param<i64>,
}

/// All live parameters, which may change while the node runs.
pub(super) struct LiveParams {
    pub quality: Quality,
    pub tracking: FeatureQuality,
    pub images: LiveImageSettings,
}

impl Quality {
    fn declare(declare: &mut Declare) -> Self {
        let mut positive =
            |name: &str, to: f64, text: &str| declare.param(name, 0.0, text).range(0.0, to).live();
        Self {
            rate: positive(
                "rate",
                1000.0,
                "Frames per second [Hz]; 0 is a frame for every state",
            ),
            latency: positive("latency", 10.0, "Delay from exposure to publication [s]"),
            position_noise: positive(
                "position_noise",
                10.0,
                "Standard deviation of each coordinate of a measured position [m]",
            ),
            attitude_noise: positive(
                "attitude_noise",
                1.0,
                "Standard deviation of each component of a measured attitude [rad]",
            ),
            dropout: positive("dropout", 1.0, "Probability that a frame is lost"),
            seed: declare.param("seed", 1, "Seed of noise and losses").live(),
        }
    }

    pub(super) fn get(&self) -> PoseCameraConfig {
        PoseCameraConfig {
            rate: self.rate.get(),
            latency: self.latency.get(),
            position_noise: self.position_noise.get(),
            attitude_noise: self.attitude_noise.get(),
            dropout: self.dropout.get(),
            seed: self.seed.get().unsigned_abs(),
        }
    }

    pub(super) fn changed(&self) -> bool {
        let floats = [
            &self.rate,
            &self.latency,
            &self.position_noise,
            &self.attitude_noise,
        ];
        // No short circuit: every handle must be queried, or it would report its change later.
        let changed = floats.iter().filter(|p| p.changed()).count();
        changed > 0 || self.dropout.changed() || self.seed.changed()
    }
}

impl CameraParams {
    /// Lens distortion of the main camera; `None` if its images are not rendered.
    pub fn lens(&self) -> Option<Distortion> {
        self.images.as_ref().and_then(ImageParams::main_lens)
    }

    /// Declares and reads the parameters. The caller must call `declare.finish`.
    ///
    /// # Errors
    /// A line that names the parameter with contradictory values.
    pub fn declare(declare: &mut Declare) -> Result<Self, String> {
        Self::declare_live(declare).map(|(params, _)| params)
    }

    pub(super) fn declare_live(declare: &mut Declare) -> Result<(Self, LiveParams), String> {
        let tip_link = declare_tip_link(declare);
        let goal = declare_pose(declare, "goal", "goal object", true);
        let goal_frame = declare
            .param(
                "goal.frame",
                WORLD,
                "Frame that the goal is given in and moves with: world, the name of a target, or of another robot /NAMESPACE/TARGET or /NAMESPACE/base_link",
            )
            .read_only()
            .value();
        let second_tip_link = declare_second_tip_link(declare);
        let second_goal = declare_pose(declare, "second_goal", "second tip's goal", true);
        let quality = Quality::declare(declare);
        let mut pixels = |name: &str, text: &str| {
            let value = declare
                .param(name, 1024, text)
                .range(16, 65_536)
                .read_only()
                .value();
            u32::try_from(value).unwrap_or(1024)
        };
        let width = pixels("image_width", "Width of the image [px]");
        let height = pixels("image_height", "Height of the image [px]");
        let focal_length = declare
            .param("focal_length", 1024.0, "Focal length [px]")
            .range(1.0, 1e6)
            .read_only()
            .value();
        let image = (width, height, focal_length);
        let features = FeatureParams::declare(declare, image);
        let (features, tracking) = features?;
        let target = features.as_ref().map(|f| f.target.as_str());
        let (images, lights) = ImageParams::declare(declare, image, target)?;
        let params = Self {
            tip_link,
            goal: goal?,
            goal_target: (goal_frame != WORLD).then_some(goal_frame),
            second_tip_link,
            second_goal: second_goal?,
            quality: quality.get(),
            image,
            features,
            images,
        };
        let live = LiveParams {
            quality,
            tracking,
            images: lights,
        };
        Ok((params, live))
    }
}
