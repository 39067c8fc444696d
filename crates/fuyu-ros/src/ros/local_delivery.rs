//! Delivery inside a participant: messages of its publishers reach its subscriptions in memory.
//!
//! A participant does not exchange messages with itself over its transport: DDS on loopback does not deliver them
//! (docs/upstream.md), and elsewhere the receiving thread drops the messages of its own participant. Instead the
//! publishing thread passes each message to the subscriptions of its topic in the same participant; then the transport
//! sends it to other participants. Subscriptions with the same Rust type share one copy of the message; raw
//! subscriptions, which know the type by name only, share the serialized bytes.
//!
//! Endpoints are matched by the rules of DDS: same topic and type, and an offered QoS that satisfies the requested one.
//! The lock of a topic is held while a message enters the queues of its subscriptions, so that all receive the messages
//! of a publisher in the same order, and a late joiner receives each retained message once. While the lock is held,
//! nothing is logged and neither handlers nor the transport are called.

use bytes::Bytes;
use std::{
    any::Any,
    collections::{HashMap, VecDeque},
    sync::{Arc, Mutex, MutexGuard, PoisonError, atomic::Ordering::Relaxed},
    time::Instant,
};

use super::{
    Gid, Qos, RawSample, Time,
    endpoint::{Destination, EndpointSpec, Origin, Reader, Writer},
    qos::{Durability, Liveliness},
    sample::{ReplyPath, SampleIdentity},
};

/// A message of any Rust type.
pub(super) type AnyMessage = Arc<dyn Any + Send + Sync>;

/// A sample on its way to a subscription.
#[derive(Clone)]
pub(super) struct LocalSample {
    pub(super) raw: RawSample,
    /// The message itself, unless the publisher has only the bytes.
    pub(super) message: Option<AnyMessage>,
}

impl From<RawSample> for LocalSample {
    fn from(raw: RawSample) -> Self {
        Self { raw, message: None }
    }
}

/// A message on its way from a publisher.
pub(super) struct Outgoing<'a> {
    /// Encapsulation header and CDR.
    pub(super) cdr: Bytes,
    /// Creates the copy that subscriptions share; called only if one of them needs it.
    pub(super) message: Option<&'a dyn Fn() -> AnyMessage>,
    /// For services: identity of the related request.
    pub(super) related: Option<SampleIdentity>,
    /// Identity of the sample if the transport has sent it already.
    pub(super) identity: Option<SampleIdentity>,
}

/// The topics of a participant.
#[derive(Default)]
pub(super) struct LocalTopics {
    topics: Mutex<HashMap<String, Arc<LocalTopic>>>,
}

impl LocalTopics {
    /// The topic with this DDS name.
    pub(super) fn topic(&self, dds_topic: &str) -> Arc<LocalTopic> {
        let mut topics = self.topics.lock().unwrap_or_else(PoisonError::into_inner);
        // Unused topics: no endpoint refers to them.
        if topics.len() >= 2 * TOPICS_BEFORE_CLEANING {
            topics.retain(|_, topic| Arc::strong_count(topic) > 1);
        }
        let topic = topics.entry(dds_topic.to_owned()).or_default();
        Arc::clone(topic)
    }
}

/// Unused topics are removed once there are twice as many topics as this.
const TOPICS_BEFORE_CLEANING: usize = 256;

/// The endpoints of one topic in a participant.
#[derive(Default)]
pub(super) struct LocalTopic {
    members: Mutex<Members>,
}

#[derive(Default)]
struct Members {
    writers: Vec<LocalWriter>,
    readers: Vec<Arc<Reader>>,
}

struct LocalWriter {
    writer: Arc<Writer>,
    /// Matched subscriptions, in the order of their creation.
    matched: Vec<Arc<Reader>>,
    sent: i64,
    /// Retained messages of transient-local publishers, for late joiners.
    kept: VecDeque<(Instant, LocalSample)>,
}

/// Why two endpoints of a participant on the same topic do not exchange messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Mismatch {
    /// The types differ: offered, requested.
    Types(String, String),
    /// The publisher offers less than the subscription requests: offered, requested.
    Qos(Box<(Qos, Qos)>),
}

impl LocalTopic {
    /// Adds a publisher. Returns the reasons why subscriptions do not match it.
    pub(super) fn add_writer(&self, writer: &Arc<Writer>) -> Vec<Mismatch> {
        let mut members = self.lock();
        let mut mismatches = Vec::new();
        let mut matched = Vec::new();
        for reader in &members.readers {
            match check(&writer.spec, &reader.spec) {
                Ok(()) => {
                    connect(writer, reader);
                    matched.push(Arc::clone(reader));
                }
                Err(mismatch) => mismatches.push(mismatch),
            }
        }
        members.writers.push(LocalWriter {
            writer: Arc::clone(writer),
            matched,
            sent: 0,
            kept: VecDeque::new(),
        });
        mismatches
    }

    /// Adds a subscription. If it requests them, it receives the retained messages of transient-local publishers.
    /// Returns the reasons why publishers do not match it.
    pub(super) fn add_reader(&self, reader: &Arc<Reader>) -> Vec<Mismatch> {
        let mut members = self.lock();
        let mut mismatches = Vec::new();
        for local in &mut members.writers {
            let LocalWriter { writer, kept, .. } = local;
            if let Err(mismatch) = check(&writer.spec, &reader.spec) {
                mismatches.push(mismatch);
                continue;
            }
            connect(writer, reader);
            local.matched.push(Arc::clone(reader));
            if reader.spec.qos.durability == Durability::TransientLocal {
                let lifespan = writer.spec.qos.lifespan;
                let lives = |at: &Instant| lifespan.is_none_or(|span| at.elapsed() <= span);
                for (_, sample) in kept.iter().filter(|(at, _)| lives(at)) {
                    reader.receive(sample.clone(), Origin::Local);
                }
            }
        }
        members.readers.push(Arc::clone(reader));
        mismatches
    }

