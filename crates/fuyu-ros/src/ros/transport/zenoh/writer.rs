//! Publishers of topics.

use bytes::Bytes;
use std::{
    sync::{Arc, Mutex, PoisonError, Weak, atomic::Ordering::Relaxed},
    time::{Duration, Instant},
};
use zenoh::{
    Session, Wait,
    liveliness::LivelinessToken,
    qos::{CongestionControl, Reliability},
    sample::Locality,
};
use zenoh_ext::{
    AdvancedPublisher, AdvancedPublisherBuilderExt as _, CacheConfig, MissDetectionConfig,
};

use super::attachment::Attachment;
use crate::ros::{
    Gid, Time,
    endpoint::Writer,
    qos::{Durability, History},
    sample::SampleIdentity,
    transport::{TransportError, WireWriter},
};

/// Longest time between heartbeats of a reliable transient-local publisher, with which subscriptions detect lost
/// samples.
const HEARTBEAT: Duration = Duration::from_millis(500);

/// Time that subscriptions may be announced but not matched, for example while a session reconnects.
const UNMATCHED: Duration = Duration::from_secs(5);

/// Detects that the router reports no subscription to this publisher although some are announced.
#[derive(Default)]
struct UnmatchedSubscriptions {
    since: Option<Instant>,
    is_reported: bool,
}

impl UnmatchedSubscriptions {
    /// Whether to report the problem now; true once.
    fn is_new(&mut self, is_unheard: bool) -> bool {
        if !is_unheard {
            *self = Self::default();
            return false;
        }
        let since = *self.since.get_or_insert_with(Instant::now);
        let is_new = !self.is_reported && since.elapsed() > UNMATCHED;
        self.is_reported |= is_new;
        is_new
    }
}

/// Wire of a publisher.
pub(super) struct TopicWriter {
    publisher: AdvancedPublisher<'static>,
    gid: Gid,
    /// Sequence number of the last message; locked while the message is sent, so that messages are in the order of
    /// their numbers.
    number: Mutex<i64>,
    /// The publisher that this wire belongs to.
    writer: Weak<Writer>,
    unheard: Mutex<UnmatchedSubscriptions>,
    _token: LivelinessToken,
}

impl TopicWriter {
    /// Publishes to `key`, with the options of rmw_zenoh.
    pub(super) fn new(
        session: &Session,
        key: String,
        writer: &Arc<Writer>,
        (gid, token): (Gid, LivelinessToken),
    ) -> Result<Self, TransportError> {
        let qos = &writer.spec.qos;
        let congestion_control = match (qos.is_reliable(), qos.history) {
            (true, History::KeepAll) => CongestionControl::Block,
            _ => CongestionControl::Drop,
        };
        let reliability = match qos.is_reliable() {
            true => Reliability::Reliable,
            false => Reliability::BestEffort,
        };
        let mut builder = session
            .declare_publisher(key)
            .congestion_control(congestion_control)
            .reliability(reliability)
            // Subscriptions of this session receive the message in memory.
            .allowed_destination(Locality::Remote)
            .advanced();
        if qos.durability == Durability::TransientLocal {
            let cache = CacheConfig::default().max_samples(qos.depth.max(1));
            builder = builder.publisher_detection().cache(cache);
            if qos.is_reliable() {
                let detection = MissDetectionConfig::default().sporadic_heartbeat(HEARTBEAT);
                builder = builder.sample_miss_detection(detection);
            }
        }
        let publisher = builder.wait().map_err(TransportError::other)?;
        // Subscribers that are not ROS nodes have no token.
        let weak = Arc::downgrade(writer);
        publisher
            .matching_listener()
            .callback(move |status| {
                if let Some(writer) = weak.upgrade() {
                    (writer.count_is_unsure).store(status.matching(), Relaxed);
                }
            })
            .background()
            .wait()
            .map_err(TransportError::other)?;
        Ok(Self {
            publisher,
            gid,
            number: Mutex::new(0),
            writer: Arc::downgrade(writer),
            unheard: Mutex::default(),
            _token: token,
        })
    }

    /// Warns if subscriptions are announced but the router reports none: it may not permit this session to publish to
    /// them.
    fn warn_if_unheard(&self) {
        let Some(writer) = self.writer.upgrade() else {
            return;
        };
        let subscriptions = writer.counters.remote.load(Relaxed);
        let is_unheard = subscriptions > 0 && !writer.count_is_unsure.load(Relaxed);
        let mut unheard = self.unheard.lock().unwrap_or_else(PoisonError::into_inner);
        if unheard.is_new(is_unheard) {
            tracing::warn!(
                "node {}: nobody receives {}, although {subscriptions} subscribe: the router may not let this process \
                 publish it",
                writer.node,
                writer.spec.name
            );
        }
    }
}

impl WireWriter for TopicWriter {
    fn gid(&self) -> Gid {
        self.gid
    }

    fn write(
        &self,
        cdr: Bytes,
        published: Time,
        _: Option<SampleIdentity>,
    ) -> Option<SampleIdentity> {
        self.warn_if_unheard();
        let mut number = self.number.lock().unwrap_or_else(PoisonError::into_inner);
        let attachment = Attachment {
            sequence_number: *number + 1,
            source_time: published,
            gid: self.gid,
        };
        let put = self.publisher.put(cdr).attachment(attachment.encode());
        put.wait().ok()?;
        *number += 1;
        Some(attachment.identity())
    }

    fn wait_for_all_acked(&self, _: Duration) -> bool {
        // Zenoh has no acknowledgements. Messages in the queue of a link are sent before the session closes.
        true
    }
}
