//! When a camera exposes, and how long its frames are under way.

use std::collections::VecDeque;

/// Slack \[s\] when a sum of periods is compared with a time.
const SLACK: f64 = 1e-9;

/// The shutter of a camera that is shown the truth at successive instants, and the frames under way.
#[derive(Debug)]
pub(super) struct Shutter<T> {
    /// Index of the next exposure on the grid of exposure times.
    next: u64,
    /// When the grid of exposure times begins \[s\].
    start: Option<f64>,
    /// The last instant shown \[s\].
    last_shown: Option<f64>,
    /// Frames under way with their times of exposure \[s\].
    waiting: VecDeque<(f64, T)>,
}

impl<T> Shutter<T> {
    pub(super) fn new() -> Self {
        Self {
            next: 0,
            start: None,
            last_shown: None,
            waiting: VecDeque::new(),
        }
    }

    /// Begins a new grid of exposure times with the next instant shown.
    pub(super) fn restart(&mut self) {
        self.start = None;
    }

    /// Whether an exposure is due at `time` \[s\], at `rate` frames per second; zero is a frame at every
    /// instant shown.
    pub(super) fn is_due(&self, time: f64, rate: f64) -> bool {
        match self.start {
            Some(start) if rate > 0.0 => time >= start + self.next as f64 / rate - SLACK,
            _ => true,
        }
    }

    /// Whether the camera exposes at `time` \[s\]. An instant that is shown again is not exposed again;
    /// when time runs backwards (a simulation began anew) so do the exposures, and what was under way is
    /// gone.
    pub(super) fn opens(&mut self, time: f64, rate: f64) -> bool {
        match self.last_shown.replace(time) {
            Some(last) if time < last - SLACK => {
                self.waiting.clear();
                self.start = None;
            }
            Some(last) if time <= last + SLACK => {
                self.last_shown = Some(last);
                return false;
            }
            _ => {}
        }
        if !self.is_due(time, rate) {
            return false;
        }
        let start = *self.start.get_or_insert_with(|| {
            self.next = 0;
            time
        });
        // Exposures that no one showed are gone.
        let shown = ((time - start + SLACK) * rate).floor() as u64;
        self.next = shown.max(self.next) + 1;
        true
    }

    /// Sends a frame on its way.
    pub(super) fn send(&mut self, time: f64, frame: T) {
        self.waiting.push_back((time, frame));
    }

    /// The next frame whose `latency` \[s\] has passed at `time` \[s\], oldest first.
    pub(super) fn deliver(&mut self, time: f64, latency: f64) -> Option<T> {
        let (exposed, _) = self.waiting.front()?;
        if exposed + latency > time + SLACK {
            return None;
        }
        self.waiting.pop_front().map(|(_, frame)| frame)
    }
}
