//! The queue of a subscription, from which the program takes messages.

use std::{
    collections::VecDeque,
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
    },
    time::Duration,
};

use super::{
    Gid, Time,
    endpoint::{Counters, EndpointSpec, Inbox, Origin},
    events::Events,
    local_delivery::LocalSample,
};
use crate::msg::{Interface, cdr};

/// Largest number of publishers with separate queue limits.
const SEPARATE_PUBLISHERS: usize = 32;

/// A received message with its metadata.
#[derive(Debug, Clone)]
pub struct Received<M> {
    /// The message.
    pub message: M,
    /// Time of publication by the wall clock of the publisher, if it states one.
    pub source_time: Option<Time>,
    /// Time of arrival (wall clock).
    pub received_time: Time,
    /// The publisher.
    pub publisher: Gid,
}

impl<M: Clone> From<Received<Arc<M>>> for Received<M> {
    /// Copies the message if other subscriptions share it.
    fn from(shared: Received<Arc<M>>) -> Self {
        Self {
            message: Arc::unwrap_or_clone(shared.message),
            source_time: shared.source_time,
            received_time: shared.received_time,
            publisher: shared.publisher,
        }
    }
}

type Entry<M> = (Origin, Received<Arc<M>>);

/// Queue of messages in order of arrival. The messages may be shared with other subscriptions of the same participant.
pub(super) struct ReceiveQueue<M> {
    queue: Mutex<VecDeque<Entry<M>>>,
    arrived: Condvar,
    /// Number of threads that wait for `arrived`; changed only under the lock of the queue.
    waiting: AtomicUsize,
    /// Largest number of waiting messages of each origin.
    local_limit: usize,
    remote_limit: usize,
    /// Whether the limits apply to each publisher instead of to all publishers of an origin together.
    is_separate: AtomicBool,
    /// Wakes the program.
    events: Arc<Events>,
}

impl<M: Interface> ReceiveQueue<M> {
    pub(super) fn new(spec: &EndpointSpec, events: Arc<Events>) -> Self {
        Self {
            queue: Mutex::default(),
            arrived: Condvar::new(),
            waiting: AtomicUsize::new(0),
            local_limit: spec.queue_limit(Origin::Local),
            remote_limit: spec.queue_limit(Origin::Remote),
            is_separate: AtomicBool::new(false),
            events,
        }
    }

    /// Applies the limits to each publisher from now on.
    pub(super) fn separate_publishers(&self) {
        self.is_separate.store(true, Relaxed);
    }

    /// Takes the oldest message.
    pub(super) fn take(&self) -> Option<Received<M>> {
        let oldest = self.lock().pop_front();
        oldest.map(|(_, received)| received.into())
    }

    /// Takes the newest message and discards the others.
    pub(super) fn latest(&self) -> Option<Received<M>> {
        let mut all = std::mem::take(&mut *self.lock());
        all.pop_back().map(|(_, received)| received.into())
    }

