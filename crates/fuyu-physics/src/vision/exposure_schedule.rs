//! Exposure schedule: the times at which a camera takes frames.

/// Tolerance \[s\] when a sum of periods is compared with a time.
pub(super) const SLACK: f64 = 1e-9;

/// Exposures at a constant rate, starting at the first time shown.
#[derive(Debug, Clone, Default)]
pub(super) struct ExposureSchedule {
    /// Index of the next exposure, counted from `start`.
    next: u64,
    /// Time of the first exposure \[s\].
    start: Option<f64>,
    /// The last time shown \[s\].
    last_shown: Option<f64>,
}

/// Whether a time shown to the camera is a time of exposure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Exposure {
    /// No exposure: none is due, or this time was shown before.
    None,
    /// An exposure.
    Due,
    /// The first exposure after time jumped back: another simulation run.
    FirstOfRun,
}

impl ExposureSchedule {
    /// Starts another schedule with the next time shown.
    pub fn restart(&mut self) {
        self.start = None;
    }

    /// Whether an exposure is due at `time` \[s\] with `rate` \[Hz\]; zero exposes at every time shown.
    pub fn is_due(&self, time: f64, rate: f64) -> bool {
        match self.start {
            Some(start) if rate > 0.0 => time >= start + self.next as f64 / rate - SLACK,
            _ => true,
        }
    }

    /// Advances to `time` \[s\].
    pub fn show(&mut self, time: f64, rate: f64) -> Exposure {
        let mut exposure = Exposure::Due;
        match self.last_shown.replace(time) {
            Some(last) if time < last - SLACK => {
                self.start = None;
                exposure = Exposure::FirstOfRun;
            }
            Some(last) if time <= last + SLACK => {
                self.last_shown = Some(last);
                return Exposure::None;
            }
            _ => {}
        }
        if !self.is_due(time, rate) {
            return Exposure::None;
        }
        let start = *self.start.get_or_insert_with(|| {
            self.next = 0;
            time
        });
        // Exposures between two times shown are skipped.
        let passed = ((time - start + SLACK) * rate).floor() as u64;
        self.next = passed.max(self.next) + 1;
        exposure
    }
}
