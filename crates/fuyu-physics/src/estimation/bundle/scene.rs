//! A scene: the observations that a bundle adjustment explains, by frame and point.

use std::ops::Range;

use nalgebra::{Vector2, Vector3};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// Observation of a point in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneObservation {
    /// Number of the point.
    pub point: usize,
    /// Image point relative to the principal point \[px\].
    pub pixel: Vector2<f64>,
    /// Whether the observation agrees with the fit; an outlier may belong to another point.
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
    /// For each point, the square root of the weight of the prior that its depth is 1, per observation \[px\]; see
    /// [`DEPTH_DEVIATION`].
    anchors: Vec<f64>,
    /// Square root of the weight of the prior on the centre of mass, for a body of unit size \[px\]; see
    /// [`CENTRE_DEVIATION`]. Zero without a prior.
    centre: f64,
    /// Expected mean of the points in axes at the centre of mass, for a body of unit size.
    offset: Vector3<f64>,
}

/// Standard deviation of the prior on the centre of mass for each axis: of its distance from the mean of the points,
/// relative to their root mean square distance from that mean. For points on one face of a cube the distance is 1.2.
const CENTRE_DEVIATION: f64 = 1.0;

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
            centre: 0.0,
            offset: Vector3::zeros(),
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
        (counts.iter().all(|n| *n >= 2)).then(|| Self {
            centre: self.centre,
            ..Self::new(self.focal, frames, self.points, noise)
        })
    }

    /// Adds a prior that the origin of body axes, the centre of mass, lies within the body: a rotation that does not
    /// determine the centre could place it anywhere. `noise` is the image noise \[px\].
    pub fn expect_centre(&mut self, noise: f64) {
        self.centre = noise / CENTRE_DEVIATION;
    }

    /// The prior on the centre of mass of a body with `points`; `None` without [`Scene::expect_centre`].
    pub fn centre_prior(&self, points: &[Vector3<f64>]) -> Option<CentrePrior> {
        let count = points.len().max(1) as f64;
        let mean = points.iter().sum::<Vector3<f64>>() / count;
        let mut about: Vec<Vector3<f64>> = points.iter().map(|p| p - mean).collect();
        let squares: f64 = about.iter().map(Vector3::norm_squared).sum();
        let offset = self.offset * (squares / count).sqrt();
        about.iter_mut().for_each(|q| *q += offset);
        (self.centre > 0.0 && squares > 0.0).then(|| CentrePrior {
            weight: self.centre * self.centre / squares,
            about,
        })
    }

    /// The scene with random errors added to its data: to the image points, of standard deviation `noise` \[px\], and
    /// to the expected centre of mass.
    pub fn with_random_errors(&self, noise: f64, rng: &mut impl Rng) -> Self {
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let mut other = self.clone();
        for observation in &mut other.observations {
            observation.pixel += Vector2::from_fn(|_, _| normal()) * noise;
        }
        other.offset = Vector3::from_fn(|_, _| normal()) * CENTRE_DEVIATION;
        other
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

/// Prior on the centre of mass, which is the origin of body axes: the expected position of each point is that for an
/// origin at the expected centre. A point's weight is so small that only the mean of all points is affected.
#[derive(Debug, Clone, PartialEq)]
pub struct CentrePrior {
    /// Weight of a point \[px²\].
    pub weight: f64,
    /// Expected positions.
    pub about: Vec<Vector3<f64>>,
}

impl CentrePrior {
    /// Its cost for a body with `points` \[px²\].
    pub fn cost(&self, points: &[Vector3<f64>]) -> f64 {
        let squares = (points.iter().zip(&self.about)).map(|(p, q)| (p - q).norm_squared());
        0.5 * self.weight * squares.sum::<f64>()
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand::rngs::StdRng;

    fn scene(points: usize) -> Scene {
        let frame = (0..points).map(|point| SceneObservation {
            point,
            pixel: Vector2::zeros(),
            inlier: true,
        });
        Scene::new(
            Vector2::new(800.0, 800.0),
            vec![frame.collect()],
            points,
            0.3,
        )
    }

    // The cost is that of a deviation of the mean, in units of the noise: half a variance at one radius.
    #[test]
    fn a_centre_of_mass_one_radius_away_costs_half_a_variance() {
        let noise = 0.3;
        let mut scene = scene(8);
        let cube = |k: u8| {
            let sign = |bit: u8| if k & bit == 0 { -0.2 } else { 0.2 };
            Vector3::new(sign(1), sign(2), sign(4))
        };
        let radius = 0.2 * 3f64.sqrt();
        let points: Vec<_> = (0..8).map(|k| cube(k) + Vector3::z() * radius).collect();
        assert!(scene.centre_prior(&points).is_none());
        scene.expect_centre(noise);
        let cost = scene.centre_prior(&points).unwrap().cost(&points);
        assert!((cost - 0.5 * noise * noise).abs() < 1e-12, "{cost}");
        // One point alone hardly matters.
        let prior = scene.centre_prior(&points).unwrap();
        let mut moved = points.clone();
        moved[0] += Vector3::x() * 0.1 * radius;
        assert!((prior.cost(&moved) - cost).abs() < 0.01 * noise * noise);
    }

    #[test]
    fn random_errors_have_their_standard_deviations() {
        let mut scene = scene(4000);
        scene.expect_centre(0.3);
        let mut rng = StdRng::seed_from_u64(3);
        let other = scene.with_random_errors(0.5, &mut rng);
        let squares = other.observations().iter().map(|s| s.pixel.norm_squared());
        let variance = squares.sum::<f64>() / 8000.0;
        assert!((variance - 0.25).abs() < 0.02, "{variance}");
        let offsets = (0..4000).map(|_| {
            let offset = scene.with_random_errors(0.5, &mut rng).offset;
            offset.norm_squared()
        });
        let variance = offsets.take(400).sum::<f64>() / 1200.0;
        assert!(
            (variance - CENTRE_DEVIATION.powi(2)).abs() < 0.15,
            "{variance}"
        );
    }
}
