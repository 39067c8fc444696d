//! Waiting for an event, however slow the machine is.

use std::{
    thread,
    time::{Duration, Instant},
};

/// Timeout for an event that occurs almost at once on an idle machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Polls until `done` returns `Some`; panics after `patience`.
pub fn eventually<T>(what: &str, patience: Duration, mut done: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + patience;
    loop {
        if let Some(found) = done() {
            return found;
        }
        assert!(Instant::now() < deadline, "not within {patience:?}: {what}");
        thread::sleep(Duration::from_millis(20));
    }
}
