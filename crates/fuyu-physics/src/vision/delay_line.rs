//! Frames on their way from exposure to delivery.

use std::collections::VecDeque;

use super::exposure_schedule::SLACK;

/// Frames that are under way, and how many were lost there.
#[derive(Debug)]
pub(super) struct DelayLine<F> {
    /// Each with its time of exposure \[s\].
    waiting: VecDeque<(f64, F)>,
    lost: u64,
}

impl<F> Default for DelayLine<F> {
    fn default() -> Self {
        Self {
            waiting: VecDeque::new(),
            lost: 0,
        }
    }
}

impl<F> DelayLine<F> {
    /// Sends a frame that was exposed at `time` \[s\] on its way, or loses it.
    pub fn send(&mut self, time: f64, frame: F, lost: bool) {
        if lost {
            self.lost += 1;
        } else {
            self.waiting.push_back((time, frame));
        }
    }

    /// The next frame that is at least `latency` \[s\] old at `time` \[s\], oldest first.
    pub fn arrive(&mut self, time: f64, latency: f64) -> Option<F> {
        let (exposed, _) = self.waiting.front()?;
        if exposed + latency > time + SLACK {
            return None;
        }
        self.waiting.pop_front().map(|(_, frame)| frame)
    }

    /// Forgets what is under way.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }

    /// Frames lost so far.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}