    /// Removes a publisher and its retained messages.
    pub(super) fn remove_writer(&self, writer: &Arc<Writer>) {
        let mut members = self.lock();
        let own = |w: &LocalWriter| Arc::ptr_eq(&w.writer, writer);
        if let Some(index) = members.writers.iter().position(own) {
            for reader in members.writers.remove(index).matched {
                reader.counters.local.fetch_sub(1, Relaxed);
            }
        }
    }

    /// Removes a subscription, which receives no messages from then on.
    pub(super) fn remove_reader(&self, reader: &Arc<Reader>) {
        let mut members = self.lock();
        members.readers.retain(|r| !Arc::ptr_eq(r, reader));
        for LocalWriter {
            writer, matched, ..
        } in &mut members.writers
        {
            if let Some(index) = matched.iter().position(|r| Arc::ptr_eq(r, reader)) {
                matched.remove(index);
                writer.counters.local.fetch_sub(1, Relaxed);
            }
        }
    }

    /// Passes a message of `writer` to its matched subscriptions. Returns their number.
    pub(super) fn deliver(&self, writer: &Arc<Writer>, outgoing: Outgoing) -> usize {
        let latched = writer.spec.qos.durability == Durability::TransientLocal;
        let mut members = self.lock();
        let own = |w: &&mut LocalWriter| Arc::ptr_eq(&w.writer, writer);
        let Some(state) = members.writers.iter_mut().find(own) else {
            return 0;
        };
        state.sent += 1;
        if !latched && state.matched.is_empty() {
            return 0;
        }
        // Handlers receive only the bytes.
        let has_queue = |r: &Arc<Reader>| matches!(r.destination, Destination::Inbox(_));
        let is_shared = latched || state.matched.iter().any(has_queue);
        let now = Time::wall();
        let gid = writer.identity();
        let identity = outgoing.identity.unwrap_or(SampleIdentity {
            writer: gid,
            sequence_number: state.sent,
        });
        let sample = LocalSample {
            raw: RawSample {
                cdr: outgoing.cdr,
                source_time: Some(now),
                received_time: now,
                publisher: gid,
                sequence_number: state.sent,
                related: outgoing.related,
                identity,
                reply_path: ReplyPath::Local,
            },
            message: outgoing.message.filter(|_| is_shared).map(|share| share()),
        };
        if latched {
            while state.kept.len() >= writer.spec.qos.depth.max(1) {
                state.kept.pop_front();
            }
            state.kept.push_back((Instant::now(), sample.clone()));
        }
        for reader in &state.matched {
            reader.receive(sample.clone(), Origin::Local);
        }
        state.matched.len()
    }

    /// GIDs of the transport's readers of reliable subscriptions.
    pub(super) fn reliable_readers(&self) -> Vec<Gid> {
        let members = self.lock();
        let reliable = members.readers.iter().filter(|r| r.spec.qos.is_reliable());
        let mut gids: Vec<Gid> = reliable.filter_map(|r| r.gid()).collect();
        // Several subscriptions may share a reader.
        gids.sort();
        gids.dedup();
        gids
    }

    /// Whether a publisher with this GID is matched with a subscription.
    pub(super) fn is_matched(&self, publisher: Gid, reader: &EndpointSpec) -> bool {
        let members = self.lock();
        let mut writers = members.writers.iter().map(|w| &w.writer);
        writers.any(|w| w.identity() == publisher && check(&w.spec, reader).is_ok())
    }

    fn lock(&self) -> MutexGuard<'_, Members> {
        self.members.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn connect(writer: &Writer, reader: &Reader) {
    writer.counters.local.fetch_add(1, Relaxed);
    reader.counters.local.fetch_add(1, Relaxed);
}

/// Checks whether a publisher and a subscription of one topic exchange messages.
fn check(offered: &EndpointSpec, requested: &EndpointSpec) -> Result<(), Mismatch> {
    if offered.dds_type != requested.dds_type {
        let (offered, requested) = (offered.dds_type.clone(), requested.dds_type.clone());
        return Err(Mismatch::Types(offered, requested));
    }
    match satisfies(&offered.qos, &requested.qos) {
        true => Ok(()),
        false => Err(Mismatch::Qos(Box::new((offered.qos, requested.qos)))),
    }
}

/// Whether an offered quality of service satisfies a requested one, by the rules of DDS.
fn satisfies(offered: &Qos, requested: &Qos) -> bool {
    let at_most = |offered: Option<_>, requested: Option<_>| match (offered, requested) {
        (_, None) => true,
        (None, Some(_)) => false,
        (Some(offered), Some(requested)) => offered <= requested,
    };
    (offered.is_reliable() || !requested.is_reliable())
        && (offered.durability == Durability::TransientLocal
            || requested.durability == Durability::Volatile)
        && at_most(offered.deadline, requested.deadline)
        && (offered.liveliness == Liveliness::ManualByTopic
            || requested.liveliness == Liveliness::Automatic)
        && at_most(
            offered.liveliness_lease_duration,
            requested.liveliness_lease_duration,
        )
}

#[cfg(test)]
mod tests;
