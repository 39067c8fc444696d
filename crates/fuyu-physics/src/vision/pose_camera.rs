//! A camera that measures the poses of the arm tip and of the goal object, with the flaws of a real one.

use nalgebra::{Rotation3, Translation3, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::exposure_schedule::{Instant, ExposureSchedule};
use super::delay_line::DelayLine;
use crate::spatial::Pose;

/// How good the camera is. All zero is an ideal one: every instant that it is shown, at once, exactly.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseCameraConfig {
    /// Frames per second \[Hz\]; zero means a frame at every instant shown.
    pub rate: f64,
    /// Delay from exposure to delivery \[s\].
    pub latency: f64,
    /// Standard deviation of each coordinate of a position \[m\].
    pub position_noise: f64,
    /// Standard deviation of each component of the small rotation added to an attitude \[rad\].
    pub attitude_noise: f64,
    /// Probability that a frame is lost, in [0, 1].
    pub dropout: f64,
    /// Seed of the noise and the losses.
    pub seed: u64,
}

impl Default for PoseCameraConfig {
    fn default() -> Self {
        Self {
            rate: 0.0,
            latency: 0.0,
            position_noise: 0.0,
            attitude_noise: 0.0,
            dropout: 0.0,
            seed: 1,
        }
    }
}

/// What one exposure saw, in the base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseFrame {
    /// Time of exposure \[s\].
    pub time: f64,
    /// Tip pose in the base frame at that time.
    pub X_BE: Pose,
    /// Goal pose in the base frame at that time; `None` while there is no goal.
    pub X_BD: Option<Pose>,
}

/// The camera: shown the truth at successive instants, it delivers frames.
#[derive(Debug)]
pub struct PoseCamera {
    config: PoseCameraConfig,
    random: StdRng,
    shutter: ExposureSchedule,
    transit: DelayLine<PoseFrame>,
}

impl PoseCamera {
    /// A camera.
    pub fn new(config: PoseCameraConfig) -> Self {
        let random = StdRng::seed_from_u64(config.seed);
        Self {
            config,
            random,
            shutter: ExposureSchedule::default(),
            transit: DelayLine::default(),
        }
    }

    /// How good it is.
    pub fn config(&self) -> &PoseCameraConfig {
        &self.config
    }

    /// Changes how good it is from now on; frames under way are kept.
    pub fn set_config(&mut self, config: PoseCameraConfig) {
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
        self.transit.lost()
    }

    /// Whether an exposure is due at `time` \[s\].
    pub fn is_due(&self, time: f64) -> bool {
        self.shutter.is_due(time, self.config.rate)
    }

    /// Shows the camera the truth at `time` \[s\]; it exposes if a frame is due. An instant that is shown
    /// again is not exposed again; when time runs backwards (a simulation began anew) so does the camera, its noise included.
    pub fn show(&mut self, time: f64, X_BE: &Pose, X_BD: Option<&Pose>) {
        match self.shutter.show(time, self.config.rate) {
            Instant::Idle => return,
            Instant::Anew => {
                self.transit.clear();
                self.random = StdRng::seed_from_u64(self.config.seed);
            }
            Instant::Exposure => {}
        }
        // The same number of random draws a frame, so that neither a loss nor a goal that is not there
        // changes the noise of later frames.
        let lost = self.random.random::<f64>() < self.config.dropout;
        let X_BE = self.disturb(X_BE);
        let seen_goal = self.disturb(X_BD.unwrap_or(&Pose::identity()));
        let X_BD = X_BD.map(|_| seen_goal);
        let frame = PoseFrame { time, X_BE, X_BD };
        self.transit.send(time, frame, lost);
    }

    /// The next frame whose latency has passed at `time` \[s\], oldest first.
    pub fn deliver(&mut self, time: f64) -> Option<PoseFrame> {
        self.transit.arrive(time, self.config.latency)
    }

