//! Real-time pacing: maps simulated time to the computer's clock.

use std::time::{Duration, Instant};

/// A larger delay is not caught up with: the process was stopped, or is too slow.
const LARGEST_DELAY: Duration = Duration::from_millis(200);

/// Maps simulated time to instants by the real time factor.
#[derive(Debug)]
pub struct RealTimePacing {
    /// Simulated seconds per second of real time; zero means as fast as possible.
    factor: f64,
    /// A reference instant and its simulated time \[s\].
    origin: (Instant, f64),
    /// Instant and simulated time \[s\] at which the measurement of the achieved factor began.
    measured_from: (Instant, f64),
}

impl RealTimePacing {
    /// Pacing with a real time factor: simulated seconds per second of real time; zero means as fast as possible.
    pub fn new(factor: f64) -> Self {
        let origin = (Instant::now(), 0.0);
        Self {
            factor,
            origin,
            measured_from: origin,
        }
    }

    /// Starts pacing: simulated time is `time` \[s\] now.
    pub fn start(&mut self, time: f64) {
        self.origin = (Instant::now(), time);
        self.measured_from = self.origin;
    }

    /// Instant at which the simulated `time` \[s\] is due. If the delay is larger than 200 ms, it is due now, and later
    /// times are due relative to now.
    pub fn instant(&mut self, time: f64) -> Instant {
        let now = Instant::now();
        if self.factor == 0.0 {
            return now;
        }
        let ahead = Duration::from_secs_f64(((time - self.origin.1) / self.factor).max(0.0));
        let due = self.origin.0 + ahead;
        if now.saturating_duration_since(due) > LARGEST_DELAY {
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

    /// The real time factor achieved since the last measurement, about once a second; otherwise `None`. `now` is the
    /// simulated time \[s\].
    pub fn achieved(&mut self, now: f64) -> Option<f64> {
        let elapsed = self.measured_from.0.elapsed().as_secs_f64();
        if elapsed < 1.0 {
            return None;
        }
        let achieved = (now - self.measured_from.1) / elapsed;
        self.measured_from = (Instant::now(), now);
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
        // The next tick is due a period later, not immediately.
        assert!(pace.instant(1.5) >= before + Duration::from_millis(500));
    }
}
