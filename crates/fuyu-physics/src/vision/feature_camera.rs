//! A camera that tracks feature points of a body, with the errors of a real tracker.

use nalgebra::{UnitVector3, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::frame_stream::{FrameStream, StreamConfig};
use super::{Feature, FeatureFrame, Pinhole};
use crate::spatial::Pose;

/// A feature point of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPoint {
    /// Position in the body's frame B \[m\].
    pub p_B: Vector3<f64>,
    /// Outward normal of the surface there, in B: the point is visible from the half space to which the normal points.
    pub normal_B: UnitVector3<f64>,
}

impl BodyPoint {
    /// `count` points on a sphere of `radius` \[m\] about the body's origin, uniformly at random (Masutani 1995 sec. 3.3).
    pub fn on_sphere(count: usize, radius: f64, seed: u64) -> Vec<Self> {
        let mut random = StdRng::seed_from_u64(seed);
        let mut normal = || -> f64 { random.sample(StandardNormal) };
        let points = (0..count).map(|_| {
            let normal_B = UnitVector3::new_normalize(Vector3::new(normal(), normal(), normal()));
            let p_B = normal_B.into_inner() * radius;
            Self { p_B, normal_B }
        });
        points.collect()
    }

    /// Points of a roughly convex body in B \[m\], such as a mesh's vertices: the normal of each point is directed away
    /// from the mean of all points.
    pub fn of_vertices(vertices: &[Vector3<f64>]) -> Vec<Self> {
        let mean = vertices.iter().sum::<Vector3<f64>>() / vertices.len().max(1) as f64;
        let facing =
            |p: &Vector3<f64>| UnitVector3::try_new(p - mean, 0.0).unwrap_or_else(Vector3::z_axis);
        let points = vertices.iter().map(|p| Self {
            p_B: *p,
            normal_B: facing(p),
        });
        points.collect()
    }
}

/// Image, accuracy and timing of a [`FeatureCamera`].
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureCameraConfig {
    /// Intrinsic parameters.
    pub pinhole: Pinhole,
    /// Columns and rows of the image \[px\]; points outside are not tracked.
    pub size: [u32; 2],
    /// Frames per second \[Hz\]; zero means a frame at every time shown.
    pub rate: f64,
    /// Delay from exposure to delivery \[s\].
    pub latency: f64,
    /// Whether coordinates are rounded to whole pixels.
    pub quantised: bool,
    /// Standard deviation of each coordinate before rounding \[px\].
    pub noise: f64,
    /// Whether points on the far side are hidden.
    pub occlusion: bool,
    /// Probability, for each feature of each frame, that it is an outlier, uniformly distributed over the image, in [0, 1].
    pub outliers: f64,
    /// Probability, for each feature of each frame, that its track ends there, in [0, 1].
    pub losses: f64,
    /// Probability that a frame is lost, in [0, 1].
    pub dropout: f64,
    /// Seed of the random generator.
    pub seed: u64,
}

impl FeatureCameraConfig {
    /// An ideal camera with a square image of `resolution` pixels a side and `width` focal lengths: it tracks every
    /// point at every time shown, including those on the far side, without delay or error.
    pub fn ideal(resolution: u32, width: f64) -> Self {
        Self {
            pinhole: Pinhole::square(resolution, width),
            size: [resolution; 2],
            rate: 0.0,
            latency: 0.0,
            quantised: false,
            noise: 0.0,
            occlusion: false,
            outliers: 0.0,
            losses: 0.0,
            dropout: 0.0,
            seed: 1,
        }
    }
}

