//! A camera that tracks feature points of a body, with the flaws of a real one.

use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{StandardNormal, UnitSphere};

use super::{Feature, Pinhole, Sighting, shutter::Shutter};
use crate::spatial::Pose;

/// The points of a body that a camera can track.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureBody {
    /// Points and outward directions of the surface there, in the body's frame.
    points: Vec<(Vector3<f64>, Vector3<f64>)>,
}

impl FeatureBody {
    /// `count` points scattered evenly over a sphere of `radius` \[m\] about the body frame's origin, as in
    /// Masutani 1995 section 3.1.
    pub fn sphere(count: usize, radius: f64, seed: u64) -> Self {
        let mut random = StdRng::seed_from_u64(seed);
        let point = |_| {
            let outward = Vector3::from(random.sample::<[f64; 3], _>(UnitSphere));
            (outward * radius, outward)
        };
        Self {
            points: (0..count).map(point).collect(),
        }
    }

    /// Given points in the body's frame \[m\]. The surface at each is taken to face away from their middle,
    /// which is so for a convex body.
    pub fn vertices(points: &[Vector3<f64>]) -> Self {
        let middle = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
        let outward = |p: &Vector3<f64>| (p - middle).try_normalize(0.0).unwrap_or_default();
        Self {
            points: points.iter().map(|p| (*p, outward(p))).collect(),
        }
    }

    /// The points in the body's frame \[m\].
    pub fn points(&self) -> impl Iterator<Item = &Vector3<f64>> {
        self.points.iter().map(|(point, _)| point)
    }
}

/// How good the camera and its tracker are. Its default is an ideal one: every instant that it is shown, at
/// once, exactly, and through the body.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FeatureCameraConfig {
    /// Frames per second \[Hz\]; zero means a frame at every instant shown.
    pub rate: f64,
    /// Delay from exposure to delivery \[s\].
    pub latency: f64,
    /// Probability that a frame is lost, in [0, 1].
    pub dropout: f64,
    /// Standard deviation of each coordinate \[px\], before it is rounded.
    pub noise: f64,
    /// Coordinates are rounded to multiples of this \[px\]; zero is not at all, 1 is whole pixels.
    pub quantisation: f64,
    /// Whether the body hides its far side. Masutani 1995, chapter 3, assumes that it does not.
    pub occlusion: bool,
    /// Probability that a feature is found somewhere else in the image, in [0, 1].
    pub outliers: f64,
    /// Probability that a feature's track ends at a frame, in [0, 1]. The feature comes back in the next
    /// frame as a new one.
    pub loss: f64,
    /// Seed of all that is random.
    pub seed: u64,
}

/// The camera: shown the truth at successive instants, it delivers frames.
///
/// A point that was out of sight (hidden, outside the image, lost by the tracker) comes back under a new
/// id, as from any tracker that does not recognise what it saw before. A frame that is lost as a whole
/// changes no id.
#[derive(Debug)]
pub struct FeatureCamera {
    config: FeatureCameraConfig,
    camera: Pinhole,
    /// Width and height \[px\].
    size: (u32, u32),
    random: StdRng,
    shutter: Shutter<Sighting>,
    /// What the tracker calls each point; `None` out of sight.
    ids: Vec<Option<u64>>,
    next_id: u64,
    lost: u64,
}

impl FeatureCamera {
    /// A camera with an image of `size` (width, height) pixels.
    pub fn new(config: FeatureCameraConfig, camera: Pinhole, size: (u32, u32)) -> Self {
        let random = StdRng::seed_from_u64(config.seed);
        Self {
            config,
            camera,
            size,
            random,
            shutter: Shutter::new(),
            ids: Vec::new(),
            next_id: 0,
            lost: 0,
        }
    }

    /// Changes how good it is from now on; frames under way are kept.
    pub fn set_config(&mut self, config: FeatureCameraConfig) {
        if config.seed != self.config.seed {
            self.random = StdRng::seed_from_u64(config.seed);
        }
        if config.rate != self.config.rate {
            self.shutter.restart();
        }
        self.config = config;
    }