    fn disturb(&mut self, pose: &Pose) -> Pose {
        let mut normal = || -> f64 { self.random.sample(StandardNormal) };
        let shift = Vector3::new(normal(), normal(), normal()) * self.config.position_noise;
        let turn = Vector3::new(normal(), normal(), normal()) * self.config.attitude_noise;
        if shift == Vector3::zeros() && turn == Vector3::zeros() {
            return *pose;
        }
        Pose::from_parts(
            Translation3::from(pose.translation.vector + shift),
            Rotation3::new(turn) * pose.rotation,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(config: PoseCameraConfig, seconds: f64) -> Vec<(f64, PoseFrame)> {
        let mut camera = PoseCamera::new(config);
        let mut delivered = Vec::new();
        for k in 0..(seconds * 100.0) as u32 {
            let time = f64::from(k) * 0.01;
            let tip = Pose::from_parts(Translation3::new(time, 0.0, 0.0), Rotation3::identity());
            camera.show(time, &tip, None);
            while let Some(frame) = camera.deliver(time) {
                delivered.push((time, frame));
            }
        }
        delivered
    }

    #[test]
    fn an_ideal_camera_sees_every_instant_exactly() {
        let frames = run(PoseCameraConfig::default(), 1.0);
        assert_eq!(frames.len(), 100);
        assert!(
            frames
                .iter()
                .all(|(t, f)| f.time == *t && f.X_BE.translation.x == *t)
        );
    }

    #[test]
    fn rate_and_latency_are_kept() {
        let frames = run(
            PoseCameraConfig {
                rate: 30.0,
                latency: 0.15,
                ..Default::default()
            },
            10.0,
        );
        // 300 exposures in 10 s, less those still under way.
        assert!((294..=296).contains(&frames.len()), "{}", frames.len());
        assert!(
            frames
                .iter()
                .all(|(t, f)| (0.15..0.161).contains(&(t - f.time + 1e-9)))
        );
    }

    #[test]
    fn noise_and_losses_have_the_stated_size_and_repeat() {
        let config = PoseCameraConfig {
            position_noise: 0.01,
            dropout: 0.3,
            ..Default::default()
        };
        let frames = run(config.clone(), 200.0);
        let kept = frames.len() as f64 / 20_000.0;
        assert!((kept - 0.7).abs() < 0.015, "{kept}");
        let variance = frames
            .iter()
            .map(|(_, f)| (f.X_BE.translation.x - f.time).powi(2))
            .sum::<f64>()
            / frames.len() as f64;
        assert!((variance.sqrt() - 0.01).abs() < 3e-4, "{}", variance.sqrt());
        assert_eq!(frames, run(config, 200.0));
    }

    #[test]
    fn an_instant_shown_again_is_not_exposed_again() {
        let noisy = PoseCameraConfig {
            position_noise: 0.01,
            ..Default::default()
        };
        let tip = Pose::identity();
        let frames = |repeats: usize| {
            let mut camera = PoseCamera::new(noisy.clone());
            let mut delivered = Vec::new();
            for k in 0..5 {
                for _ in 0..=repeats {
                    camera.show(0.1 * f64::from(k), &tip, Some(&tip));
                }
                while let Some(frame) = camera.deliver(0.1 * f64::from(k)) {
                    delivered.push(frame);
                }
            }
            delivered
        };
        assert_eq!(frames(0), frames(3));
    }

    #[test]
    fn a_simulation_that_begins_anew_is_seen_from_its_start() {
        let mut camera = PoseCamera::new(PoseCameraConfig {
            rate: 10.0,
            position_noise: 0.01,
            ..Default::default()
        });
        let tip = Pose::identity();
        let mut run = || {
            let times = (0..=20).map(|k| 0.05 * f64::from(k));
            let seen = times.filter_map(|time| {
                camera.show(time, &tip, None);
                camera.deliver(time)
            });
            seen.collect::<Vec<_>>()
        };
        let first = run();
        assert_eq!(first.len(), 11);
        assert_eq!(run(), first);
    }
}