/// A camera that tracks feature points of one body.
///
/// Call [`show`](Self::show) with the body's true pose at increasing times; [`deliver`](Self::deliver) returns the
/// frames that have arrived. A point that is missing in a frame (lost, hidden, outside the image) returns under a new
/// id, as from a tracker without knowledge of the body.
///
/// ```
/// # #![allow(non_snake_case)]
/// use fuyu_physics::spatial::Pose;
/// use fuyu_physics::vision::{BodyPoint, FeatureCamera, FeatureCameraConfig};
/// use nalgebra::Translation3;
///
/// // Twenty points on a sphere of 0.5 m, 5 m in front of a camera of 1024 x 1024 px, with half a pixel of noise.
/// let config = FeatureCameraConfig {
///     noise: 0.5,
///     ..FeatureCameraConfig::ideal(1024, 1.0)
/// };
/// let mut camera = FeatureCamera::new(config, BodyPoint::on_sphere(20, 0.5, 1));
/// let X_CB = Translation3::new(0.0, 0.0, 5.0) * Pose::identity();
/// camera.show(0.0, &X_CB);
/// let frame = camera.deliver(0.0).expect("it has no latency");
/// assert_eq!(frame.features.len(), 20);
/// // The body's centre is in the middle of the image, and the sphere reaches 0.5 / 5 focal lengths from there.
/// for feature in &frame.features {
///     assert!((feature.u - 511.5).hypot(feature.v - 511.5) < 0.11 * 1024.0);
/// }
/// ```
#[derive(Debug)]
pub struct FeatureCamera {
    config: FeatureCameraConfig,
    points: Vec<BodyPoint>,
    /// The id of each point while it is tracked.
    ids: Vec<Option<u64>>,
    next_id: u64,
    /// The lens; without one the camera is a pinhole.
    lens: Option<Lens>,
    stream: FrameStream<FeatureFrame>,
}

/// Maps the point (x, y) of the image plane at z = 1 to its distorted position.
struct Lens(Box<dyn Fn([f64; 2]) -> [f64; 2] + Send>);

impl std::fmt::Debug for Lens {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Lens")
    }
}

impl FeatureCameraConfig {
    fn stream(&self) -> StreamConfig {
        StreamConfig {
            rate: self.rate,
            latency: self.latency,
            dropout: self.dropout,
            seed: self.seed,
        }
    }
}

impl FeatureCamera {
    /// A camera that tracks `points`. The first ones tracked get the ids 0, 1, ... in their order.
    pub fn new(config: FeatureCameraConfig, points: Vec<BodyPoint>) -> Self {
        Self {
            stream: FrameStream::new(config.stream()),
            ids: vec![None; points.len()],
            next_id: 0,
            lens: None,
            config,
            points,
        }
    }

    /// The same camera with a lens, which shows the point (x, y) of the image plane at z = 1 at the position
    /// `distort([x, y])`.
    #[must_use]
    pub fn with_lens(self, distort: impl Fn([f64; 2]) -> [f64; 2] + Send + 'static) -> Self {
        let lens = Some(Lens(Box::new(distort)));
        Self { lens, ..self }
    }

    /// Image, accuracy and timing.
    pub fn config(&self) -> &FeatureCameraConfig {
        &self.config
    }

    /// Changes the settings from now on; earlier exposures are still delivered.
    pub fn set_config(&mut self, config: FeatureCameraConfig) {
        self.stream.set_config(config.stream());
        self.config = config;
    }

    /// Frames lost so far.
    pub fn lost(&self) -> u64 {
        self.stream.lost()
    }

    /// Whether an exposure is due at `time` \[s\].
    pub fn is_due(&self, time: f64) -> bool {
        self.stream.is_due(time)
    }

    /// Shows the camera the body's true pose `X_CB` in its optical frame at `time` \[s\]; it exposes if a frame is due.
    /// A time that is shown twice is exposed once. When time jumps back (the simulation was restarted), the camera
    /// restarts with the same noise but new ids.
    pub fn show(&mut self, time: f64, X_CB: &Pose) {
        let Some(exposure) = self.stream.expose(time) else {
            return;
        };
        if exposure.first_of_run {
            self.ids.fill(None);
        }
        let mut features = Vec::with_capacity(self.points.len());
        for i in 0..self.points.len() {
            let point = self.points[i];
            match self.measure(&point, X_CB) {
                Some([u, v]) => {
                    let id = *self.ids[i].get_or_insert_with(|| {
                        self.next_id += 1;
                        self.next_id - 1
                    });
                    features.push(Feature { id, u, v });
                }
                None => self.ids[i] = None,
            }
        }
        let frame = FeatureFrame::new(time, features);
        self.stream.push(time, frame, exposure);
    }

    /// The next frame whose latency has passed at `time` \[s\], oldest first.
    pub fn deliver(&mut self, time: f64) -> Option<FeatureFrame> {
        self.stream.deliver(time)
    }

