//! The receiving thread of a node: runs the handlers of its subscriptions and services, one sample after the other.
//!
//! Handlers may take locks, publish, and create or drop endpoints. So they run neither in the thread that publishes nor in
//! the thread that receives from the transport: a slow handler delays its own node only.

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
    /// When the samples that wait have to be handled; `None` without any.
    due: Option<Instant>,
    sleep: Sleep,
    /// Calls of [`HandlerQueue::flush`] in progress.
    flushing: usize,
    /// The subscription whose handler runs.
    running: Option<Arc<Reader>>,
    thread: Option<ThreadId>,
    closed: bool,
}

/// State of the receiving thread.
#[derive(Default, Clone, Copy)]
enum Sleep {
    /// It runs handlers, and looks at the queue again before it sleeps.
    #[default]
    Awake,
    /// It sleeps until that time.
    Until(Instant),
    /// It sleeps until it is woken.
    Indefinitely,
}

impl HandlerQueue {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a sample, to be handled within `patience`. If as many of its subscription wait as may, the oldest makes room
    /// for it.
    pub(super) fn push(&self, reader: &Arc<Reader>, sample: RawSample, patience: Duration) {
        let limit = reader.spec.handler_limit();
        let mut state = self.lock();
        if state.closed {
            return;
        }
        let is_own = |(r, _): &&(Arc<Reader>, RawSample)| Arc::ptr_eq(r, reader);
        // Counting is only necessary when there could be too many.
        let has = |state: &State, number: usize| {
            state.waiting.len() >= number && state.waiting.iter().filter(is_own).count() >= number
        };
        if has(&state, limit) {
            let oldest = state.waiting.iter().position(|entry| is_own(&entry));
            oldest.and_then(|oldest| state.waiting.remove(oldest));
            reader.counters.dropped.fetch_add(1, Relaxed);
        }
        state.waiting.push_back((Arc::clone(reader), sample));
        // A sample that may wait must not make another one of its subscription lose its place.
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
            // It is woken once.
            state.sleep = Sleep::Awake;
            drop(state);
            self.filled.notify_one();
        }
    }

    /// Runs handlers until the queue is closed and empty. `invalid` is called with samples that are not of the expected type:
    /// subscription, publisher and length.
    pub(super) fn run(&self, invalid: impl Fn(&Reader, Gid, usize)) {
        let mut state = self.lock();
        state.thread = Some(thread::current().id());
        // After samples that could wait, more are likely: the thread wakes by itself after the same time.
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

    /// Waits until the handler of a subscription that receives nothing more has run for all samples that wait, at most
    /// `patience`. Returns at once in a handler.
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

/// Runs the handler of a sample. Returns how long the sample could have waited.
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

    /// A subscription whose handler sends the first byte of each sample.
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

    // Would break if a sample that may wait were handled at once, or a later one before it.
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
        // After samples that could wait, the thread expects more of them; they do not wake it. While it is awake, it would
        // handle them at once.
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

    // Would break if samples were lost because the thread waits for more.
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
