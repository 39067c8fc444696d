//! Batch schedule: decides when the next batch solution is due.

/// Longest pause between the starts of two batches due to `solver_share` \[s\]; the filter bridges it.
const LONGEST_PAUSE: f64 = 10.0;

/// Data of the last batch that determine when the next one is due. Times of frames are stamps; the duration of a batch
/// is wall time.
#[derive(Debug, Default)]
pub struct BatchSchedule {
    /// Stamp of the newest frame in the last batch \[s\]; `None` if the next batch is due at once.
    newest: Option<f64>,
    /// Time span of the frames in the last batch \[s\].
    span: f64,
    /// Duration of the last batch solution \[s\].
    duration: f64,
}

impl BatchSchedule {
    /// Whether the next batch is due; `newest` is the stamp of the newest frame. A batch starts `period` after the last
    /// one, or earlier if frames have `stopped`, so that the last batch includes all frames.
    pub fn is_due(&self, newest: f64, period: f64, stopped: bool) -> bool {
        self.newest
            .is_none_or(|last| newest >= last + period || (stopped && newest > last))
    }

    /// Pause between the starts of two batches \[s\] at which the solver takes a `share` of one processor core. At most
    /// ten seconds, and at most the time span of the last batch, since a solution from few frames should soon be
    /// corrected.
    pub fn pause(&self, share: f64) -> f64 {
        (self.duration / share).min(LONGEST_PAUSE).min(self.span)
    }

    /// Records the start of a batch of frames from `oldest` to `newest` \[s\].
    pub fn start(&mut self, (oldest, newest): (f64, f64)) {
        self.newest = Some(newest);
        self.span = newest - oldest;
    }

    /// Records the duration \[s\] of a finished batch.
    pub fn end(&mut self, duration: f64) {
        self.duration = duration;
    }

    /// Makes the next batch due at once, with the first frame.
    pub fn restart(&mut self) {
        self.newest = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after_a_batch(frames: (f64, f64), duration: f64) -> BatchSchedule {
        let mut schedule = BatchSchedule::default();
        schedule.start(frames);
        schedule.end(duration);
        schedule
    }

    #[test]
    fn the_first_batch_is_due_at_once_and_the_next_one_after_a_period() {
        assert!(BatchSchedule::default().is_due(0.0, 2.0, false));
        let mut schedule = after_a_batch((0.0, 8.0), 0.1);
        assert!(!schedule.is_due(9.9, 2.0, false));
        assert!(schedule.is_due(10.0, 2.0, false));
        schedule.restart();
        assert!(schedule.is_due(8.0, 2.0, false));
    }

    #[test]
    fn the_last_frames_are_solved_once() {
        let mut schedule = after_a_batch((0.0, 8.0), 0.1);
        assert!(schedule.is_due(8.5, 2.0, true));
        schedule.start((0.0, 8.5));
        assert!(!schedule.is_due(8.5, 2.0, true));
    }

    // Fails if a slow solver took more than its share, or if the motion of the first frames were kept for ten seconds.
    #[test]
    fn the_solver_pauses_for_its_share_but_no_longer_than_it_has_seen() {
        assert_eq!(after_a_batch((20.0, 50.0), 0.5).pause(0.1), 5.0);
        assert_eq!(after_a_batch((20.0, 50.0), 3.0).pause(0.1), 10.0);
        assert_eq!(after_a_batch((0.0, 2.0), 3.0).pause(0.1), 2.0);
    }
}
