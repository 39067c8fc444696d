//! Publishing without blocking: a bounded send queue and one sending thread per node.

use bytes::Bytes;
use std::{
    collections::VecDeque,
    marker::PhantomData,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, atomic::Ordering::Relaxed},
    time::{Duration, Instant},
};

use super::{Qos, Time, endpoint::Writer, node_core::NodeCore, sample::SampleIdentity};
use crate::msg::Interface;

/// Smallest queue limit of a reliable publisher: room for messages while DDS waits for a slow subscriber.
const RELIABLE_QUEUE: usize = 256;

/// Publishes messages of one type on one topic: in memory to other nodes of the participant, over DDS to other
/// processes. Publishing never blocks: messages that DDS cannot take yet wait in a queue. If the queue is full, a
/// best-effort publisher drops its oldest message and a reliable publisher the new one. Dropped messages are counted
/// and reported in the node's diagnostics.
pub struct Publisher<M> {
    core: Arc<NodeCore>,
    writer: Arc<Writer>,
    message: PhantomData<fn(&M)>,
}

impl<M: Interface> Publisher<M> {
    pub(super) fn new(core: Arc<NodeCore>, writer: Arc<Writer>) -> Self {
        Self {
            core,
            writer,
            message: PhantomData,
        }
    }

    /// Sends a message to all subscribers.
    pub fn publish(&self, message: &M) {
        self.core.publish(&self.writer, message);
    }

    /// Sends a message that is already serialized: CDR (little endian) with its encapsulation header.
    pub fn publish_cdr(&self, cdr: Vec<u8>) {
        self.core.publish_cdr(&self.writer, cdr.into());
    }

    /// Full name of the topic.
    pub fn topic(&self) -> &str {
        &self.writer.spec.name
    }

    /// Offered QoS.
    pub fn qos(&self) -> &Qos {
        &self.writer.spec.qos
    }

    /// Number of messages that were dropped because the queue, or the send window of a subscriber, was full.
    pub fn dropped(&self) -> u64 {
        NodeCore::lost(&self.writer)
    }
}

/// Longest time that the end of a publisher waits for its last messages to be sent, and then for their
/// acknowledgements.
pub(super) const LAST_MESSAGES: Duration = Duration::from_millis(200);

impl<M> Drop for Publisher<M> {
    /// Ensures that living subscribers receive the last messages before the publisher leaves the graph.
    fn drop(&mut self) {
        self.core
            .send_queue
            .flush_writer(&self.writer, LAST_MESSAGES);
        self.writer.finish(LAST_MESSAGES);
        self.core.remove_writer(&self.writer);
    }
}

impl<M> Publisher<M> {
    /// Waits until the subscribers of other processes have acknowledged all messages, at most `timeout`. Returns
    /// whether they have. Returns `true` at once for a best-effort publisher, without such subscribers, and over Zenoh,
    /// which has no acknowledgements.
    ///
    /// Dropping a publisher waits for 200 ms only. Use this function for messages that must not be lost even if
    /// subscribers or the computer are busy, such as the last ones of a bag.
    pub fn wait_for_all_acked(&self, timeout: Duration) -> bool {
        let deadline = Instant::now() + timeout;
        self.core.send_queue.flush_writer(&self.writer, timeout);
        let left = deadline.saturating_duration_since(Instant::now());
        self.writer.queued.load(Relaxed) == 0 && self.writer.wait_for_all_acked(left)
    }
}

/// Publishes serialized messages of a type that need not be declared in this program; ends when dropped.
pub struct RawPublisher {
    publisher: Publisher<()>,
}

impl RawPublisher {
    pub(super) fn new(core: Arc<NodeCore>, writer: Arc<Writer>) -> Self {
        Self {
            publisher: Publisher {
                core,
                writer,
                message: PhantomData,
            },
        }
    }

    /// Sends CDR bytes with their encapsulation header. If the queue is full, waits for room for a limited time.
    pub fn publish(&self, cdr: Vec<u8>) {
        let Publisher { core, writer, .. } = &self.publisher;
        if writer.queued.load(Relaxed) >= writer.spec.qos.depth.clamp(1, RELIABLE_QUEUE / 2) {
            core.send_queue.flush_writer(writer, LAST_MESSAGES);
        }
        core.publish_cdr(writer, cdr.into());
    }