    /// The measured pixel of a point \[px\]; `None` if it is not tracked in this frame.
    fn measure(&mut self, point: &BodyPoint, X_CB: &Pose) -> Option<[f64; 2]> {
        let config = &self.config;
        let random = &mut self.stream.random;
        let noise = [(); 2].map(|()| -> f64 { random.sample(StandardNormal) });
        let [outlier, loss, u, v] = [(); 4].map(|()| random.random::<f64>());
        let p_C = X_CB.rotation * point.p_B + X_CB.translation.vector;
        let faces_away = (X_CB.rotation * point.normal_B).dot(&p_C) >= 0.0;
        if loss < config.losses || (config.occlusion && faces_away) {
            return None;
        }
        let size = config.size.map(f64::from);
        let [mut x, mut y] = config.pinhole.project(&p_C)?;
        if let Some(lens) = &self.lens {
            let [a, b] = lens.0([p_C.x / p_C.z, p_C.y / p_C.z]);
            [x, y] = config.pinhole.project(&Vector3::new(a, b, 1.0))?;
        }
        let mut pixel = if outlier < config.outliers {
            [u * size[0] - 0.5, v * size[1] - 0.5]
        } else {
            [x + config.noise * noise[0], y + config.noise * noise[1]]
        };
        let inside = (0..2).all(|i| (-0.5..size[i] - 0.5).contains(&pixel[i]));
        if config.quantised {
            pixel = pixel.map(|x| (x + 0.5).floor());
        }
        inside.then_some(pixel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Translation3};

    /// A ball of 0.9 m at 0.9 m, as in ch. 3, that turns about y at 1 rad/s; frames at 10 Hz.
    fn watch(config: FeatureCameraConfig, count: u32) -> Vec<FeatureFrame> {
        let mut camera = FeatureCamera::new(config, BodyPoint::on_sphere(20, 0.45, 7));
        let mut delivered = Vec::new();
        for k in 0..count {
            let time = 0.1 * f64::from(k);
            let turned = Rotation3::new(Vector3::new(0.0, time, 0.0));
            camera.show(
                time,
                &Pose::from_parts(Translation3::new(0.0, 0.0, 0.9), turned),
            );
            while let Some(frame) = camera.deliver(time) {
                delivered.push(frame);
            }
        }
        delivered
    }

    fn ideal() -> FeatureCameraConfig {
        FeatureCameraConfig::ideal(1024, 1.25)
    }

    /// Differences of each feature from the ideal camera's, by id \[px\].
    fn deviations(config: FeatureCameraConfig, frames: u32) -> Vec<[f64; 2]> {
        let exact = watch(ideal(), frames);
        let measured = watch(config, frames);
        assert_eq!(exact.len(), measured.len());
        let pairs = exact.iter().zip(&measured).flat_map(|(a, b)| a.common(b));
        pairs.map(|(a, b)| [b.u - a.u, b.v - a.v]).collect()
    }

    #[test]
    fn an_ideal_camera_tracks_every_point_at_every_time() {
        let frames = watch(ideal(), 50);
        assert_eq!(frames.len(), 50);
        assert!(frames.iter().all(|s| s.features.len() == 20));
        let ids = |s: &FeatureFrame| s.features.iter().map(|f| f.id).collect::<Vec<_>>();
        assert!(frames.iter().all(|s| ids(s) == (0..20).collect::<Vec<_>>()));
    }

    #[test]
    fn rounding_is_to_the_nearest_pixel() {
        let quantised = FeatureCameraConfig {
            quantised: true,
            ..ideal()
        };
        let off: Vec<_> = deviations(quantised, 100).concat();
        assert_eq!(off.len(), 4000);
        assert!(off.iter().all(|d| d.abs() <= 0.5));
        let rms = (off.iter().map(|d| d * d).sum::<f64>() / off.len() as f64).sqrt();
        assert!((rms - 1.0 / 12f64.sqrt()).abs() < 0.01, "{rms}");
    }

    #[test]
    fn noise_and_outliers_have_the_stated_size_and_repeat() {
        let noisy = FeatureCameraConfig {
            noise: 0.4,
            outliers: 0.1,
            ..ideal()
        };
        let off = deviations(noisy.clone(), 300);
        let is_near = |d: &&[f64; 2]| d[0].hypot(d[1]) < 3.0;
        let (near, far): (Vec<&[f64; 2]>, Vec<_>) = off.iter().partition(is_near);
        let share = far.len() as f64 / off.len() as f64;
        assert!((share - 0.1).abs() < 0.012, "{share}");
        let rms = (near.iter().map(|d| d[0] * d[0]).sum::<f64>() / near.len() as f64).sqrt();
        assert!((rms - 0.4).abs() < 0.02, "{rms}");
        assert_eq!(watch(noisy.clone(), 30), watch(noisy, 30));
    }

    #[test]
    fn hidden_points_return_under_new_ids() {
        let occluded = FeatureCameraConfig {
            occlusion: true,
            ..ideal()
        };
        // Two turns.
        let frames = watch(occluded, 126);
        let tracked: usize = frames.iter().map(|s| s.features.len()).sum();
        // From a diameter's distance a quarter of a sphere faces the camera: (1 - r/d) / 2.
        let share = tracked as f64 / (126.0 * 20.0);
        assert!((0.18..0.32).contains(&share), "{share}");
        let last = frames.iter().flat_map(|s| &s.features).map(|f| f.id).max();
        assert!(last > Some(25), "{last:?}");
        // No id disappears for a while.
        for id in 0..=last.unwrap() {
            let present: Vec<_> = (0..126)
                .filter(|i| frames[*i].feature(id).is_some())
                .collect();
            assert_eq!(
                present.len(),
                present[present.len() - 1] - present[0] + 1,
                "{id}"
            );
        }
    }

    #[test]
    fn lost_tracks_and_lost_frames_have_the_stated_share() {
        let flawed = FeatureCameraConfig {
            losses: 0.05,
            dropout: 0.3,
            ..ideal()
        };
        let frames = watch(flawed, 1000);
        assert!((650..750).contains(&frames.len()), "{}", frames.len());
        let tracked: usize = frames.iter().map(|s| s.features.len()).sum();
        let share = tracked as f64 / (frames.len() as f64 * 20.0);
        assert!((share - 0.95).abs() < 0.01, "{share}");
    }

    #[test]
    fn a_lens_moves_features_in_the_image() {
        let points = BodyPoint::on_sphere(5, 0.45, 7);
        let X_CB = Translation3::new(0.0, 0.0, 0.9) * Pose::identity();
        let mut seen = [ideal(), ideal()].map(|config| FeatureCamera::new(config, points.clone()));
        let [plain, lens] = &mut seen;
        *lens = FeatureCamera::new(ideal(), points).with_lens(|[x, y]| [0.9 * x, y + 0.01]);
        plain.show(0.0, &X_CB);
        lens.show(0.0, &X_CB);
        let (plain, lens) = (plain.deliver(0.0).unwrap(), lens.deliver(0.0).unwrap());
        let focal_length = 1024.0 / 1.25;
        for (a, b) in plain.common(&lens) {
            assert!((b.u - 511.5 - 0.9 * (a.u - 511.5)).abs() < 1e-9);
            assert!((b.v - a.v - 0.01 * focal_length).abs() < 1e-9);
        }
    }

    #[test]
    fn rate_and_latency_are_kept() {
        let slow = FeatureCameraConfig {
            rate: 5.0,
            latency: 0.25,
            ..ideal()
        };
        let frames = watch(slow, 101);
        // 51 exposures in 10 s, less the two not yet delivered at its end.
        assert_eq!(frames.len(), 49);
        assert!((frames[1].time - 0.2).abs() < 1e-9);
    }

    #[test]
    fn vertices_face_away_from_their_mean() {
        let corner = |i: usize| {
            let sign = |bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
            Vector3::new(2.0 + sign(1), sign(2), sign(4))
        };
        let points = BodyPoint::of_vertices(&[0, 1, 2, 3, 4, 5, 6, 7].map(corner));
        let expected = Vector3::new(1.0, -1.0, 1.0).normalize();
        assert!((points[5].normal_B.into_inner() - expected).norm() < 1e-15);
    }
}