    /// Frames lost so far.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Shows the camera `body` at pose `X_CB` in its optical frame at `time` \[s\]; it exposes if a frame is
    /// due. An instant that is shown again is not exposed again; when time runs backwards (a simulation
    /// began anew) so does the camera.
    pub fn show(&mut self, time: f64, X_CB: &Pose, body: &FeatureBody) {
        if !self.shutter.opens(time, self.config.rate) {
            return;
        }
        let lost = self.random.random::<f64>() < self.config.dropout;
        self.ids.resize(body.points.len(), None);
        let mut features = Vec::with_capacity(body.points.len());
        for (index, point) in body.points.iter().enumerate() {
            let seen = self.look(X_CB, point);
            let id = match (&seen, self.ids[index]) {
                (None, _) => None,
                (Some(_), Some(id)) => Some(id),
                (Some(_), None) => {
                    self.next_id += 1;
                    Some(self.next_id - 1)
                }
            };
            self.ids[index] = id;
            if let (Some([u, v]), Some(id)) = (seen, id) {
                features.push(Feature { id, u, v });
            }
        }
        if lost {
            self.lost += 1;
        } else {
            self.shutter.send(time, Sighting::new(time, features));
        }
    }

    /// The next frame whose latency has passed at `time` \[s\], oldest first.
    pub fn deliver(&mut self, time: f64) -> Option<Sighting> {
        self.shutter.deliver(time, self.config.latency)
    }

