//! Waiting for space on a full disk.

use std::io;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Interval between attempts.
const RETRY: Duration = Duration::from_millis(200);

/// Repeats writes that fail because the disk is full, until there is space. A failed write has written nothing, so the
/// file continues without a gap.
#[derive(Debug, Default)]
pub(super) struct DiskSpace(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    patience: Patience,
    /// The error of the last attempt, while waiting.
    problem: Option<String>,
}

#[derive(Debug, Clone, Copy, Default)]
enum Patience {
    /// Do not wait: return errors at once.
    #[default]
    None,
    Endless,
    Until(Instant),
}

impl DiskSpace {
    /// Waits for space from now on.
    pub fn wait_when_full(&self) {
        self.lock().patience = Patience::Endless;
    }

    /// Waits for space at most this long from now.
    pub fn give_up_after(&self, time: Duration) {
        self.lock().patience = Patience::Until(Instant::now() + time);
    }

    /// The error of the write that is waiting now.
    pub fn problem(&self) -> Option<String> {
        self.lock().problem.clone()
    }

    /// Calls `write` until it succeeds or fails for another reason.
    ///
    /// # Errors
    /// That of `write`.
    pub fn retry<T>(&self, mut write: impl FnMut() -> io::Result<T>) -> io::Result<T> {
        loop {
            let result = write();
            let mut state = self.lock();
            let waits = match state.patience {
                Patience::None => false,
                Patience::Endless => true,
                Patience::Until(end) => Instant::now() < end,
            };
            match result {
                Err(e) if waits && is_full(&e) => state.problem = Some(e.to_string()),
                result => {
                    state.problem = None;
                    return result;
                }
            }
            drop(state);
            sleep(RETRY);
        }
    }

    // The state stays valid after a panic in another thread.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn is_full(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded
    )
}
