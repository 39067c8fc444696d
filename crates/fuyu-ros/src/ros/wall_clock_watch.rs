//! Detection of a wall clock that was set back.
//!
//! rustdds passes to a best-effort reader only samples whose arrival time (wall clock) is after that of the last sample
//! and before now. After the clock has been set back, there are none until it has caught up (docs/upstream.md). A new
//! participant has no last sample, so it is not affected.

use std::time::{Duration, Instant, SystemTime};

/// Smaller steps are ignored: a short pause of best-effort subscriptions is not worth a new participant.
const TOLERANCE: Duration = Duration::from_millis(500);

/// Compares the wall clock with the monotonic clock.
#[derive(Debug)]
pub(super) struct WallClockWatch {
    last: (Instant, SystemTime),
}

impl WallClockWatch {
    pub(super) fn new() -> Self {
        Self {
            last: (Instant::now(), SystemTime::now()),
        }
    }

    /// Amount by which the wall clock has been set back since the last call, if it exceeds [`TOLERANCE`].
    pub(super) fn set_back(&mut self) -> Option<Duration> {
        self.set_back_at((Instant::now(), SystemTime::now()))
    }

    fn set_back_at(&mut self, now: (Instant, SystemTime)) -> Option<Duration> {
        let last = std::mem::replace(&mut self.last, now);
        let expected = last.1 + now.0.saturating_duration_since(last.0);
        let step = expected.duration_since(now.1).ok()?;
        (step > TOLERANCE).then_some(step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if a forward step, a suspended computer or slewing is reported, or if one step is reported twice.
    #[test]
    fn only_a_clock_that_is_set_back_is_reported() {
        let mut watch = WallClockWatch::new();
        let (start, wall) = watch.last;
        let second = Duration::from_secs(1);
        let at = |monotonic: u64, wall_ms: i64| {
            let wall = match wall_ms < 0 {
                true => wall - Duration::from_millis(wall_ms.unsigned_abs()),
                false => wall + Duration::from_millis(wall_ms.unsigned_abs()),
            };
            (start + second * monotonic as u32, wall)
        };
        assert_eq!(watch.set_back_at(at(1, 1000)), None);
        assert_eq!(watch.set_back_at(at(2, 1800)), None);
        assert_eq!(watch.set_back_at(at(3, 90_000)), None);
        assert_eq!(watch.set_back_at(at(4, 31_000)), Some(second * 60));
        assert_eq!(watch.set_back_at(at(5, 32_000)), None);
        assert_eq!(watch.set_back_at(at(6, -7_000)), Some(second * 40));
    }
}
