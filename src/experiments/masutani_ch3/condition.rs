//! Conditions: the input of the estimation, true values or images. Masutani 1995 sec. 3.3 and table 3.1.

use nalgebra::Translation3;

use super::{INTERVAL, INTERVALS};
use crate::estimation::Tracks;
use crate::estimation::free_body::FreeRotation;
use crate::estimation::masutani1995::{self, MasutaniError, Rate, mean_rate};
use crate::spatial::Pose;
use crate::vision::{BodyPoint, FeatureCamera, FeatureCameraConfig, Pinhole};

/// Width of the image plane over the focal length: 10 mm over 8 mm.
const WIDTH: f64 = 10.0 / 8.0;
/// Distance of the body from the camera and radius of the sphere that carries its points \[m\].
const DISTANCE: f64 = 0.9;
const RADIUS: f64 = 0.45;

/// Input of the estimation (Fig. 3.17).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Condition<'a> {
    /// True angular velocities, one for each interval, at its beginning.
    TrueRates,
    /// True rotations between the frames.
    TrueRotations,
    /// Points on a sphere in whole pixels, all of them visible in each frame.
    Images {
        /// Pixels along each side of the image.
        resolution: u32,
        /// The points.
        points: &'a [BodyPoint],
    },
}

/// The camera of table 3.1.
pub fn camera(resolution: u32) -> Pinhole {
    Pinhole::square(resolution, WIDTH)
}

/// Random points on the sphere of table 3.1, different for every `seed`.
pub fn points(count: usize, seed: u64) -> Vec<BodyPoint> {
    BodyPoint::on_sphere(count, RADIUS, seed)
}

/// Tracks from the camera of table 3.1, of a motion about a fixed centre on its optical axis.
pub fn tracks(motion: &FreeRotation, resolution: u32, points: &[BodyPoint]) -> Tracks {
    let config = FeatureCameraConfig {
        quantised: true,
        ..FeatureCameraConfig::ideal(resolution, WIDTH)
    };
    let mut camera = FeatureCamera::new(config, points.to_vec());
    let mut tracks = Tracks::default();
    for i in 0..=INTERVALS {
        let time = INTERVAL * f64::from(i);
        let centre = Translation3::new(0.0, 0.0, DISTANCE);
        let attitude = motion.attitude(time).to_rotation_matrix();
        camera.show(time, &Pose::from_parts(centre, attitude));
        if let Some(frame) = camera.deliver(time) {
            // Cannot fail: times increase, pixels are finite, ids are unique.
            let _ = tracks.push(frame);
        }
    }
    tracks
}

/// The angular velocities that are the input of the estimation under a condition.
///
/// # Errors
/// [`MasutaniError`] if the images do not determine them.
pub fn rates(motion: &FreeRotation, condition: Condition<'_>) -> Result<Vec<Rate>, MasutaniError> {
    let time = |i: u32| INTERVAL * f64::from(i);
    let at = |i: u32| (time(i), motion.attitude(time(i)));
    Ok(match condition {
        Condition::TrueRates => (0..INTERVALS)
            .map(|i| (time(i), motion.angular_velocity(time(i))))
            .collect(),
        Condition::TrueRotations => (0..INTERVALS)
            .map(|i| mean_rate(at(i), at(i + 1)))
            .collect(),
        Condition::Images { resolution, points } => {
            let tracks = tracks(motion, resolution, points);
            masutani1995::rates_from_tracks(&tracks, &camera(resolution))?
        }
    })
}
