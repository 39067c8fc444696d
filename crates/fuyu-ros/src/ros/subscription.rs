//! Subscriptions.

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
/// The queue is as long as the QoS depth, and the oldest message makes room for the newest. Messages of a reliable publisher
/// of the same process are not dropped while the program is late: beyond the depth, up to 4096 of them wait (64 of images and
/// point clouds). A queue of depth 1 always has the newest message only.
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
        self.inbox.separate_publishers();
    }

    /// The oldest message that waits.
    pub fn take(&self) -> Option<Received<M>> {
        self.inbox.take()
    }

    /// The newest message that waits; older ones are discarded.
    pub fn latest(&self) -> Option<Received<M>> {
        self.inbox.latest()
    }

    /// The oldest message, waiting for it at most `patience` (wall time). Ends early, with nothing, when
    /// the node is to stop.
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

    /// Whether `publisher` is discovered, matched and not lost.
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
