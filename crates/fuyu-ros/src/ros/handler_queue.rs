//! The receiving thread of a node: runs the handlers of its subscriptions and services, one sample after the other.
//!
//! Handlers may take locks, publish, and create or drop endpoints. So they run neither in the publishing thread nor in
//! the transport's receiving thread, and a slow handler delays only its own node.

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
    /// Time by which the waiting samples have to be handled; `None` if none wait.
    due: Option<Instant>,
    sleep: Sleep,
    /// Calls of [`HandlerQueue::flush`] in progress.
    flushing: usize,
    /// The subscription whose handler is running.
    running: Option<Arc<Reader>>,
    thread: Option<ThreadId>,
    closed: bool,
}

/// State of the receiving thread.
#[derive(Default, Clone, Copy)]
enum Sleep {
    /// Running handlers; it checks the queue again before it sleeps.
    #[default]
    Awake,
    /// Sleeping until this time.
    Until(Instant),
    /// Sleeping until it is woken.
    Indefinitely,
}

impl HandlerQueue {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a sample, to be handled within `patience`. If the subscription has reached its limit of waiting samples,
    /// the oldest of them is dropped.
    pub(super) fn push(&self, reader: &Arc<Reader>, sample: RawSample, patience: Duration) {
        let limit = reader.spec.handler_limit();
        let mut state = self.lock();
        if state.closed {
            return;
        }
        let is_own = |(r, _): &&(Arc<Reader>, RawSample)| Arc::ptr_eq(r, reader);
        // Counting the subscription's samples is only necessary if the queue is long enough.
        let has = |state: &State, number: usize| {
            state.waiting.len() >= number && state.waiting.iter().filter(is_own).count() >= number
        };
        if has(&state, limit) {
            let oldest = state.waiting.iter().position(|entry| is_own(&entry));
            oldest.and_then(|oldest| state.waiting.remove(oldest));
            reader.counters.dropped.fetch_add(1, Relaxed);
        }
        state.waiting.push_back((Arc::clone(reader), sample));
        // Samples are handled early enough that waiting causes none of the subscription's samples to be dropped.
        let is_urgent = patience.is_zero() || has(&state, limit.div_ceil(2));
        let now = Instant::now();
        let due = if is_urgent { now } else { now + patience };
        state.due = Some(state.due.map_or(due, |earlier| earlier.min(due)));
        let must_wake = match state.sleep {
            Sleep::Awake => false,
            Sleep::Until(end) => due < end,
            Sleep::Indefinitely => true,
        };
        if must_wake {
            // Further samples do not wake the thread again.
            state.sleep = Sleep::Awake;
            drop(state);
            self.filled.notify_one();
        }
    }

    /// Runs handlers until the queue is closed and empty. `invalid` is called for samples that are not of the expected
    /// type, with subscription, publisher and length.
    pub(super) fn run(&self, invalid: impl Fn(&Reader, Gid, usize)) {
        let mut state = self.lock();
        state.thread = Some(thread::current().id());
        // After samples with patience, further ones are likely: the thread wakes after the same time without being
        // notified.
        let mut linger: Option<Instant> = None;
        loop {
            let now = Instant::now();
            let is_over = |end: Option<Instant>| end.is_some_and(|end| end <= now);
            let is_due =
                state.closed || state.flushing > 0 || is_over(state.due) || is_over(linger);
            if is_due && !state.waiting.is_empty() {
                let mut patience = Duration::ZERO;
                while let Some((reader, sample)) = state.waiting.pop_front() {
                    state.running = Some(Arc::clone(&reader));
                    drop(state);
                    patience = patience.max(handle(&reader, sample, &invalid));
                    state = self.lock();
                    state.running = None;
                    if state.flushing > 0 {
                        self.handled.notify_all();
                    }
                }
                state.due = None;
                linger = (!patience.is_zero()).then(|| Instant::now() + patience);
                continue;
            }
            if state.waiting.is_empty() && state.closed {
                return;
            }
            if is_over(linger) {
                linger = None;
            }
            let end = match (linger, state.due) {
                (Some(linger), Some(due)) => Some(linger.min(due)),
                (linger, due) => linger.or(due),
            };
            state.sleep = end.map_or(Sleep::Indefinitely, Sleep::Until);
            state = match end {
                None => (self.filled.wait(state)).unwrap_or_else(PoisonError::into_inner),
                Some(end) => {
                    let waited = self
                        .filled
                        .wait_timeout(state, end.saturating_duration_since(now));
                    waited.unwrap_or_else(PoisonError::into_inner).0
                }
            };
            state.sleep = Sleep::Awake;
        }
    }

