//! Parameters of the features that the camera tracks on a target.

use crate::{
    nodes::{mesh, resource},
    ros::{Declare, Param},
    vision::{BodyPoint, FeatureCameraConfig, Pinhole},
};

/// The tracked features, and the accuracy of tracking.
#[derive(Debug, Clone)]
pub struct FeatureParams {
    /// Name of the target.
    pub target: String,
    /// Its feature points in body axes.
    pub points: Vec<BodyPoint>,
    /// Whether they are published as ground truth, because a tracker publishes features found in the images.
    pub is_truth: bool,
    /// Settings of camera and tracker.
    pub quality: FeatureCameraConfig,
}

/// Live parameters of camera and tracker, which may change while the node runs.
pub(super) struct FeatureQuality {
    floats: [Param<f64>; 6],
    quantised: Param<bool>,
    occlusion: Param<bool>,
    seed: Param<i64>,
}

impl FeatureQuality {
    fn declare(declare: &mut Declare) -> Self {
        let mut float = |name: &str, default: f64, to: f64, text: &str| {
            let parameter = declare.param(&format!("features.{name}"), default, text);
            parameter.range(0.0, to).live()
        };
        let floats = [
            float(
                "rate",
                10.0,
                1000.0,
                "Frames of features per second [Hz]; 0 is a frame for every state",
            ),
            float(
                "latency",
                0.0,
                10.0,
                "Delay from exposure to publication of features [s]",
            ),
            float(
                "dropout",
                0.0,
                1.0,
                "Probability that a frame of features is lost",
            ),
            float(
                "noise",
                0.0,
                1000.0,
                "Standard deviation of each coordinate of a feature, before rounding [px]",
            ),
            float(
                "outliers",
                0.0,
                1.0,
                "Probability that a feature is measured anywhere in the image",
            ),
            float(
                "losses",
                0.0,
                1.0,
                "Probability that a feature's track ends at a frame; it returns under another id",
            ),
        ];
        Self {
            floats,
            quantised: (declare.param(
                "features.quantised",
                true,
                "Whether coordinates of features are rounded to whole pixels",
            ))
            .live(),
            occlusion: (declare.param(
                "features.occlusion",
                false,
                "Whether the target hides its far side",
            ))
            .live(),
            seed: (declare.param("features.seed", 1, "Seed of the features' noise and losses"))
                .live(),
        }
    }

    /// The current settings for an image of (width, height, focal length) pixels.
    pub(super) fn get(&self, image: (u32, u32, f64)) -> FeatureCameraConfig {
        let [rate, latency, dropout, noise, outliers, losses] =
            self.floats.each_ref().map(Param::get);
        FeatureCameraConfig {
            pinhole: pinhole(image),
            size: [image.0, image.1],
            rate,
            latency,
            quantised: self.quantised.get(),
            noise,
            occlusion: self.occlusion.get(),
            outliers,
            losses,
            dropout,
            seed: self.seed.get().unsigned_abs(),
        }
    }

    pub(super) fn changed(&self) -> bool {
        // No short circuit: every handle must be queried, or it would report its change later.
        let floats = self.floats.iter().filter(|p| p.changed()).count();
        let others = [
            self.quantised.changed(),
            self.occlusion.changed(),
            self.seed.changed(),
        ];
        floats > 0 || others.contains(&true)
    }
}

impl FeatureParams {
    /// Declares and reads the parameters; `None` without a target.
    ///
    /// # Errors
    /// A line that names the parameter, and says why its mesh cannot be used.
    pub(super) fn declare(
        declare: &mut Declare,
        image: (u32, u32, f64),
    ) -> Result<(Option<Self>, FeatureQuality), String> {
        let target = (declare.param(
            "features.target",
            "",
            "Name of the target whose feature points are tracked; empty is none",
        ))
        .read_only()
        .value();
        let mesh = (declare.param(
            "features.mesh",
            "",
            "STL file whose vertices, in the target's frame [m], are the feature points: a path or package://fuyu/PATH; empty is points on a sphere",
        ))
        .read_only()
        .value();
        let points = (declare.param("features.points", 20, "Feature points on the sphere"))
            .range(1, 100_000)
            .read_only()
            .value();
        let radius = (declare.param("features.radius", 1.0, "Radius of the sphere [m]"))
            .range(1e-6, 1e6)
            .read_only()
            .value();
        let layout = (declare.param(
            "features.layout_seed",
            1,
            "Seed of the points' positions on the sphere",
        ))
        .read_only()
        .value();
        let is_truth = (declare.param(
            "features.ground_truth",
            false,
            "Whether features are published on ground_truth/features instead of camera/features, where a tracker publishes its own",
        ))
        .read_only()
        .value();
        let quality = FeatureQuality::declare(declare);
        if target.is_empty() {
            return Ok((None, quality));
        }
        let points = if mesh.is_empty() {
            let points = usize::try_from(points).unwrap_or(1);
            BodyPoint::on_sphere(points, radius, layout.unsigned_abs())
        } else {
            let read = resource::resolve(&mesh).and_then(|found| mesh::vertices(&found));
            BodyPoint::of_vertices(&read.map_err(|e| format!("parameter features.mesh: {e}"))?)
        };
        let params = Self {
            target,
            points,
            is_truth,
            quality: quality.get(image),
        };
        Ok((Some(params), quality))
    }
}

/// The camera model for an image of `width` by `height` pixels, with the optical axis through its centre.
pub fn pinhole((width, height, focal_length): (u32, u32, f64)) -> Pinhole {
    // Pixel centres have integer coordinates: the centre of the image is at (size - 1) / 2.
    Pinhole {
        fx: focal_length,
        fy: focal_length,
        cx: 0.5 * f64::from(width) - 0.5,
        cy: 0.5 * f64::from(height) - 0.5,
    }
}
