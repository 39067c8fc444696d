//! Frame queue: camera frames wait until a gyro sample of their time or later has arrived.

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

use crate::vision::FeatureFrame;

/// Longest wait of a frame for the gyro. Then the frame is used with the last known attitude.
const LONGEST_WAIT: Duration = Duration::from_millis(500);

/// Frames in order of arrival. The camera's attitude at a frame is known only after a later gyro sample, which may
/// arrive before or after the frame, since the topics differ.
#[derive(Debug, Default)]
pub struct FrameQueue(VecDeque<(FeatureFrame, Instant)>);

impl FrameQueue {
    /// Adds a frame that arrived at `now`.
    pub fn push(&mut self, frame: FeatureFrame, now: Instant) {
        self.0.push_back((frame, now));
    }

    /// Removes the oldest frame if its wait is over. `gyro_until` is the stamp of the newest gyro sample \[s\]; without
    /// a gyro, frames do not wait.
    pub fn pop(&mut self, gyro_until: Option<f64>, now: Instant) -> Option<FeatureFrame> {
        let (frame, arrived) = self.0.front()?;
        let known = gyro_until.is_none_or(|until| frame.time <= until);
        if !known && now.duration_since(*arrived) < LONGEST_WAIT {
            return None;
        }
        self.0.pop_front().map(|(frame, _)| frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn queue(times: &[f64], now: Instant) -> FrameQueue {
        let mut queue = FrameQueue::default();
        for time in times {
            let frame = FeatureFrame {
                time: *time,
                features: Vec::new(),
            };
            queue.push(frame, now);
        }
        queue
    }

    #[test]
    fn frames_wait_for_the_gyro_in_order() {
        let now = Instant::now();
        let mut queue = queue(&[1.0, 1.1], now);
        assert_eq!(queue.pop(Some(0.99), now), None);
        assert_eq!(queue.pop(Some(1.0), now).map(|f| f.time), Some(1.0));
        assert_eq!(queue.pop(Some(1.0), now), None);
        assert_eq!(queue.pop(Some(1.2), now).map(|f| f.time), Some(1.1));
        assert_eq!(queue.pop(Some(1.2), now), None);
    }

    #[test]
    fn frames_do_not_wait_without_a_gyro_nor_forever() {
        let now = Instant::now();
        let mut queue = queue(&[1.0, 1.1], now);
        assert_eq!(queue.pop(None, now).map(|f| f.time), Some(1.0));
        assert_eq!(queue.pop(Some(0.0), now + LONGEST_WAIT / 2), None);
        let late = queue.pop(Some(0.0), now + LONGEST_WAIT);
        assert_eq!(late.map(|f| f.time), Some(1.1));
    }
}
