//! Delay line: holds the frames of a camera from exposure to delivery.

use std::collections::VecDeque;

use super::exposure_schedule::SLACK;

/// A queue that delivers each frame a given time after its exposure, and counts the frames that were lost.
#[derive(Debug)]
pub(super) struct DelayLine<F> {
    /// Frames with their times of exposure \[s\], oldest first.
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
    /// Adds a frame that was exposed at `time` \[s\], or only counts it if it is lost.
    pub fn push(&mut self, time: f64, frame: F, lost: bool) {
        if lost {
            self.lost += 1;
        } else {
            self.waiting.push_back((time, frame));
        }
    }

    /// The oldest frame that is at least `latency` \[s\] old at `time` \[s\].
    pub fn pop(&mut self, time: f64, latency: f64) -> Option<F> {
        let (exposed, _) = self.waiting.front()?;
        if exposed + latency > time + SLACK {
            return None;
        }
        self.waiting.pop_front().map(|(_, frame)| frame)
    }

    /// Drops the frames that wait.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }

    /// Frames lost so far.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}
