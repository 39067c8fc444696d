//! Wake-up of a node's program, and the node's stop request.

use std::{
    cell::RefCell,
    sync::{
        Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

/// Event counter, so that an event between two waits is not missed.
#[derive(Debug, Default)]
pub(super) struct Events {
    state: Mutex<Count>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Count {
    events: u64,
    /// Number of waiting threads. If there are none, the system call that wakes threads is omitted.
    waiting: usize,
}

impl Events {
    /// Counts an event and wakes all waiting threads.
    pub(super) fn notify(&self) {
        let mut state = self.lock();
        state.events += 1;
        let is_awaited = state.waiting > 0;
        drop(state);
        if is_awaited {
            self.changed.notify_all();
        }
    }

    /// As [`Self::notify`]; inside [`publish_together`], the wake-up is deferred to its end.
    pub(super) fn notify_of_message(self: &Arc<Self>) {
        let is_held = HELD.with_borrow_mut(|held| {
            let Some(held) = held else { return false };
            if !held.iter().any(|events| Arc::ptr_eq(events, self)) {
                held.push(Arc::clone(self));
            }
            true
        });
        if !is_held {
            self.notify();
        }
    }

    /// The number of events so far.
    pub(super) fn count(&self) -> u64 {
        self.lock().events
    }

    /// Waits until the count differs from `seen` or `deadline` has passed. Returns the count.
    pub(super) fn wait(&self, seen: u64, deadline: Option<Instant>) -> u64 {
        let mut state = self.lock();
        state.waiting += 1;
        while state.events == seen {
            state = match deadline {
                None => self
                    .changed
                    .wait(state)
                    .unwrap_or_else(PoisonError::into_inner),
                Some(deadline) => {
                    let now = Instant::now();
                    if now >= deadline {
                        break;
                    }
                    self.changed
                        .wait_timeout(state, deadline - now)
                        .unwrap_or_else(PoisonError::into_inner)
                        .0
                }
            };
        }
        state.waiting -= 1;
        state.events
    }

    fn lock(&self) -> MutexGuard<'_, Count> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

thread_local! {
    /// Programs to wake at the end of [`publish_together`]; `None` outside it.
    static HELD: RefCell<Option<Vec<Arc<Events>>>> = const { RefCell::new(None) };
}

/// Publishes several messages that belong together, such as all parts of a state. The messages enter the queues of
/// their subscriptions at once, as always. Waiting programs of the same participant are woken only once, after the last
/// message, instead of once per message.
pub fn publish_together<R>(publish: impl FnOnce() -> R) -> R {
    /// Wakes the programs, also if `publish` panics.
    struct Wake;
    impl Drop for Wake {
        fn drop(&mut self) {
            for events in HELD.take().into_iter().flatten() {
                events.notify();
            }
        }
    }
    if HELD.with_borrow(Option::is_some) {
        return publish();
    }
    HELD.set(Some(Vec::new()));
    let _wake = Wake;
    publish()
}

/// Whether a node has to stop, and the failure that caused this, if any.
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

    /// Stops the node because of a failure; the first reason is kept.
    pub(super) fn fail(&self, reason: String) {
        let _ = self.failure.set(reason);
        self.stop();
    }

    pub(super) fn failure(&self) -> Option<&String> {
        self.failure.get()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{thread, time::Duration};

    // Would break if a program were woken for each message, not at all, or after an inner group already.
    #[test]
    fn messages_published_together_are_one_event_at_the_end() {
        let (a, b) = (Arc::<Events>::default(), Arc::<Events>::default());
        publish_together(|| {
            for _ in 0..3 {
                a.notify_of_message();
            }
            publish_together(|| b.notify_of_message());
            assert_eq!((a.count(), b.count()), (0, 0));
        });
        assert_eq!((a.count(), b.count()), (1, 1));
        a.notify_of_message();
        assert_eq!(a.count(), 2);
    }

    // Would break if a panic left the programs asleep, or all later messages of the thread unnoticed.
    #[test]
    fn a_panic_among_messages_published_together_wakes_nevertheless() {
        let events = Arc::<Events>::default();
        let publisher = Arc::clone(&events);
        let outcome = std::panic::catch_unwind(move || {
            publish_together(|| {
                publisher.notify_of_message();
                panic!("in the middle");
            })
        });
        assert!(outcome.is_err());
        assert_eq!(events.count(), 1);
        events.notify_of_message();
        assert_eq!(events.count(), 2);
    }

    // Would break if an event were not passed on to a thread that waits already.
    #[test]
    fn an_event_wakes_every_thread_that_waits() {
        let events = Arc::<Events>::default();
        let deadline = Instant::now() + Duration::from_secs(20);
        let waiting = [(); 2].map(|()| {
            let events = Arc::clone(&events);
            thread::spawn(move || events.wait(0, Some(deadline)))
        });
        while events.lock().waiting < 2 {
            thread::yield_now();
        }
        events.notify();
        assert_eq!(waiting.map(|thread| thread.join().unwrap()), [1, 1]);
        assert!(Instant::now() < deadline);
        assert_eq!(events.lock().waiting, 0);
    }
}
