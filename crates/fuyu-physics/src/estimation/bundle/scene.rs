//! What a bundle adjustment is about: which frame saw which point where.

use std::ops::Range;

use nalgebra::{Vector2, Vector3};

/// One observation of a point in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneObservation {
    /// Which point.
    pub point: usize,
    /// Where, from the principal point \[px\].
    pub pixel: Vector2<f64>,
    /// Whether it is believed; what is not belongs to another point or to none.
    pub inlier: bool,
}

/// Observations by frame, and what is known of the camera. Points are numbered in the order in which they were
/// first seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Focal lengths along rows and columns \[px\].
    pub focal: Vector2<f64>,
    /// Number of points.
    pub points: usize,
    frames: Vec<Range<usize>>,
    observations: Vec<SceneObservation>,
    /// How strongly each observation of a point holds its depth to 1 \[px\]: see [`DEPTH_SPREAD`].
    anchors: Vec<f64>,
}

/// Standard deviation of the points' depths around their mean that is assumed, relative to the mean. It fixes
/// the scale, and the depths that images leave open: those of a body that turns about the optical axis.
const DEPTH_SPREAD: f64 = 0.5;

/// A coordinate this near to a whole number \[px\] is one, in single precision, too.
const WHOLE: f64 = 1e-3;

impl Scene {
    /// A scene of frames that show `(point, pixel)`, with image noise `noise` \[px\].
    pub fn new(
        focal: Vector2<f64>,
        frames: Vec<Vec<SceneObservation>>,
        points: usize,
        noise: f64,
    ) -> Self {
        let mut scene = Self {
            focal,
            points,
            frames: Vec::with_capacity(frames.len()),
            observations: Vec::with_capacity(frames.iter().map(Vec::len).sum()),
            anchors: vec![0.0; points],
        };
        for frame in frames {
            let first = scene.observations.len();
            for observation in frame {
                scene.anchors[observation.point] += 1.0;
                scene.observations.push(observation);
            }
            scene.frames.push(first..scene.observations.len());
        }
        for count in &mut scene.anchors {
            *count = noise / (DEPTH_SPREAD * f64::max(*count, 1.0).sqrt());
        }
        scene
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// What frame `i` shows.
    pub fn frame(&self, i: usize) -> &[SceneObservation] {
        &self.observations[self.frames[i].clone()]
    }

    /// As [`Scene::frame`], to change.
    pub fn frame_mut(&mut self, i: usize) -> &mut [SceneObservation] {
        &mut self.observations[self.frames[i].clone()]
    }

    /// Whether pixels are whole numbers, but for a shift of all; some outliers may not be.
    pub fn is_rounded(&self) -> bool {
        let inliers: Vec<&SceneObservation> =
            self.observations.iter().filter(|s| s.inlier).collect();
        (0..2).all(|axis| {
            let off = |a: f64, b: f64| (a - b - (a - b).round()).abs();
            let agreeing = |shift: f64| {
                let agree = |s: &&&SceneObservation| off(s.pixel[axis], shift) < WHOLE;
                inliers.iter().filter(agree).count()
            };
            let mut shifts = inliers.iter().step_by(1 + inliers.len() / 5);
            shifts.any(|s| 10 * agreeing(s.pixel[axis]) >= 9 * inliers.len())
        })
    }

    /// Strength of the depth prior of one observation of `point` \[px\].
    pub fn anchor(&self, point: usize) -> f64 {
        self.anchors[point]
    }

    /// All observations.
    pub fn observations(&self) -> &[SceneObservation] {
        &self.observations
    }
}

/// Residual of an observation \[px\], of a point at `x` in the camera's frame. `None` behind the camera.
#[inline]
pub fn residual(
    focal: &Vector2<f64>,
    x: &Vector3<f64>,
    pixel: &Vector2<f64>,
) -> Option<Vector2<f64>> {
    (x.z > NEAREST).then(|| {
        let inverse = 1.0 / x.z;
        Vector2::new(focal.x * x.x * inverse, focal.y * x.y * inverse) - pixel
    })
}

/// Nothing is nearer to the camera than this part of the mean distance.
pub const NEAREST: f64 = 1e-3;