    /// Waits until the subscribers have acknowledged all messages ([`Publisher::wait_for_all_acked`]).
    pub fn wait_for_all_acked(&self, timeout: Duration) -> bool {
        self.publisher.wait_for_all_acked(timeout)
    }

    /// Full name of the topic.
    pub fn topic(&self) -> &str {
        &self.publisher.writer.spec.name
    }

    /// Number of messages that were dropped because the queue, or the send window of a subscriber, was full.
    pub fn dropped(&self) -> u64 {
        NodeCore::lost(&self.publisher.writer)
    }
}

struct Outgoing {
    writer: Arc<Writer>,
    cdr: Bytes,
    published: Time,
    related: Option<SampleIdentity>,
}

#[derive(Default)]
struct Queue {
    items: VecDeque<Outgoing>,
    /// The writer of the message that some thread is sending now.
    sending: Option<Arc<Writer>>,
    /// Whether the sending thread runs. It sends the messages that cannot be sent at once.
    running: bool,
    closed: bool,
}

/// Messages of a node that wait to be sent, in order.
#[derive(Default)]
pub(super) struct SendQueue {
    queue: Mutex<Queue>,
    filled: Condvar,
    emptied: Condvar,
}

impl SendQueue {
    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn push(&self, writer: &Arc<Writer>, cdr: Bytes, related: Option<SampleIdentity>) {
        let published = Time::wall();
        let mut queue = self.lock();
        // If no message waits, a best-effort message is sent in this thread: that does not block, and costs less than
        // waking another thread.
        let is_free = queue.running && queue.items.is_empty() && queue.sending.is_none();
        if is_free && !writer.spec.qos.is_reliable() {
            queue.sending = Some(Arc::clone(writer));
            drop(queue);
            writer.write(cdr, published, related);
            let mut queue = self.lock();
            queue.sending = None;
            if !queue.items.is_empty() || queue.closed {
                self.filled.notify_one();
            }
            drop(queue);
            self.emptied.notify_all();
            return;
        }
        let limit = match writer.spec.qos.is_reliable() {
            true => writer.spec.qos.depth.max(RELIABLE_QUEUE),
            false => writer.spec.qos.depth.max(1),
        };
        if writer.queued.load(Relaxed) >= limit {
            writer.counters.dropped.fetch_add(1, Relaxed);
            if writer.spec.qos.is_reliable() {
                return;
            }
            let oldest = queue
                .items
                .iter()
                .position(|o| Arc::ptr_eq(&o.writer, writer));
            if let Some(oldest) = oldest {
                queue.items.remove(oldest);
                writer.queued.fetch_sub(1, Relaxed);
            }
        }
        writer.queued.fetch_add(1, Relaxed);
        queue.items.push_back(Outgoing {
            writer: Arc::clone(writer),
            cdr,
            published,
            related,
        });
        drop(queue);
        self.filled.notify_one();
    }

    /// Runs the sending thread: passes messages to DDS until the send queue is closed, and calls `tick` every `period`.
    /// `period`.
    pub(super) fn run(&self, period: Duration, mut tick: impl FnMut()) {
        let mut next_tick = Instant::now() + period;
        self.lock().running = true;
        loop {
            let now = Instant::now();
            if now >= next_tick {
                tick();
                next_tick = (next_tick + period).max(now);
            }
            let mut queue = self.lock();
            if queue.items.is_empty() || queue.sending.is_some() {
                self.emptied.notify_all();
                if queue.closed && queue.sending.is_none() {
                    return;
                }
                let wait = next_tick.saturating_duration_since(Instant::now());
                drop(
                    self.filled
                        .wait_timeout(queue, wait)
                        .unwrap_or_else(PoisonError::into_inner),
                );
                continue;
            }
            let Some(out) = queue.items.pop_front() else {
                continue;
            };
            out.writer.queued.fetch_sub(1, Relaxed);
            queue.sending = Some(Arc::clone(&out.writer));
            drop(queue);
            out.writer.write(out.cdr, out.published, out.related);
            self.lock().sending = None;
            self.emptied.notify_all();
        }
    }

