//! ROS package [`builtin_interfaces`](https://docs.ros.org/en/jazzy/p/builtin_interfaces/).

crate::messages! {
    package builtin_interfaces;

    /// A point in time, since the epoch of its clock.
    message Time {
        /// Seconds.
        sec: i32,
        /// Nanoseconds within the second, 0 to 999 999 999.
        nanosec: u32,
    }

    /// A span of time.
    message Duration {
        /// Seconds.
        sec: i32,
        /// Nanoseconds within the second, 0 to 999 999 999; they count forward even if `sec` is negative.
        nanosec: u32,
    }
}

const NANOS: i64 = 1_000_000_000;

impl Time {
    /// From nanoseconds since the epoch. ROS keeps seconds in 32 bits: later times saturate.
    pub fn from_nanos(nanos: i64) -> Self {
        let sec = nanos
            .div_euclid(NANOS)
            .clamp(i32::MIN.into(), i32::MAX.into());
        Self {
            sec: sec as i32,
            nanosec: nanos.rem_euclid(NANOS) as u32,
        }
    }

    /// Nanoseconds since the epoch.
    pub fn nanos(&self) -> i64 {
        i64::from(self.sec) * NANOS + i64::from(self.nanosec)
    }

    /// Seconds since the epoch, rounded to the nearest `f64`.
    pub fn seconds(&self) -> f64 {
        f64::from(self.sec) + f64::from(self.nanosec) * 1e-9
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nanoseconds_count_forward_on_both_sides_of_the_epoch() {
        for nanos in [
            0,
            1,
            999_999_999,
            1_000_000_000,
            12_345_678_901,
            -1,
            -1_500_000_000,
        ] {
            let t = Time::from_nanos(nanos);
            assert!(t.nanosec < 1_000_000_000);
            assert_eq!(t.nanos(), nanos);
        }
        assert_eq!(Time::from_nanos(-1).sec, -1);
        assert_eq!(
            Time {
                sec: 2,
                nanosec: 250_000_000
            }
            .seconds(),
            2.25
        );
    }
}
