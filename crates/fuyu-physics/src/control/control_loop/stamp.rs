//! Time stamps of measurements.

const NANOS_PER_SECOND: i64 = 1_000_000_000;

/// Time of a measurement: whole nanoseconds on the common clock of all inputs of a [`ControlLoop`](super::ControlLoop),
/// from the start of a simulation or from the Unix epoch. An integer, so that equal stamps compare equal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Stamp(i64);

impl Stamp {
    /// From nanoseconds.
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// From seconds \[s\], rounded to the nearest nanosecond.
    pub fn from_secs_f64(seconds: f64) -> Self {
        Self((seconds * NANOS_PER_SECOND as f64).round() as i64)
    }

    /// Nanoseconds.
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// In seconds \[s\].
    pub fn as_secs_f64(self) -> f64 {
        // Whole seconds and the remainder are converted separately, which reduces rounding at Unix times.
        (self.0 / NANOS_PER_SECOND) as f64
            + (self.0 % NANOS_PER_SECOND) as f64 / NANOS_PER_SECOND as f64
    }

    /// Seconds from `earlier` to this stamp \[s\]; negative if this stamp is earlier.
    pub fn seconds_since(self, earlier: Self) -> f64 {
        Self(self.0.saturating_sub(earlier.0)).as_secs_f64()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_and_nanoseconds_convert_without_loss() {
        for nanos in [0, 10_000_000, 1_234_567_890_123, -1_500_000_000] {
            let stamp = Stamp::from_nanos(nanos);
            assert_eq!(Stamp::from_secs_f64(stamp.as_secs_f64()), stamp);
        }
        let (early, late) = (Stamp::from_nanos(-500_000_000), Stamp::from_secs_f64(1.25));
        assert_eq!(late.seconds_since(early), 1.75);
        assert_eq!(early.seconds_since(late), -1.75);
        let (first, last) = (Stamp::from_nanos(i64::MIN), Stamp::from_nanos(i64::MAX));
        assert!(last.seconds_since(first) > 9e9);
    }
}
