//! The receiving thread of a node: runs the handlers of its subscriptions and services, one sample after the other.
//!
//! Handlers may take locks, publish, and create or drop endpoints. So they run neither in the thread that publishes nor in
//! the one that receives from DDS: a slow handler delays its own node only.

use std::{
    collections::VecDeque,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, atomic::Ordering::Relaxed},
    thread::{self, ThreadId},
    time::{Duration, Instant},
};

use super::{
    Gid, RawSample,
    endpoint::{Destination, Reader},
};

/// Samples of a node that wait for their handlers, in order of arrival.
#[derive(Default)]
pub(super) struct HandlerQueue {
    state: Mutex<State>,
    filled: Condvar,
    handled: Condvar,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<(Arc<Reader>, RawSample)>,
    /// The subscription whose handler runs.
    running: Option<Arc<Reader>>,
    thread: Option<ThreadId>,
    closed: bool,
}

impl HandlerQueue {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a sample. If as many of its subscription wait as may, the oldest makes room for it.
    pub(super) fn push(&self, reader: &Arc<Reader>, sample: RawSample) {
        let limit = reader.spec.handler_limit();
        let mut state = self.lock();
        if state.closed {
            return;
        }
        let is_own = |(r, _): &&(Arc<Reader>, RawSample)| Arc::ptr_eq(r, reader);
        // Counting is only necessary when there could be too many.
        if state.waiting.len() >= limit && state.waiting.iter().filter(is_own).count() >= limit {
            let oldest = state.waiting.iter().position(|entry| is_own(&entry));
            oldest.and_then(|oldest| state.waiting.remove(oldest));
            reader.counters.dropped.fetch_add(1, Relaxed);
        }
        state.waiting.push_back((Arc::clone(reader), sample));
        drop(state);
        self.filled.notify_one();
    }

    /// Runs handlers until the queue is closed and empty. `invalid` is called with samples that are not of the expected type:
    /// subscription, publisher and length.
    pub(super) fn run(&self, invalid: impl Fn(&Reader, Gid, usize)) {
        self.lock().thread = Some(thread::current().id());
        let mut state = self.lock();
        loop {
            let Some((reader, sample)) = state.waiting.pop_front() else {
                if state.closed {
                    return;
                }
                let waited = self.filled.wait(state);
                state = waited.unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            state.running = Some(Arc::clone(&reader));
            drop(state);
            let (publisher, length) = (sample.publisher, sample.cdr.len());
            if let Destination::Handler(handler, _) = &reader.destination
                && !handler(sample, &reader.counters)
            {
                reader.counters.failed.fetch_add(1, Relaxed);
                invalid(&reader, publisher, length);
            }
            state = self.lock();
            state.running = None;
            self.handled.notify_all();
        }
    }

    /// Waits until the handler of a subscription that receives nothing more has run for all samples that wait, at most
    /// `patience`. Returns at once in a handler.
    pub(super) fn flush(&self, reader: &Arc<Reader>, patience: Duration) {
        let deadline = Instant::now() + patience;
        let mut state = self.lock();
        if state.thread == Some(thread::current().id()) {
            return;
        }
        loop {
            let is_own = |r: &Arc<Reader>| Arc::ptr_eq(r, reader);
            let is_busy = state.running.as_ref().is_some_and(is_own)
                || state.waiting.iter().any(|(r, _)| is_own(r));
            let left = deadline.saturating_duration_since(Instant::now());
            let is_abandoned = state.closed && state.thread.is_none();
            if !is_busy || left.is_zero() || is_abandoned {
                return;
            }
            let waited = self.handled.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Ends [`Self::run`] when all handlers have run.
    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.filled.notify_all();
    }

    /// After a handler has panicked: no other one runs.
    pub(super) fn abandon(&self) {
        let mut state = self.lock();
        state.closed = true;
        state.thread = None;
        state.running = None;
        state.waiting.clear();
        drop(state);
        self.handled.notify_all();
    }
}
