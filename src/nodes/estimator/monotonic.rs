//! Monotonic time stamps of published messages.

/// The latest published time stamp.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Monotonic {
    latest: Option<f64>,
}

impl Monotonic {
    /// Returns whether a message at `time` \[s\] may be published: not before the latest one. If so, `time` becomes the
    /// latest.
    pub fn advance(&mut self, time: f64) -> bool {
        let may = self.latest.is_none_or(|latest| time >= latest);
        if may {
            self.latest = Some(time);
        }
        may
    }

    /// The latest time \[s\]; `None` before the first message.
    pub fn latest(&self) -> Option<f64> {
        self.latest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Frames at 10 Hz stop at 2.0 s, the motion is extrapolated to 2.9 s, and a frame of 2.6 s arrives late.
    #[test]
    fn times_do_not_go_back_after_an_extrapolation() {
        let mut times = Monotonic::default();
        let wanted = [1.9, 2.0, 2.5, 2.9, 2.6, 2.7, 2.9, 3.0];
        let published: Vec<f64> = (wanted.into_iter()).filter(|t| times.advance(*t)).collect();
        assert_eq!(published, [1.9, 2.0, 2.5, 2.9, 2.9, 3.0]);
        assert_eq!(times.latest(), Some(3.0));
    }
}
