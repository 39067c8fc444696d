//! A camera that measures the poses of the arm tip and of its goal, with the errors of a real camera.

use nalgebra::{Rotation3, Translation3, Vector3};
use rand::RngExt;
use rand_distr::StandardNormal;

use super::frame_stream::{FrameStream, StreamConfig};
use crate::spatial::Pose;

/// Accuracy and timing of a [`PoseCamera`]. The default is an ideal camera: a frame at every time shown, delivered at
/// once, without noise.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseCameraConfig {
    /// Frames per second \[Hz\]; zero means a frame at every time shown.
    pub rate: f64,
    /// Delay from exposure to delivery \[s\].
    pub latency: f64,
    /// Standard deviation of each coordinate of a position \[m\].
    pub position_noise: f64,
    /// Standard deviation of each component of the small rotation added to an attitude \[rad\].
    pub attitude_noise: f64,
    /// Probability that a frame is lost, in [0, 1].
    pub dropout: f64,
    /// Seed of noise and lost frames.
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

/// Measurement of one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseFrame {
    /// Time of exposure \[s\].
    pub time: f64,
    /// Tip pose in the base frame at the exposure.
    pub X_BE: Pose,
    /// Goal pose in the base frame at the exposure; `None` without a goal.
    pub X_BD: Option<Pose>,
}

/// A camera on the base that measures the poses of the arm's tip and of its goal in the base frame.
///
/// Call [`show`](Self::show) with the true poses at increasing times; [`deliver`](Self::deliver) returns the frames
/// that have arrived, with rate, latency, noise and losses of the camera's [`PoseCameraConfig`].
///
/// ```
/// # #![allow(non_snake_case)]
/// use fuyu_physics::spatial::Pose;
/// use fuyu_physics::vision::{PoseCamera, PoseCameraConfig};
/// use nalgebra::Translation3;
///
/// // 10 Hz, 150 ms late, 1 mm of noise.
/// let mut camera = PoseCamera::new(PoseCameraConfig {
///     rate: 10.0,
///     latency: 0.15,
///     position_noise: 1e-3,
///     ..PoseCameraConfig::default()
/// });
/// let X_BD = Translation3::new(1.0, 0.0, 0.0) * Pose::identity();
/// let mut frames = Vec::new();
/// for k in 0..=100 {
///     let time = 0.01 * f64::from(k);
///     // The tip moves at 0.1 m/s.
///     let X_BE = Translation3::new(0.1 * time, 0.0, 0.0) * Pose::identity();
///     camera.show(time, &X_BE, Some(&X_BD));
///     while let Some(frame) = camera.deliver(time) {
///         assert!(time - frame.time > 0.149);
///         frames.push(frame);
///     }
/// }
/// // Eleven exposures in 1 s; the last two are still on their way.
/// assert_eq!(frames.len(), 9);
/// let error = frames[8].X_BE.translation.x - 0.1 * frames[8].time;
/// assert!(error != 0.0 && error.abs() < 5e-3);
/// ```
#[derive(Debug)]
pub struct PoseCamera {
    config: PoseCameraConfig,
    stream: FrameStream<PoseFrame>,
}

impl PoseCameraConfig {
    fn stream(&self) -> StreamConfig {
        StreamConfig {
            rate: self.rate,
            latency: self.latency,
            dropout: self.dropout,
            seed: self.seed,
        }
    }
}

impl PoseCamera {
    /// A camera that has not been shown anything yet.
    pub fn new(config: PoseCameraConfig) -> Self {
        Self {
            stream: FrameStream::new(config.stream()),
            config,
        }
    }

    /// Accuracy and timing.
    pub fn config(&self) -> &PoseCameraConfig {
        &self.config
    }

    /// Changes accuracy and timing from now on; earlier exposures are still delivered.
    pub fn set_config(&mut self, config: PoseCameraConfig) {
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

    /// Shows the camera the true poses of tip and goal in the base frame at `time` \[s\]; it exposes if a frame is due.
    /// A time that is shown twice is exposed once. When time jumps back (the simulation was restarted), the camera
    /// restarts with the same noise.
    pub fn show(&mut self, time: f64, X_BE: &Pose, X_BD: Option<&Pose>) {
        let Some(exposure) = self.stream.expose(time) else {
            return;
        };
        let X_BE = self.disturb(X_BE);
        // Noise is also drawn without a goal, so that a goal does not change the noise of later frames.
        let measured = self.disturb(X_BD.unwrap_or(&Pose::identity()));
        let X_BD = X_BD.map(|_| measured);
        let frame = PoseFrame { time, X_BE, X_BD };
        self.stream.push(time, frame, exposure);
    }

    /// The next frame whose latency has passed at `time` \[s\], oldest first.
    pub fn deliver(&mut self, time: f64) -> Option<PoseFrame> {
        self.stream.deliver(time)
    }

    fn disturb(&mut self, pose: &Pose) -> Pose {
        let mut normal = || -> f64 { self.stream.random.sample(StandardNormal) };
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
    fn an_ideal_camera_measures_every_state_exactly() {
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
        // 300 exposures in 10 s, less those not yet delivered.
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
    fn a_time_shown_twice_is_exposed_once() {
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
    fn a_restarted_simulation_is_measured_from_its_start() {
        let mut camera = PoseCamera::new(PoseCameraConfig {
            rate: 10.0,
            position_noise: 0.01,
            ..Default::default()
        });
        let tip = Pose::identity();
        let mut run = || {
            let times = (0..=20).map(|k| 0.05 * f64::from(k));
            let frames = times.filter_map(|time| {
                camera.show(time, &tip, None);
                camera.deliver(time)
            });
            frames.collect::<Vec<_>>()
        };
        let first = run();
        assert_eq!(first.len(), 11);
        assert_eq!(run(), first);
    }
}
