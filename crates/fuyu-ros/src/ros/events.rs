//! Wake-up of a node's program, and its stop request.

use std::{
    sync::{
        Arc, Condvar, Mutex, OnceLock, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

/// Counts events, so that one that comes between two waits is not missed.
#[derive(Debug, Default)]
pub(super) struct Events {
    count: Mutex<u64>,
    changed: Condvar,
}

impl Events {
    /// Counts an event and wakes all waiting threads.
    pub(super) fn notify(&self) {
        *self.count.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        self.changed.notify_all();
    }

    /// The number of events so far.
    pub(super) fn count(&self) -> u64 {
        *self.count.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until the count differs from `seen` or `deadline` has passed. Returns the count.
    pub(super) fn wait(&self, seen: u64, deadline: Option<Instant>) -> u64 {
        let mut count = self.count.lock().unwrap_or_else(PoisonError::into_inner);
        while *count == seen {
            count = match deadline {
                None => self
                    .changed
                    .wait(count)
                    .unwrap_or_else(PoisonError::into_inner),
                Some(deadline) => {
                    let now = Instant::now();
                    if now >= deadline {
                        break;
                    }
                    self.changed
                        .wait_timeout(count, deadline - now)
                        .unwrap_or_else(PoisonError::into_inner)
                        .0
                }
            };
        }
        *count
    }
}

/// Whether a node has to stop, and the failure if that is the reason.
#[derive(Debug)]
pub(super) struct StopState {
    events: Arc<Events>,
    stopping: AtomicBool,
    failure: OnceLock<String>,
}

impl StopState {
    pub(super) fn new(events: Arc<Events>) -> Self {
        Self {
            events,
            stopping: AtomicBool::new(false),
            failure: OnceLock::new(),
        }
    }

    pub(super) fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Acquire)
    }

    pub(super) fn stop(&self) {
        self.stopping.store(true, Ordering::Release);
        self.events.notify();
    }

    /// Stops the node because it cannot continue; the first reason is kept.
    pub(super) fn fail(&self, reason: String) {
        let _ = self.failure.set(reason);
        self.stop();
    }

    pub(super) fn failure(&self) -> Option<&String> {
        self.failure.get()
    }
}
