//! Timing and losses common to all cameras: rate, latency, lost frames, and the random generator of their noise.

use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::delay_line::DelayLine;
use super::exposure_schedule::{Exposure, ExposureSchedule};

/// Settings of a stream of frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamConfig {
    /// Frames per second \[Hz\]; zero means a frame at every time shown.
    pub rate: f64,
    /// Delay from exposure to delivery \[s\].
    pub latency: f64,
    /// Probability that a frame is lost, in [0, 1].
    pub dropout: f64,
    /// Seed of the random generator.
    pub seed: u64,
}

/// Exposure schedule, delay line and random generator of a camera with frames `F`.
#[derive(Debug)]
pub struct FrameStream<F> {
    config: StreamConfig,
    schedule: ExposureSchedule,
    delay_line: DelayLine<F>,
    /// Generator of the camera's noise. A camera must draw the same number of values for every frame, so that no
    /// setting changes the noise of later frames.
    pub random: StdRng,
}

/// An exposure that is due.
#[derive(Debug, Clone, Copy)]
pub struct DueExposure {
    /// Whether this is the first exposure after time jumped back: another simulation run.
    pub first_of_run: bool,
    /// Whether the frame of this exposure is lost.
    pub lost: bool,
}

impl<F> FrameStream<F> {
    /// A stream without frames.
    pub fn new(config: StreamConfig) -> Self {
        Self {
            random: StdRng::seed_from_u64(config.seed),
            schedule: ExposureSchedule::default(),
            delay_line: DelayLine::default(),
            config,
        }
    }

    /// Changes the settings from now on; frames that wait for delivery are kept. A new seed restarts the noise, a new
    /// rate restarts the schedule.
    pub fn set_config(&mut self, config: StreamConfig) {
        if config.seed != self.config.seed {
            self.random = StdRng::seed_from_u64(config.seed);
        }
        if config.rate != self.config.rate {
            self.schedule.restart();
        }
        self.config = config;
    }

    /// Frames lost so far.
    pub fn lost(&self) -> u64 {
        self.delay_line.lost()
    }

    /// Whether an exposure is due at `time` \[s\].
    pub fn is_due(&self, time: f64) -> bool {
        self.schedule.is_due(time, self.config.rate)
    }

    /// The exposure at `time` \[s\], if one is due. If time jumps back, waiting frames are dropped and the noise
    /// restarts.
    pub fn expose(&mut self, time: f64) -> Option<DueExposure> {
        let exposure = self.schedule.show(time, self.config.rate);
        let first_of_run = exposure == Exposure::FirstOfRun;
        if first_of_run {
            self.delay_line.clear();
            self.random = StdRng::seed_from_u64(self.config.seed);
        }
        (exposure != Exposure::None).then(|| DueExposure {
            first_of_run,
            lost: self.random.random::<f64>() < self.config.dropout,
        })
    }

    /// Adds the frame of an exposure at `time` \[s\].
    pub fn push(&mut self, time: f64, frame: F, exposure: DueExposure) {
        self.delay_line.push(time, frame, exposure.lost);
    }

    /// The next frame whose latency has passed at `time` \[s\], oldest first.
    pub fn deliver(&mut self, time: f64) -> Option<F> {
        self.delay_line.pop(time, self.config.latency)
    }
}
