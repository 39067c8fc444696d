//! The newest sample of one input, and whether it may be used.

use super::{InputError, InputStatus, Stamp};

/// Holds the sample with the latest stamp.
#[derive(Debug)]
pub(super) struct Newest<T> {
    held: Option<(Stamp, T)>,
}

impl<T> Default for Newest<T> {
    fn default() -> Self {
        Self { held: None }
    }
}

impl<T> Newest<T> {
    /// Takes `value` unless it is older than the present sample. A sample with the same stamp replaces the present one.
    pub fn offer(&mut self, stamp: Stamp, value: T) {
        if self.stamp().is_none_or(|held| stamp >= held) {
            self.held = Some((stamp, value));
        }
    }

    pub fn stamp(&self) -> Option<Stamp> {
        self.held.as_ref().map(|(stamp, _)| *stamp)
    }

    /// Status and age of the sample, and the sample itself if its stamp and `now` differ by at most `timeout` \[s\].
    pub fn at(&self, now: Stamp, timeout: f64) -> (InputStatus, Option<&T>) {
        match &self.held {
            None => (InputStatus::Missing, None),
            Some((stamp, value)) => {
                let age = now.seconds_since(*stamp);
                if age.abs() <= timeout {
                    (InputStatus::Used { age }, Some(value))
                } else {
                    (InputStatus::Stale { age }, None)
                }
            }
        }
    }

    /// Drops the sample if it is stamped too far ahead.
    pub fn drop_ahead(&mut self, limit: &FutureLimit) {
        if let Some(stamp) = self.stamp()
            && limit.check(stamp).is_err()
        {
            self.clear();
        }
    }

    pub fn clear(&mut self) {
        self.held = None;
    }
}

/// The latest accepted stamp: a sample may be ahead of its joint state, but a much later stamp belongs to another run
/// or another clock.
#[derive(Debug)]
pub(super) struct FutureLimit {
    /// Stamp of the newest joint state.
    pub newest: Option<Stamp>,
    /// How far ahead of this stamp samples may be \[s\].
    pub timeout: f64,
}

impl FutureLimit {
    pub fn check(&self, stamp: Stamp) -> Result<(), InputError> {
        let ahead = self.newest.map_or(0.0, |now| stamp.seconds_since(now));
        if ahead <= self.timeout {
            Ok(())
        } else {
            Err(InputError::TooFarAhead {
                ahead,
                timeout: self.timeout,
            })
        }
    }
}
