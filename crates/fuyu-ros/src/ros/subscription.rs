//! Receiving: a queue per subscription, filled by the node's receiving thread.

use std::{
    collections::VecDeque,
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use super::{
    Gid, Qos, RawSample, Time,
    endpoint::{Counters, Reader},
    node_core::NodeCore,
};
use crate::msg::{Interface, cdr};

/// A received message and its origin.
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

/// Largest number of publishers whose messages are queued separately, each up to the depth.
const SEPARATE_PUBLISHERS: usize = 32;

pub(super) struct ReceiveQueue<M> {
    queue: Mutex<VecDeque<Received<M>>>,
    arrived: Condvar,
    depth: usize,
    /// Whether the depth applies to each publisher instead of all together.
    is_separate: AtomicBool,
}

impl<M: Interface> ReceiveQueue<M> {
    pub(super) fn new(depth: usize) -> Self {
        Self {
            queue: Mutex::default(),
            arrived: Condvar::new(),
            depth: depth.max(1),
            is_separate: AtomicBool::new(false),
        }
    }

    /// Takes a sample in; `false` if its bytes are not an `M`. The oldest makes room for the newest, if publishers are
    /// separate the oldest of the same publisher.
    pub(super) fn accept(&self, sample: &RawSample, counters: &Counters) -> bool {
        let Ok(message) = cdr::decode(&sample.cdr) else {
            return false;
        };
        let received = Received {
            message,
            source_time: sample.source_time,
            received_time: sample.received_time,
            publisher: sample.publisher,
        };
        self.push(received, counters);
        true
    }
}

impl<M> ReceiveQueue<M> {
    fn push(&self, received: Received<M>, counters: &Counters) {
        let mut queue = self.lock();
        if let Some(oldest) = self.superfluous(&queue, received.publisher) {
            queue.remove(oldest);
            let count = match self.depth {
                1 => &counters.replaced,
                _ => &counters.dropped,
            };
            count.fetch_add(1, Relaxed);
        }
        queue.push_back(received);
        drop(queue);
        self.arrived.notify_all();
    }

    /// Index of the message that makes room for one of `publisher`; `None` if there is room.
    fn superfluous(&self, queue: &VecDeque<Received<M>>, publisher: Gid) -> Option<usize> {
        if !self.is_separate.load(Relaxed) {
            return (queue.len() >= self.depth).then_some(0);
        }
        let mut same = (queue.iter().enumerate()).filter(|(_, m)| m.publisher == publisher);
        let oldest = same.next();
        match oldest {
            Some((index, _)) if same.count() + 1 >= self.depth => Some(index),
            _ => (queue.len() >= SEPARATE_PUBLISHERS * self.depth).then_some(0),
        }
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<Received<M>>> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Receives messages of one type from one topic into a queue as long as the QoS depth; the oldest makes
/// room for the newest.
pub struct Subscription<M> {
    core: Arc<NodeCore>,
    reader: Arc<Reader>,
    inbox: Arc<ReceiveQueue<M>>,
}

impl<M: Interface> Subscription<M> {
    pub(super) fn new(
        core: Arc<NodeCore>,
        reader: Arc<Reader>,
        inbox: Arc<ReceiveQueue<M>>,
    ) -> Self {
        Self {
            core,
            reader,
            inbox,
        }
    }

    /// From now on the depth applies to each publisher: one that floods the topic loses its own messages only, and those
    /// of others keep their places. Messages of all publishers are taken in the order of their arrival.
    pub fn separate_publishers(&self) {
        self.inbox.is_separate.store(true, Relaxed);
    }

    /// The oldest message that waits.
    pub fn take(&self) -> Option<Received<M>> {
        self.inbox.lock().pop_front()
    }

    /// The newest message that waits; older ones are discarded.
    pub fn latest(&self) -> Option<Received<M>> {
        let mut queue = self.inbox.lock();
        let newest = queue.pop_back();
        queue.clear();
        newest
    }

    /// The oldest message, waiting for it at most `patience` (wall time). Ends early, with nothing, when
    /// the node is to stop.
    pub fn wait_next(&self, patience: Duration) -> Option<Received<M>> {
        let deadline = Instant::now() + patience;
        // Short waits, since a stop request does not wake this queue.
        const SLICE: Duration = Duration::from_millis(50);
        let mut queue = self.inbox.lock();
        loop {
            if let Some(received) = queue.pop_front() {
                return Some(received);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() || self.core.stop_state.is_stopping() {
                return None;
            }
            queue = self
                .inbox
                .arrived
                .wait_timeout(queue, left.min(SLICE))
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }
}

impl<M> Subscription<M> {
    /// Full name of the topic.
    pub fn topic(&self) -> &str {
        &self.reader.spec.name
    }

    /// Requested QoS.
    pub fn qos(&self) -> &Qos {
        &self.reader.spec.qos
    }

    /// Whether `publisher` is discovered, matched and not lost.
    pub fn is_matched(&self, publisher: Gid) -> bool {
        let peers = &self.reader.counters.peers;
        let peers = peers.lock().unwrap_or_else(PoisonError::into_inner);
        peers.contains(&publisher)
    }

    /// How long ago the last message came (wall time); `None` before the first.
    pub fn age(&self) -> Option<Duration> {
        let last = self.reader.counters.last.load(Relaxed);
        (last != 0).then(|| Time::wall().since(Time::from_nanos(last)))
    }

    /// How many messages came, were dropped because the queue was full (one of depth 1 only ever
    /// replaces), or were not of the type.
    pub fn counts(&self) -> (u64, u64, u64) {
        let c = &self.reader.counters;
        (
            c.messages.load(Relaxed),
            c.dropped.load(Relaxed),
            c.failed.load(Relaxed),
        )
    }
}

impl<M> Drop for Subscription<M> {
    fn drop(&mut self) {
        self.core.remove_reader(&self.reader);
    }
}

/// A subscription to bytes; ends when dropped.
pub struct RawSubscription {
    core: Arc<NodeCore>,
    reader: Arc<Reader>,
}

impl RawSubscription {
    pub(super) fn new(core: Arc<NodeCore>, reader: Arc<Reader>) -> Self {
        Self { core, reader }
    }

    /// Full name of the topic.
    pub fn topic(&self) -> &str {
        &self.reader.spec.name
    }
}

impl Drop for RawSubscription {
    fn drop(&mut self) {
        self.core.remove_reader(&self.reader);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::std_msgs;

    fn message(publisher: u8, text: &str) -> Received<std_msgs::String> {
        Received {
            message: std_msgs::String {
                data: text.to_owned(),
            },
            source_time: None,
            received_time: Time::ZERO,
            publisher: Gid::from([publisher; 16]),
        }
    }

    fn texts(queue: &ReceiveQueue<std_msgs::String>) -> Vec<String> {
        queue.lock().drain(..).map(|m| m.message.data).collect()
    }

    // Would break if a publisher that floods a topic crowded out the others.
    #[test]
    fn a_flood_of_one_publisher_loses_its_own_messages_only() {
        let queue = ReceiveQueue::new(2);
        let counters = Counters::default();
        let flood = || {
            for i in 0..1000 {
                queue.push(message(2, &format!("flood {i}")), &counters);
            }
        };
        queue.push(message(1, "lost"), &counters);
        flood();
        assert_eq!(texts(&queue), ["flood 998", "flood 999"]);
        queue.is_separate.store(true, Relaxed);
        queue.push(message(1, "first"), &counters);
        flood();
        queue.push(message(1, "second"), &counters);
        flood();
        assert_eq!(texts(&queue), ["first", "second", "flood 998", "flood 999"]);
        let dropped = counters.dropped.load(Relaxed);
        assert_eq!(dropped, 999 + 1998);
    }

    #[test]
    fn the_queue_of_many_publishers_is_bounded() {
        let queue = ReceiveQueue::new(2);
        queue.is_separate.store(true, Relaxed);
        for publisher in 0..=255 {
            for _ in 0..3 {
                queue.push(message(publisher, ""), &Counters::default());
            }
        }
        assert_eq!(queue.lock().len(), 2 * SEPARATE_PUBLISHERS);
    }
}