    /// Ends [`Self::run`] once all messages have been sent.
    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.filled.notify_all();
    }

    /// Waits until all messages of `writer` have been passed to DDS, at most `patience`.
    pub(super) fn flush_writer(&self, writer: &Arc<Writer>, patience: Duration) {
        let deadline = Instant::now() + patience;
        let mut queue = self.lock();
        let busy = |queue: &Queue| {
            writer.queued.load(Relaxed) > 0
                || queue
                    .sending
                    .as_ref()
                    .is_some_and(|w| Arc::ptr_eq(w, writer))
        };
        while busy(&queue) {
            let wait = deadline.saturating_duration_since(Instant::now());
            if wait.is_zero() {
                return;
            }
            queue = self
                .emptied
                .wait_timeout(queue, wait)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        msg::std_msgs::String as Text,
        ros::{NodeName, endpoint::EndpointSpec},
    };

    fn writer(topic: &str, qos: Qos) -> Arc<Writer> {
        let node = Arc::new(NodeName::new("/", "node").unwrap());
        let spec = EndpointSpec::topic::<Text>(topic, qos);
        Arc::new(Writer::new(spec, node, Arc::default()))
    }

    fn fill(qos: Qos, messages: u8) -> (SendQueue, Arc<Writer>) {
        let (send_queue, writer) = (SendQueue::default(), writer("/t", qos));
        for i in 0..messages {
            send_queue.push(&writer, vec![i].into(), None);
        }
        (send_queue, writer)
    }

    fn waiting(send_queue: &SendQueue) -> Vec<u8> {
        send_queue.lock().items.iter().map(|o| o.cdr[0]).collect()
    }

    // Fails if a message overtakes a waiting one, or if a message waits although none is before it.
    #[test]
    fn best_effort_goes_at_once_where_nothing_waits() {
        let (send_queue, writer) = fill(Qos::SENSOR_DATA, 0);
        let reliable = self::writer("/r", Qos::RELIABLE);
        send_queue.lock().running = true;
        let handed_over = || writer.counters.failed.load(Relaxed);
        send_queue.push(&writer, vec![0].into(), None);
        assert_eq!((waiting(&send_queue).len(), handed_over()), (0, 1));
        send_queue.push(&reliable, vec![1].into(), None);
        send_queue.push(&writer, vec![2].into(), None);
        assert_eq!(waiting(&send_queue), [1, 2]);
        send_queue.lock().items.clear();
        send_queue.lock().sending = Some(reliable);
        send_queue.push(&writer, vec![3].into(), None);
        assert_eq!((waiting(&send_queue), handed_over()), (vec![3], 1));
    }

    // Would break if a full queue blocked, grew, or lost messages without counting them.
    #[test]
    fn a_full_best_effort_queue_drops_its_oldest() {
        let (send_queue, writer) = fill(Qos::SENSOR_DATA.depth(3), 10);
        assert_eq!(waiting(&send_queue), [7, 8, 9]);
        assert_eq!(writer.counters.dropped.load(Relaxed), 7);
    }

    #[test]
    fn a_full_reliable_queue_keeps_what_it_has_and_counts() {
        let (send_queue, writer) = fill(Qos::RELIABLE.depth(1), 255);
        assert_eq!(waiting(&send_queue).len(), 255);
        for i in 0..10 {
            send_queue.push(&writer, vec![i].into(), None);
        }
        assert_eq!(waiting(&send_queue).len(), RELIABLE_QUEUE);
        assert_eq!(waiting(&send_queue)[0], 0);
        assert_eq!(writer.counters.dropped.load(Relaxed), 9);
    }

    #[test]
    fn messages_that_dds_refuses_are_counted() {
        let (send_queue, writer) = fill(Qos::RELIABLE, 4);
        send_queue.close();
        send_queue.run(Duration::from_secs(1), || {});
        assert_eq!(writer.counters.failed.load(Relaxed), 4);
        assert_eq!(writer.queued.load(Relaxed), 0);
    }
}
