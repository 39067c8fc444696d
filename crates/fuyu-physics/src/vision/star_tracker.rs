//! A star tracker: measures attitude in inertial space, with rate, noise and latency.

use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt;
use rand_distr::StandardNormal;

use super::frame_stream::{FrameStream, StreamConfig};
use crate::spatial::exp_so3;

/// Accuracy and timing of a [`StarTracker`]. The default is an ideal one: an attitude at every time shown, at once.
#[derive(Debug, Clone, PartialEq)]
pub struct StarTrackerConfig {
    /// Attitudes per second \[Hz\]; zero means one at every time shown.
    pub rate: f64,
    /// Delay from exposure to delivery \[s\].
    pub latency: f64,
    /// Standard deviation of each component of the added small rotation, base axes \[rad\].
    pub noise: f64,
    /// Probability that an attitude is lost, in [0, 1].
    pub dropout: f64,
    /// Seed of noise and lost attitudes.
    pub seed: u64,
}

impl Default for StarTrackerConfig {
    fn default() -> Self {
        Self {
            rate: 0.0,
            latency: 0.0,
            noise: 0.0,
            dropout: 0.0,
            seed: 1,
        }
    }
}

/// Measurement of one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarTrackerFrame {
    /// Time of exposure \[s\].
    pub time: f64,
    /// Attitude of the base in the world at the exposure.
    pub R_WB: UnitQuaternion<f64>,
}

/// A star tracker on the base.
///
/// Call [`show`](Self::show) with the true attitude at increasing times; [`deliver`](Self::deliver) returns the
/// attitudes that have arrived.
///
/// ```
/// # #![allow(non_snake_case)]
/// use fuyu_physics::vision::{StarTracker, StarTrackerConfig};
/// use nalgebra::{UnitQuaternion, Vector3};
///
/// let mut tracker = StarTracker::new(StarTrackerConfig {
///     rate: 4.0,
///     latency: 0.2,
///     noise: 5e-5,
///     ..StarTrackerConfig::default()
/// });
/// let mut frames = Vec::new();
/// for k in 0..=100 {
///     let time = 0.01 * f64::from(k);
///     let R_WB = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.01 * time);
///     tracker.show(time, &R_WB);
///     while let Some(frame) = tracker.deliver(time) {
///         assert!(time - frame.time > 0.199);
///         frames.push(frame);
///     }
/// }
/// // Exposures at 0, .25, .5, .75 and 1 s; the last is still on its way.
/// assert_eq!(frames.len(), 4);
/// let error = frames[3].R_WB.scaled_axis().z - 0.01 * frames[3].time;
/// assert!(error != 0.0 && error.abs() < 2.5e-4);
/// ```
#[derive(Debug)]
pub struct StarTracker {
    config: StarTrackerConfig,
    stream: FrameStream<StarTrackerFrame>,
}

impl StarTrackerConfig {
    fn stream(&self) -> StreamConfig {
        StreamConfig {
            rate: self.rate,
            latency: self.latency,
            dropout: self.dropout,
            seed: self.seed,
        }
    }
}

impl StarTracker {
    /// A star tracker that has not been shown anything yet.
    pub fn new(config: StarTrackerConfig) -> Self {
        Self {
            stream: FrameStream::new(config.stream()),
            config,
        }
    }

    /// Accuracy and timing.
    pub fn config(&self) -> &StarTrackerConfig {
        &self.config
    }

    /// Changes accuracy and timing from now on; earlier exposures are still delivered.
    pub fn set_config(&mut self, config: StarTrackerConfig) {
        self.stream.set_config(config.stream());
        self.config = config;
    }

    /// Whether an exposure is due at `time` \[s\].
    pub fn is_due(&self, time: f64) -> bool {
        self.stream.is_due(time)
    }

    /// Shows the star tracker the true attitude at `time` \[s\]; it exposes if an attitude is due. A time that is shown
    /// twice is exposed once. When time jumps back (the simulation was restarted), the star tracker restarts with the
    /// same noise.
    pub fn show(&mut self, time: f64, R_WB: &UnitQuaternion<f64>) {
        let Some(exposure) = self.stream.expose(time) else {
            return;
        };
        let mut normal = || self.stream.random.sample::<f64, _>(StandardNormal);
        let error = Vector3::new(normal(), normal(), normal()) * self.config.noise;
        let R_WB = R_WB * exp_so3(&error);
        self.stream
            .push(time, StarTrackerFrame { time, R_WB }, exposure);
    }

    /// The next attitude whose latency has passed at `time` \[s\], oldest first.
    pub fn deliver(&mut self, time: f64) -> Option<StarTrackerFrame> {
        self.stream.deliver(time)
    }
}