    /// Takes the oldest message, waiting for it for at most `patience`.
    pub(super) fn wait(&self, patience: Duration) -> Option<Received<M>> {
        let queue = self.lock();
        self.waiting.fetch_add(1, Relaxed);
        let waited = self
            .arrived
            .wait_timeout_while(queue, patience, |queue| queue.is_empty());
        let (mut queue, _) = waited.unwrap_or_else(PoisonError::into_inner);
        self.waiting.fetch_sub(1, Relaxed);
        let oldest = queue.pop_front();
        drop(queue);
        oldest.map(|(_, received)| received.into())
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<Entry<M>>> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes room for a message of `origin`. If the limit is reached, removes the oldest message of that origin (with
    /// separate publishers: of the same publisher).
    fn make_room(
        &self,
        queue: &mut VecDeque<Entry<M>>,
        (origin, publisher): (Origin, Gid),
        counters: &Counters,
    ) {
        let limit = match origin {
            Origin::Local => self.local_limit,
            Origin::Remote => self.remote_limit,
        };
        if queue.len() < limit {
            return;
        }
        let is_separate = self.is_separate.load(Relaxed);
        // Depth 1: only the newest message is kept, of whichever publisher.
        if limit == 1 && !is_separate {
            counters.replaced.fetch_add(queue.len() as u64, Relaxed);
            queue.clear();
            return;
        }
        let same = |(from, received): &Entry<M>| {
            *from == origin && (!is_separate || received.publisher == publisher)
        };
        let superfluous = if queue.iter().filter(|entry| same(entry)).count() >= limit {
            queue.iter().position(same)
        } else {
            (queue.len() >= SEPARATE_PUBLISHERS * limit).then_some(0)
        };
        if let Some(index) = superfluous {
            queue.remove(index);
            counters.dropped.fetch_add(1, Relaxed);
        }
    }
}

impl<M: Interface> Inbox for ReceiveQueue<M> {
    fn accept(&self, sample: LocalSample, origin: Origin, counters: &Counters) -> bool {
        let LocalSample { raw, message } = sample;
        let shared = message.and_then(|message| message.downcast::<M>().ok());
        let message = match shared {
            Some(message) => message,
            None => match cdr::decode(&raw.cdr) {
                Ok(message) => Arc::new(message),
                Err(_) => return false,
            },
        };
        let received = Received {
            message,
            source_time: raw.source_time,
            received_time: raw.received_time,
            publisher: raw.publisher,
        };
        let mut queue = self.lock();
        self.make_room(&mut queue, (origin, raw.publisher), counters);
        queue.push_back((origin, received));
        let is_awaited = self.waiting.load(Relaxed) > 0;
        drop(queue);
        if is_awaited {
            self.arrived.notify_all();
        }
        self.events.notify_of_message();
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        msg::std_msgs::String as Text,
        ros::{Qos, RawSample},
    };

    fn queue(qos: Qos) -> ReceiveQueue<Text> {
        ReceiveQueue::new(&EndpointSpec::topic::<Text>("/t", qos), Arc::default())
    }

    fn fill(
        queue: &ReceiveQueue<Text>,
        origin: Origin,
        names: &str,
        numbers: std::ops::Range<i32>,
    ) -> u64 {
        let counters = Counters::default();
        for i in numbers {
            let text = Text {
                data: format!("{names}{i}"),
            };
            let raw = RawSample::for_test(cdr::encode(&text).into());
            assert!(queue.accept(raw.into(), origin, &counters));
        }
        counters.dropped.load(Relaxed)
    }

    fn taken(queue: &ReceiveQueue<Text>) -> Vec<String> {
        std::iter::from_fn(|| queue.take())
            .map(|r| r.message.data)
            .collect()
    }

    // Fails if messages of another process displace those of a node of this process, or the reverse.
    #[test]
    fn each_origin_has_its_own_limit() {
        let queue = queue(Qos::RELIABLE.depth(3));
        assert_eq!(fill(&queue, Origin::Local, "l", 0..5), 0);
        assert_eq!(fill(&queue, Origin::Remote, "r", 0..5), 2);
        assert_eq!(
            taken(&queue),
            ["l0", "l1", "l2", "l3", "l4", "r2", "r3", "r4"]
        );
    }

    #[test]
    fn the_newest_of_a_queue_of_one_replaces_any_other() {
        let queue = queue(Qos::CLOCK);
        fill(&queue, Origin::Remote, "r", 0..2);
        fill(&queue, Origin::Local, "l", 0..2);
        assert_eq!(taken(&queue), ["l1"]);
    }

    fn from(publisher: u8, text: &str) -> LocalSample {
        let text = Text { data: text.into() };
        let raw = RawSample::for_test(cdr::encode(&text).into());
        let publisher = Gid::from([publisher; 16]);
        RawSample { publisher, ..raw }.into()
    }

    // Fails if a publisher that floods a topic displaces the messages of others.
    #[test]
    fn a_flood_of_one_publisher_loses_its_own_messages_only() {
        let queue = queue(Qos::RELIABLE.depth(2));
        let counters = Counters::default();
        let accept = |sample| assert!(queue.accept(sample, Origin::Remote, &counters));
        let flood = || (0..1000).for_each(|i| accept(from(2, &format!("flood {i}"))));
        accept(from(1, "lost"));
        flood();
        assert_eq!(taken(&queue), ["flood 998", "flood 999"]);
        queue.separate_publishers();
        accept(from(1, "first"));
        flood();
        accept(from(1, "second"));
        flood();
        let left = ["first", "second", "flood 998", "flood 999"];
        assert_eq!(taken(&queue), left);
        assert_eq!(counters.dropped.load(Relaxed), 999 + 1998);
    }

    #[test]
    fn the_queue_of_many_publishers_is_bounded() {
        let queue = queue(Qos::RELIABLE.depth(2));
        queue.separate_publishers();
        let counters = Counters::default();
        for publisher in 0..=255 {
            for _ in 0..3 {
                queue.accept(from(publisher, ""), Origin::Remote, &counters);
            }
        }
        assert_eq!(taken(&queue).len(), 2 * SEPARATE_PUBLISHERS);
    }

    #[test]
    fn a_best_effort_queue_drops_its_oldest() {
        let queue = queue(Qos::SENSOR_DATA.depth(3));
        assert_eq!(fill(&queue, Origin::Local, "l", 0..10), 7);
        assert_eq!(taken(&queue), ["l7", "l8", "l9"]);
    }

    #[test]
    fn what_is_not_of_the_type_is_refused() {
        let queue = queue(Qos::RELIABLE);
        let raw = RawSample::for_test(vec![0, 1, 0, 0, 9].into());
        assert!(!queue.accept(raw.into(), Origin::Remote, &Counters::default()));
        assert!(taken(&queue).is_empty());
    }
}