    /// Where the tracker finds a point. Takes the same number of random draws whatever it finds, so that
    /// what is in sight does not change the noise of the rest.
    fn look(
        &mut self,
        X_CB: &Pose,
        (p_B, outward_B): &(Vector3<f64>, Vector3<f64>),
    ) -> Option<[f64; 2]> {
        let config = &self.config;
        let mut normal = || self.random.sample::<f64, _>(StandardNormal);
        let noise = [normal(), normal()].map(|n| n * config.noise);
        let mut chance = || self.random.random::<f64>();
        let (tracked, found) = (chance() >= config.loss, chance() >= config.outliers);
        let (width, height) = (f64::from(self.size.0), f64::from(self.size.1));
        let elsewhere = [chance() * width - 0.5, chance() * height - 0.5];
        let p_C = (X_CB * Point3::from(*p_B)).coords;
        let hidden = config.occlusion && (X_CB.rotation * outward_B).dot(&p_C) >= 0.0;
        let [u, v] = self.camera.project(&p_C).filter(|_| tracked && !hidden)?;
        let pixel = if found {
            [u + noise[0], v + noise[1]]
        } else {
            elsewhere
        };
        let pixel = pixel.map(|x| match config.quantisation {
            step if step > 0.0 => (x / step).round() * step,
            _ => x,
        });
        let inside = |x: f64, size: f64| (-0.5..=size - 0.5).contains(&x);
        (inside(pixel[0], width) && inside(pixel[1], height)).then_some(pixel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Translation3};

    const SIZE: (u32, u32) = (1024, 1024);

    /// Frames of a sphere of 50 points that turns about the vertical once in 20 s, at 10 Hz for 40 s.
    fn run(config: FeatureCameraConfig) -> Vec<(f64, Sighting)> {
        let body = FeatureBody::sphere(50, 1.0, 3);
        let mut camera = FeatureCamera::new(config, Pinhole::square(1024, 1.0), SIZE);
        let mut delivered = Vec::new();
        for k in 0..400 {
            let time = 0.1 * f64::from(k);
            let turned =
                Rotation3::from_axis_angle(&Vector3::y_axis(), time * 0.1 * std::f64::consts::PI);
            camera.show(
                time,
                &Pose::from_parts(Translation3::new(0.0, 0.0, 4.0), turned),
                &body,
            );
            while let Some(frame) = camera.deliver(time) {
                delivered.push((time, frame));
            }
        }
        delivered
    }

    #[test]
    fn an_ideal_camera_keeps_every_point_and_its_id() {
        let frames = run(FeatureCameraConfig::default());
        assert_eq!(frames.len(), 400);
        let ids: Vec<_> = (0..50).collect();
        for (time, frame) in &frames {
            assert_eq!(frame.time, *time);
            assert!(frame.features.iter().map(|f| f.id).eq(ids.iter().copied()));
        }
        // A full turn later every point is where it was.
        for (a, b) in frames[0].1.common(&frames[200].1) {
            assert!((a.u - b.u).hypot(a.v - b.v) < 1e-9);
        }
    }

    #[test]
    fn pixels_are_rounded_and_noisy_as_told() {
        let exact = run(FeatureCameraConfig::default());
        let deviation = |config| {
            let frames = run(config);
            let pairs = exact
                .iter()
                .zip(&frames)
                .flat_map(|((_, a), (_, b))| a.common(b));
            let squares: Vec<_> = pairs.map(|(a, b)| (a.u - b.u).powi(2)).collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
        };
        let rounded = deviation(FeatureCameraConfig {
            quantisation: 1.0,
            ..Default::default()
        });
        assert!(
            (rounded / (1.0 / 12f64.sqrt()) - 1.0).abs() < 0.03,
            "{rounded}"
        );
        let noisy = deviation(FeatureCameraConfig {
            noise: 0.7,
            ..Default::default()
        });
        assert!((noisy / 0.7 - 1.0).abs() < 0.03, "{noisy}");
        let whole = run(FeatureCameraConfig {
            quantisation: 1.0,
            noise: 0.3,
            ..Default::default()
        });
        assert!(
            whole
                .iter()
                .all(|(_, s)| s.features.iter().all(|f| f.u.fract() == 0.0))
        );
    }

    #[test]
    fn the_far_side_is_hidden_and_comes_back_as_new_points() {
        let frames = run(FeatureCameraConfig {
            occlusion: true,
            ..Default::default()
        });
        // A sphere at 4 radii shows 3/8 of its surface.
        let mean = frames.iter().map(|(_, s)| s.features.len()).sum::<usize>() as f64 / 400.0;
        assert!((mean / 50.0 - 0.375).abs() < 0.05, "{mean}");
        let first = frames[0].1.features[0].id;
        assert!(frames[200].1.feature(first).is_none(), "an id came back");
    }

    #[test]
    fn tracks_break_as_often_as_told() {
        let frames = run(FeatureCameraConfig {
            loss: 0.02,
            ..Default::default()
        });
        let seen = frames.iter().map(|(_, s)| s.features.len()).sum::<usize>();
        assert!((seen as f64 / 20_000.0 - 0.98).abs() < 0.005, "{seen}");
        let features = frames.iter().flat_map(|(_, s)| &s.features);
        let newest = features.map(|f| f.id).max().unwrap();
        // 50 points, and each of some 400 losses makes a new one.
        assert!((390..510).contains(&newest), "{newest}");
    }

    #[test]
    fn outliers_come_as_often_as_told() {
        let exact = run(FeatureCameraConfig::default());
        let frames = run(FeatureCameraConfig {
            outliers: 0.1,
            ..Default::default()
        });
        let pairs = exact
            .iter()
            .zip(&frames)
            .flat_map(|((_, a), (_, b))| a.common(b));
        let wrong = pairs.filter(|(a, b)| (a.u - b.u).hypot(a.v - b.v) > 1.0);
        let part = wrong.count() as f64 / 20_000.0;
        assert!((part - 0.1).abs() < 0.01, "{part}");
    }

    #[test]
    fn frames_are_lost_without_a_change_of_ids() {
        let config = FeatureCameraConfig {
            dropout: 0.3,
            latency: 0.15,
            rate: 5.0,
            seed: 9,
            ..Default::default()
        };
        let frames = run(config.clone());
        assert!((110..170).contains(&frames.len()), "{}", frames.len());
        assert!(
            frames
                .iter()
                .all(|(t, s)| s.features.len() == 50 && (t - s.time - 0.2).abs() < 1e-9)
        );
        assert!(
            frames
                .iter()
                .all(|(_, s)| s.features.iter().all(|f| f.id < 50))
        );
        assert_eq!(frames, run(config));
    }

    #[test]
    fn what_is_behind_or_beside_the_image_is_not_seen() {
        let body =
            FeatureBody::vertices(&[Vector3::zeros(), Vector3::x(), Vector3::new(0.0, 0.0, -9.0)]);
        let mut camera = FeatureCamera::new(
            FeatureCameraConfig::default(),
            Pinhole::square(100, 0.4),
            (100, 100),
        );
        let X_CB = Pose::from_parts(Translation3::new(0.0, 0.0, 3.0), Rotation3::identity());
        camera.show(0.0, &X_CB, &body);
        let seen = camera.deliver(0.0).unwrap();
        assert_eq!(seen.features.len(), 1, "{seen:?}");
        assert_eq!((seen.features[0].u, seen.features[0].v), (49.5, 49.5));
    }
}
