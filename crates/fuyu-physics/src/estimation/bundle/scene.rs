//! A scene: the observations that a bundle adjustment explains, by frame and point.

use std::ops::Range;

use nalgebra::{Vector2, Vector3};

/// Observation of a point in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneObservation {
    /// Number of the point.
    pub point: usize,
    /// Image point relative to the principal point \[px\].
    pub pixel: Vector2<f64>,
    /// Whether it agrees with the fit; an outlier may belong to another point.
    pub inlier: bool,
}

/// Observations by frame, and the camera. Points are numbered by first appearance.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Focal lengths along rows and columns \[px\].
    pub focal: Vector2<f64>,
    /// Number of points.
    pub points: usize,
    frames: Vec<Range<usize>>,
    observations: Vec<SceneObservation>,
    /// By point: square root of the weight of the prior that depth is 1, per observation \[px\]; see [`DEPTH_DEVIATION`].
    anchors: Vec<f64>,
}

/// Standard deviation of the prior on the points' depths, relative to their mean. The prior fixes the scale, and the
/// depths that images do not determine: those of a body that turns about the optical axis.
const DEPTH_DEVIATION: f64 = 0.5;

/// Tolerance for whole-number coordinates \[px\], wide enough for single precision.
const WHOLE_TOLERANCE: f64 = 1e-3;

impl Scene {
    /// A scene of `frames` with their observations of `points` points, with image noise `noise` \[px\].
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
            *count = noise / (DEPTH_DEVIATION * f64::max(*count, 1.0).sqrt());
        }
        scene
    }

    /// The scene of the frames `chosen` (ascending) alone, with all of their observations as inliers; `None` if it would show a
    /// point less than twice.
    pub fn of_frames(&self, chosen: &[usize], noise: f64) -> Option<Self> {
        let mut counts = vec![0_usize; self.points];
        let frames: Vec<Vec<_>> = (chosen.iter())
            .map(|&i| {
                let shown = self.frame(i).iter().map(|s| {
                    counts[s.point] += 1;
                    SceneObservation { inlier: true, ..*s }
                });
                shown.collect()
            })
            .collect();
        (counts.iter().all(|n| *n >= 2)).then(|| Self::new(self.focal, frames, self.points, noise))
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Observations in frame `i`.
    pub fn frame(&self, i: usize) -> &[SceneObservation] {
        &self.observations[self.frames[i].clone()]
    }

    /// Mutable [`Scene::frame`].
    pub fn frame_mut(&mut self, i: usize) -> &mut [SceneObservation] {
        &mut self.observations[self.frames[i].clone()]
    }

    /// Whether nine tenths of the inliers are at whole numbers of pixels, up to a common offset.
    pub fn is_rounded(&self) -> bool {
        let inliers: Vec<&SceneObservation> =
            self.observations.iter().filter(|s| s.inlier).collect();
        (0..2).all(|axis| {
            let off = |a: f64, b: f64| (a - b - (a - b).round()).abs();
            let agreeing = |shift: f64| {
                let agree = |s: &&&SceneObservation| off(s.pixel[axis], shift) < WHOLE_TOLERANCE;
                inliers.iter().filter(agree).count()
            };
            let mut shifts = inliers.iter().step_by(1 + inliers.len() / 5);
            shifts.any(|s| 10 * agreeing(s.pixel[axis]) >= 9 * inliers.len())
        })
    }

    /// Square root of the weight of the depth prior of one observation of `point` \[px\].
    pub fn anchor(&self, point: usize) -> f64 {
        self.anchors[point]
    }

    /// All observations.
    pub fn observations(&self) -> &[SceneObservation] {
        &self.observations
    }
}

/// Residual of an observation \[px\], of a point at `x` in the camera's frame. `None` for a point behind the camera.
#[inline]
pub fn residual(
    focal: &Vector2<f64>,
    x: &Vector3<f64>,
    pixel: &Vector2<f64>,
) -> Option<Vector2<f64>> {
    (x.z > MIN_DEPTH).then(|| {
        let inverse = 1.0 / x.z;
        Vector2::new(focal.x * x.x * inverse, focal.y * x.y * inverse) - pixel
    })
}

/// Least depth of a point, as a share of the mean depth.
pub const MIN_DEPTH: f64 = 1e-3;
