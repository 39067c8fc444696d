//! ROS time: nanoseconds since the epoch of its clock.

use std::{
    fmt,
    ops::{Add, AddAssign, Sub},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use crate::msg::builtin_interfaces;

const NANOS_PER_SECOND: i64 = 1_000_000_000;

/// A time in nanoseconds since the Unix epoch, or since the start of a simulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Time(i64);

impl Time {
    /// Time zero, which ROS also uses for "no time yet".
    pub const ZERO: Self = Self(0);
    /// The latest time.
    pub const MAX: Self = Self(i64::MAX);

    /// Creates a time from nanoseconds.
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// Creates a time from seconds, rounded to the nearest nanosecond.
    pub fn from_secs_f64(seconds: f64) -> Self {
        Self((seconds * NANOS_PER_SECOND as f64).round() as i64)
    }

    /// Present time of the computer's clock.
    pub fn wall() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH);
        Self(since.map_or(0, |d| d.as_nanos() as i64))
    }

    /// Nanoseconds.
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// In seconds.
    pub fn as_secs_f64(self) -> f64 {
        // Whole seconds and nanoseconds are added separately, so that a double holds a Unix time as accurately as
        // possible.
        (self.0 / NANOS_PER_SECOND) as f64
            + (self.0 % NANOS_PER_SECOND) as f64 / NANOS_PER_SECOND as f64
    }

    /// Time from `earlier` to this time; zero if negative.
    pub fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0).max(0) as u64)
    }
}

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let nanos = self.0.unsigned_abs();
        let per_second = NANOS_PER_SECOND.unsigned_abs();
        write!(f, "{sign}{}.{:09}", nanos / per_second, nanos % per_second)
    }
}

impl Add<Duration> for Time {
    type Output = Self;
    fn add(self, d: Duration) -> Self {
        Self(
            self.0
                .saturating_add(i64::try_from(d.as_nanos()).unwrap_or(i64::MAX)),
        )
    }
}

impl AddAssign<Duration> for Time {
    fn add_assign(&mut self, d: Duration) {
        *self = *self + d;
    }
}

impl Sub<Duration> for Time {
    type Output = Self;
    fn sub(self, d: Duration) -> Self {
        Self(
            self.0
                .saturating_sub(i64::try_from(d.as_nanos()).unwrap_or(i64::MAX)),
        )
    }
}

/// Difference in seconds, negative if the first time is earlier.
impl Sub for Time {
    type Output = f64;
    fn sub(self, other: Self) -> f64 {
        Self(self.0.saturating_sub(other.0)).as_secs_f64()
    }
}

impl From<Time> for builtin_interfaces::Time {
    /// Saturates beyond the 32-bit seconds of ROS (the year 2038).
    fn from(t: Time) -> Self {
        let sec = t.0.div_euclid(NANOS_PER_SECOND);
        Self {
            sec: sec.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32,
            nanosec: t.0.rem_euclid(NANOS_PER_SECOND) as u32,
        }
    }
}

impl From<&builtin_interfaces::Time> for Time {
    fn from(t: &builtin_interfaces::Time) -> Self {
        Self(i64::from(t.sec) * NANOS_PER_SECOND + i64::from(t.nanosec))
    }
}

impl From<builtin_interfaces::Time> for Time {
    fn from(t: builtin_interfaces::Time) -> Self {
        Self::from(&t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Would break if nanoseconds went through a double, or if negative times were split towards zero.
    #[test]
    fn conversions_keep_every_nanosecond() {
        for nanos in [
            0,
            1,
            999_999_999,
            1_700_000_000_123_456_789,
            -1,
            -1_000_000_001,
        ] {
            let t = Time::from_nanos(nanos);
            let ros: builtin_interfaces::Time = t.into();
            assert!(ros.nanosec < 1_000_000_000);
            assert_eq!(Time::from(ros), t);
        }
        assert_eq!(Time::from_nanos(-1_500_000_000).to_string(), "-1.500000000");
        assert_eq!(Time::from_secs_f64(0.1).as_nanos(), 100_000_000);
        assert_eq!(
            Time::from_nanos(5).since(Time::from_nanos(9)),
            Duration::ZERO
        );
        assert_eq!(Time::from_nanos(0) - Time::from_secs_f64(1.5), -1.5);
    }
}
