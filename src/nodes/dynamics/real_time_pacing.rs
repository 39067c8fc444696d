//! Simulated time against the computer's.

use std::time::{Duration, Instant};

/// Being this far behind is not caught up with: the process was stopped, or is too slow.
const GIVE_UP: Duration = Duration::from_millis(200);

/// Maps simulated time to instants.
#[derive(Debug)]
pub struct RealTimePacing {
    factor: f64,
    origin: (Instant, f64),
    /// Where the measurement of the achieved factor began.
    mark: (Instant, f64),
}

impl RealTimePacing {
    /// Simulated seconds per second; zero is as fast as possible.
    pub fn new(factor: f64) -> Self {
        let origin = (Instant::now(), 0.0);
        Self {
            factor,
            origin,
            mark: origin,
        }
    }

    /// Time runs from `time` \[s\] on, from now on.
    pub fn start(&mut self, time: f64) {
        self.origin = (Instant::now(), time);
        self.mark = self.origin;
    }

    /// When `time` \[s\] is due. If that is long past, time goes on from now instead.
    pub fn instant(&mut self, time: f64) -> Instant {
        let now = Instant::now();
        if self.factor == 0.0 {
            return now;
        }
        let ahead = Duration::from_secs_f64(((time - self.origin.1) / self.factor).max(0.0));
        let due = self.origin.0 + ahead;
        if now.saturating_duration_since(due) > GIVE_UP {
            self.origin = (now, time);
            return now;
        }
        due
    }

    /// The simulated time of `instant` \[s\].
    pub fn time(&self, instant: Instant) -> f64 {
        if self.factor == 0.0 {
            return f64::NEG_INFINITY;
        }
        self.origin.1
            + instant
                .saturating_duration_since(self.origin.0)
                .as_secs_f64()
                * self.factor
    }

    /// About once a second, with the simulated time `now` \[s\]: the factor achieved since the last time.
    pub fn achieved(&mut self, now: f64) -> Option<f64> {
        let elapsed = self.mark.0.elapsed().as_secs_f64();
        if elapsed < 1.0 {
            return None;
        }
        let achieved = (now - self.mark.1) / elapsed;
        self.mark = (Instant::now(), now);
        Some(achieved)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_and_times_are_inverse() {
        let mut pace = RealTimePacing::new(2.0);
        let before = Instant::now();
        pace.start(10.0);
        let due = pace.instant(11.0);
        assert!((pace.time(due) - 11.0).abs() < 1e-9);
        assert!(due >= before + Duration::from_millis(500));
    }

    #[test]
    fn a_long_pause_is_not_caught_up_with() {
        let mut pace = RealTimePacing::new(1.0);
        pace.start(0.0);
        pace.origin.0 -= Duration::from_secs(5);
        let before = Instant::now();
        let due = pace.instant(1.0);
        assert!(due <= Instant::now());
        // The next tick is due a period later, not at once.
        assert!(pace.instant(1.5) >= before + Duration::from_millis(500));
    }
}
