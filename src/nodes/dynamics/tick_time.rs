//! Simulated time, counted in ticks: the times at which states are published.

/// Simulated time: a whole number of periods plus the time since the last tick, so that ticks are exact multiples of
/// the period and rounding errors do not accumulate.
#[derive(Debug, Clone, Copy)]
pub struct TickTime {
    /// Time between two ticks \[s\].
    period: f64,
    ticks: u64,
    /// Time since the last tick \[s\], at most one period.
    past_tick: f64,
}

impl TickTime {
    /// Time zero, with `rate` ticks per second \[Hz\].
    pub fn new(rate: f64) -> Self {
        Self {
            period: 1.0 / rate,
            ticks: 0,
            past_tick: 0.0,
        }
    }

    /// The time \[s\].
    pub fn now(&self) -> f64 {
        self.at(self.ticks) + self.past_tick
    }

    /// Number of the last tick.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Whether time is between two ticks.
    pub fn is_between_ticks(&self) -> bool {
        self.past_tick > 0.0
    }

    /// Time between two ticks \[s\].
    pub fn period(&self) -> f64 {
        self.period
    }

    /// Time of the next tick \[s\].
    pub fn next_tick(&self) -> f64 {
        self.at(self.ticks + 1)
    }

    /// Advances to the next tick. Returns the duration \[s\].
    pub fn advance_to_tick(&mut self) -> f64 {
        let seconds = self.period - self.past_tick;
        self.ticks += 1;
        self.past_tick = 0.0;
        seconds
    }

    /// Advances to `time` \[s\], but not beyond the next tick. Returns the duration \[s\]; `None` if `time` is not
    /// later than the current time.
    pub fn advance_within_tick(&mut self, time: f64) -> Option<f64> {
        let past = (time - self.at(self.ticks)).min(self.period);
        (past > self.past_tick).then(|| {
            let seconds = past - self.past_tick;
            self.past_tick = past;
            seconds
        })
    }

    /// Returns to time zero.
    pub fn reset(&mut self) {
        (self.ticks, self.past_tick) = (0, 0.0);
    }

    fn at(&self, ticks: u64) -> f64 {
        ticks as f64 * self.period
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Would break if the steps between ticks were added up: 0.1 is not a binary fraction.
    #[test]
    fn ticks_are_exact_multiples_of_the_period() {
        let mut time = TickTime::new(10.0);
        for tick in 1..=1000_u64 {
            assert!(time.advance_within_tick(time.now() + 0.033).is_some());
            time.advance_to_tick();
            assert_eq!(time.now(), tick as f64 * 0.1);
        }
    }

    #[test]
    fn parts_of_a_period_add_up_to_it_and_never_exceed_it() {
        let mut time = TickTime::new(4.0);
        assert_eq!(time.advance_within_tick(0.1), Some(0.1));
        assert_eq!(time.advance_within_tick(0.1), None);
        assert_eq!(time.advance_within_tick(f64::NEG_INFINITY), None);
        assert_eq!(time.advance_within_tick(7.0), Some(0.25 - 0.1));
        assert_eq!((time.now(), time.next_tick()), (0.25, 0.25));
        assert_eq!(time.advance_to_tick(), 0.0);
        time.reset();
        assert_eq!((time.now(), time.ticks()), (0.0, 0));
    }
}
