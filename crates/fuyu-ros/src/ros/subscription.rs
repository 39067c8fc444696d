//! Subscriptions with a queue, and raw subscriptions.

use std::{
    sync::{Arc, PoisonError, atomic::Ordering::Relaxed},
    time::{Duration, Instant},
};

use super::{
    Gid, Qos, Time,
    endpoint::Reader,
    node_core::NodeCore,
    receive_queue::{ReceiveQueue, Received},
};
use crate::msg::Interface;

/// Receives messages of one type from one topic into a queue.
///
/// The queue is as long as the QoS depth; if it is full, the oldest message is dropped. For a reliable publisher of the
/// same process the limit is 4096 messages (64 for images and point clouds) if that is more than the depth, so that a
/// late program loses none. A queue of depth 1 contains only the newest message.
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

    /// Applies the depth to each publisher from now on: a publisher that floods the topic displaces only its own
    /// messages. Messages of all publishers are still taken in the order of their arrival.
    pub fn separate_publishers(&self) {
        self.inbox.separate_publishers();
    }

    /// Takes the oldest waiting message.
    pub fn take(&self) -> Option<Received<M>> {
        self.inbox.take()
    }

    /// Takes the newest waiting message and discards the others.
    pub fn latest(&self) -> Option<Received<M>> {
        self.inbox.latest()
    }

    /// Takes the oldest message, waiting for it for at most `patience` (wall time). Returns `None` early if the node is
    /// stopping.
    pub fn wait_next(&self, patience: Duration) -> Option<Received<M>> {
        let deadline = Instant::now() + patience;
        // Short waits, since a stop request does not wake this queue.
        const SLICE: Duration = Duration::from_millis(50);
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let received = self.inbox.wait(left.min(SLICE));
            if received.is_some() || left.is_zero() || self.core.stop_state.is_stopping() {
                return received;
            }
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

    /// Whether `publisher` is discovered, matched and alive.
    pub fn is_matched(&self, publisher: Gid) -> bool {
        let Reader {
            counters,
            local,
            spec,
            ..
        } = &*self.reader;
        let peers = counters
            .peers
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let is_remote = peers.contains(&publisher);
        drop(peers);
        is_remote || local.is_matched(publisher, spec)
    }

    /// Time since the last message arrived (wall time); `None` before the first message.
    pub fn age(&self) -> Option<Duration> {
        let last = self.reader.counters.last.load(Relaxed);
        (last != 0).then(|| Time::wall().since(Time::from_nanos(last)))
    }

    /// Numbers of messages that arrived, that were dropped because the queue was full (a queue of depth 1 replaces
    /// messages instead), and that were not of the type.
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

/// A subscription to serialized messages; ends when dropped.
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
