//! When a camera exposes.

/// Slack \[s\] when a sum of periods is compared with a time.
pub(super) const SLACK: f64 = 1e-9;

/// Exposures on a grid of times that begins with the first instant shown.
#[derive(Debug, Clone, Default)]
pub(super) struct ExposureSchedule {
    /// Index of the next exposure on the grid.
    next: u64,
    /// When the grid begins \[s\].
    start: Option<f64>,
    /// The last instant shown \[s\].
    last_shown: Option<f64>,
}

/// What an instant is to a shutter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Instant {
    /// Between exposures, or shown before.
    Idle,
    /// An exposure.
    Exposure,
    /// An exposure, the first after time ran backwards: a simulation began anew.
    Anew,
}

impl ExposureSchedule {
    /// Begins a new grid with the next instant shown.
    pub fn restart(&mut self) {
        self.start = None;
    }

    /// Whether an exposure is due at `time` \[s\] with `rate` \[Hz\]; zero exposes at every instant.
    pub fn is_due(&self, time: f64, rate: f64) -> bool {
        match self.start {
            Some(start) if rate > 0.0 => time >= start + self.next as f64 / rate - SLACK,
            _ => true,
        }
    }

    /// Shows the shutter the instant `time` \[s\].
    pub fn show(&mut self, time: f64, rate: f64) -> Instant {
        let mut instant = Instant::Exposure;
        match self.last_shown.replace(time) {
            Some(last) if time < last - SLACK => {
                self.start = None;
                instant = Instant::Anew;
            }
            Some(last) if time <= last + SLACK => {
                self.last_shown = Some(last);
                return Instant::Idle;
            }
            _ => {}
        }
        if !self.is_due(time, rate) {
            return Instant::Idle;
        }
        let start = *self.start.get_or_insert_with(|| {
            self.next = 0;
            time
        });
        // Exposures that no one showed are gone.
        let shown = ((time - start + SLACK) * rate).floor() as u64;
        self.next = shown.max(self.next) + 1;
        instant
    }
}