    /// Waits until the handler of a subscription has run for all waiting samples, at most `patience`. The subscription
    /// must not receive further samples. Returns at once if called from a handler.
    pub(super) fn flush(&self, reader: &Arc<Reader>, patience: Duration) {
        let deadline = Instant::now() + patience;
        let mut state = self.lock();
        if state.thread == Some(thread::current().id()) {
            return;
        }
        state.flushing += 1;
        self.filled.notify_all();
        loop {
            let is_own = |r: &Arc<Reader>| Arc::ptr_eq(r, reader);
            let is_busy = state.running.as_ref().is_some_and(is_own)
                || state.waiting.iter().any(|(r, _)| is_own(r));
            let left = deadline.saturating_duration_since(Instant::now());
            let is_abandoned = state.closed && state.thread.is_none();
            if !is_busy || left.is_zero() || is_abandoned {
                state.flushing -= 1;
                return;
            }
            let waited = self.handled.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Ends [`Self::run`] once all waiting samples have been handled.
    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.filled.notify_all();
    }

    /// Discards all samples after a panic in a handler: no further handler runs.
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

/// Runs the handler for a sample. Returns the patience of the subscription.
fn handle(reader: &Reader, sample: RawSample, invalid: impl Fn(&Reader, Gid, usize)) -> Duration {
    let (publisher, length) = (sample.publisher, sample.cdr.len());
    let Destination::Handler(handler) = &reader.destination else {
        return Duration::ZERO;
    };
    if !(handler.sink)(sample, &reader.counters) {
        reader.counters.failed.fetch_add(1, Relaxed);
        invalid(reader, publisher, length);
    }
    handler.patience
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        msg::std_msgs::String as Text,
        ros::{
            NodeName, Qos,
            endpoint::{Counters, EndpointSpec, Handler},
        },
    };
    use std::sync::mpsc;

    /// A subscription whose handler sends the first byte of each sample to `all`.
    fn subscription(queue: &Arc<HandlerQueue>, all: &mpsc::Sender<u8>) -> Arc<Reader> {
        let all = all.clone();
        let sink = move |sample: RawSample, _: &Counters| all.send(sample.cdr[0]).is_ok();
        let destination = Destination::Handler(Handler {
            sink: Box::new(sink),
            patience: HOUR,
            queue: Arc::clone(queue),
        });
        let spec = EndpointSpec::topic::<Text>("/t", Qos::RELIABLE);
        let node = Arc::new(NodeName::new("/", "node").unwrap());
        Arc::new(Reader::new(spec, node, destination, Arc::default()))
    }

    const HOUR: Duration = Duration::from_secs(3600);

    fn sample(number: u8) -> RawSample {
        RawSample::for_test(vec![number].into())
    }

    // Fails if a sample with patience is handled at once, or if a later sample is handled before it.
    #[test]
    fn samples_wait_until_one_is_urgent_and_keep_their_order() {
        let queue = Arc::<HandlerQueue>::default();
        let (handled, all) = mpsc::channel();
        let reader = subscription(&queue, &handled);
        let running = Arc::clone(&queue);
        let thread = thread::spawn(move || running.run(|_, _, _| {}));
        queue.push(&reader, sample(1), HOUR);
        queue.push(&reader, sample(2), HOUR);
        assert!(all.recv_timeout(Duration::from_millis(100)).is_err());
        queue.push(&reader, sample(3), Duration::ZERO);
        assert!(all.iter().take(3).eq([1, 2, 3]));
        // After samples with patience the thread expects further ones, which do not wake it. While the thread is awake,
        // it would handle them at once.
        while !matches!(queue.lock().sleep, Sleep::Until(_)) {
            thread::yield_now();
        }
        queue.push(&reader, sample(4), HOUR);
        assert!(all.recv_timeout(Duration::from_millis(100)).is_err());
        queue.push(&reader, sample(5), Duration::from_millis(1));
        assert!(all.iter().take(2).eq([4, 5]));
        queue.push(&reader, sample(6), HOUR);
        queue.close();
        thread.join().unwrap();
        assert_eq!(all.try_recv(), Ok(6));
    }

    // Would break if the end of a subscription lost samples that wait, or waited for them.
    #[test]
    fn a_flush_handles_what_waits() {
        let queue = Arc::<HandlerQueue>::default();
        let (handled, all) = mpsc::channel();
        let reader = subscription(&queue, &handled);
        let running = Arc::clone(&queue);
        thread::spawn(move || running.run(|_, _, _| {}));
        for round in 0..3 {
            queue.push(&reader, sample(round), HOUR);
            queue.flush(&reader, HOUR);
            assert_eq!(all.try_recv(), Ok(round));
        }
        queue.close();
    }

    // Fails if samples are dropped because the thread waits for further ones.
    #[test]
    fn samples_that_may_wait_are_handled_before_one_is_lost() {
        let queue = Arc::<HandlerQueue>::default();
        let (handled, all) = mpsc::channel();
        let reader = subscription(&queue, &handled);
        let limit = reader.spec.handler_limit();
        let running = Arc::clone(&queue);
        thread::spawn(move || running.run(|_, _, _| {}));
        for _ in 0..limit / 2 + 1 {
            queue.push(&reader, sample(7), HOUR);
        }
        assert!(all.iter().take(limit / 2).all(|number| number == 7));
        assert_eq!(reader.counters.lost(), 0);
        queue.close();
    }
}
