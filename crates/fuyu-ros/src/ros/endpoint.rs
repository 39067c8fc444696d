//! Publishers and subscriptions below their handles; they outlive a DDS participant.

use rustdds::{GUID, RTPSEntity, SequenceNumber, bytes::Bytes, rpc::SampleIdentity};
use std::{
    collections::VecDeque,
    sync::{
        Arc, Mutex, PoisonError, RwLock,
        atomic::{AtomicI64, AtomicU64, AtomicUsize, Ordering::Relaxed},
    },
    time::Duration,
};

use super::{
    Gid, Qos, RawSample, Time, held_replies::HeldReplies, qos::Durability,
    raw_endpoints::RawWriter, rtps_sender::RtpsSender,
};
use crate::msg::{Definition, Interface};

/// Topic, type and QoS of an endpoint, as DDS sees them.
#[derive(Debug, Clone)]
pub(super) struct EndpointSpec {
    /// Name for people: `/joint_states`.
    pub(super) name: String,
    /// `rt/joint_states`
    pub(super) dds_topic: String,
    /// `sensor_msgs::msg::dds_::JointState_`
    pub(super) dds_type: String,
    pub(super) qos: Qos,
    /// Definition of the type, if it is known here.
    pub(super) definition: Option<&'static Definition>,
    /// Services and infrastructure are left out of the communication diagnostics.
    pub(super) internal: bool,
}

impl EndpointSpec {
    /// A topic of type `M`, part of every node.
    pub(super) fn topic<M: Interface>(name: &str, qos: Qos) -> Self {
        Self {
            name: name.to_owned(),
            dds_topic: format!("rt{name}"),
            dds_type: format!(
                "{}::{}::dds_::{}_",
                M::PACKAGE,
                M::DEFINITION.kind.name(),
                M::NAME
            ),
            qos,
            definition: Some(M::DEFINITION),
            internal: true,
        }
    }
}

/// Counters of an endpoint, for diagnostics.
#[derive(Debug, Default)]
pub(super) struct Counters {
    pub(super) messages: AtomicU64,
    /// Dropped because a queue was full.
    pub(super) dropped: AtomicU64,
    /// Replaced by a newer message before the program took them; intended for a queue of one, so not a loss.
    pub(super) replaced: AtomicU64,
    /// Refused by DDS, or not valid for the type.
    pub(super) failed: AtomicU64,
    /// Never received, according to the sequence numbers of the publisher.
    pub(super) missing: AtomicU64,
    /// Wall time of the last message [ns].
    pub(super) last: AtomicI64,
    /// Peers that this endpoint is matched with.
    pub(super) matched: AtomicUsize,
    /// GIDs of the matched peers.
    pub(super) peers: Mutex<Vec<Gid>>,
}

impl Counters {
    /// Messages that were lost because a queue was full or a datagram did not arrive.
    pub(super) fn overrun(&self) -> u64 {
        self.dropped.load(Relaxed) + self.missing.load(Relaxed)
    }

    /// All messages that were lost.
    pub(super) fn lost(&self) -> u64 {
        [&self.dropped, &self.failed, &self.missing]
            .iter()
            .map(|n| n.load(Relaxed))
            .sum()
    }

    /// For a new DDS endpoint, which is not matched with any peer yet.
    pub(super) fn forget_peers(&self) {
        self.matched.store(0, Relaxed);
        let mut peers = self.peers.lock().unwrap_or_else(PoisonError::into_inner);
        peers.clear();
    }

    pub(super) fn count(&self) {
        self.messages.fetch_add(1, Relaxed);
        self.last.store(Time::wall().as_nanos(), Relaxed);
    }
}

/// One publisher below its handle.
pub(super) struct Writer {
    pub(super) spec: EndpointSpec,
    pub(super) counters: Counters,
    /// How many of its messages wait in the node's send_queue; changed under the send_queue's lock only.
    pub(super) queued: AtomicUsize,
    /// Replies of a service whose clients have not been matched yet.
    pub(super) held: HeldReplies,
    dds: RwLock<Option<Arc<RawWriter>>>,
    /// Sends replies that rustdds cannot send.
    rtps: RwLock<Option<Arc<RtpsSender>>>,
    /// Sequence number of the last sample of the DDS writer.
    last_number: AtomicI64,
    /// Messages that late joiners must get from a new participant.
    latched: Mutex<VecDeque<(rustdds::Timestamp, Bytes)>>,
}

impl Writer {
    pub(super) fn new(spec: EndpointSpec) -> Self {
        Self {
            spec,
            counters: Counters::default(),
            queued: AtomicUsize::new(0),
            held: HeldReplies::default(),
            dds: RwLock::new(None),
            rtps: RwLock::default(),
            last_number: AtomicI64::new(0),
            latched: Mutex::default(),
        }
    }

    fn dds(&self) -> Option<Arc<RawWriter>> {
        let dds = self.dds.read().unwrap_or_else(PoisonError::into_inner);
        dds.clone()
    }

    pub(super) fn gid(&self) -> Option<Gid> {
        self.dds().map(|w| w.guid().into())
    }

    /// Writes a message to DDS and returns its identity, or `None` if DDS refuses it. May block for a few milliseconds
    /// while the send window is full.
    pub(super) fn write(
        &self,
        cdr: Bytes,
        published: rustdds::Timestamp,
        related: Option<SampleIdentity>,
    ) -> Option<SampleIdentity> {
        let mut latched = self.latched.lock().unwrap_or_else(PoisonError::into_inner);
        if self.spec.qos.durability == Durability::TransientLocal {
            while latched.len() >= self.spec.qos.depth.max(1) {
                latched.pop_front();
            }
            latched.push_back((published, cdr.clone()));
        }
        // The participant that is there now, or else the next one gets it with the other retained ones.
        let dds = self.dds();
        drop(latched);
        let mut options = rustdds::WriteOptionsBuilder::new()
            .source_timestamp(published)
            .related_sample_identity_opt(related);
        let mut cdr = cdr;
        if let (Some(dds), Some(request)) = (&dds, related)
            && self.send_long_reply(dds.guid(), request, &cdr)
        {
            // A sample to nobody: it takes the sequence number, and is announced to all other clients as irrelevant.
            options = options.to_single_reader(dds.guid());
            cdr = Bytes::new();
        }
        match dds.map(|w| w.write_with_options(cdr, options.build())) {
            Some(Ok(identity)) => {
                let number = i64::from(identity.sequence_number);
                self.last_number.store(number, Relaxed);
                self.counters.count();
                Some(identity)
            }
            Some(Err(_)) | None => {
                self.counters.failed.fetch_add(1, Relaxed);
                None
            }
        }
    }

    /// Sends a reply that is too long for rustdds with the next sequence number of the DDS writer; false if it is not too
    /// long. Before the sample is written: from then on rustdds says that there is nothing for the client to receive.
    fn send_long_reply(&self, writer: GUID, request: SampleIdentity, cdr: &[u8]) -> bool {
        // Not locked meanwhile: a participant that has deadlocked does not answer.
        let rtps = self
            .rtps
            .read()
            .unwrap_or_else(PoisonError::into_inner)
            .clone();
        let topic = &self.spec.dds_topic;
        let Some(rtps) = rtps.filter(|r| r.must_send(topic, cdr.len())) else {
            return false;
        };
        let number = SequenceNumber::from(self.last_number.load(Relaxed) + 1);
        rtps.send_reply((writer, number), topic, request, cdr);
        true
    }

    /// Sets what sends the replies that rustdds cannot send. Only for the present DDS writer.
    pub(super) fn set_rtps_sender(&self, rtps: Option<Arc<RtpsSender>>) {
        *self.rtps.write().unwrap_or_else(PoisonError::into_inner) = rtps;
    }

    /// Waits until living subscribers have what was written, at most `patience`.
    pub(super) fn wait_for_acknowledgments(&self, patience: Duration) {
        if let Some(dds) = self.dds()
            && self.spec.qos.is_reliable()
        {
            // A subscriber that has not acknowledged by then is dead or overloaded.
            let _ = dds.wait_for_acknowledgments(patience);
        }
    }

    /// Replaces the DDS writer and returns the previous one.
    pub(super) fn attach(&self, dds: Option<Arc<RawWriter>>) -> Option<Arc<RawWriter>> {
        // Held until the end, so that what is published meanwhile goes to one of the two.
        let mut latched = self.latched.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(new) = &dds {
            if let Some(lifespan) = self.spec.qos.lifespan {
                let now = rustdds::Timestamp::now();
                latched.retain(|(published, _)| (now - *published).to_std() <= lifespan);
            }
            for (published, cdr) in latched.iter() {
                if new.write(cdr.clone(), Some(*published)).is_err() {
                    self.counters.failed.fetch_add(1, Relaxed);
                }
            }
        }
        self.set_rtps_sender(None);
        self.last_number.store(0, Relaxed);
        let mut current = self.dds.write().unwrap_or_else(PoisonError::into_inner);
        std::mem::replace(&mut *current, dds)
    }
}

/// Called on the node's receiving thread with every sample. Returns whether the sample was valid.
pub(super) type Sink = Box<dyn Fn(RawSample, &Counters) -> bool + Send + Sync>;

/// One subscription below its handle.
pub(super) struct Reader {
    pub(super) spec: EndpointSpec,
    pub(super) counters: Counters,
    pub(super) sink: Sink,
    gid: Mutex<Option<Gid>>,
}

impl Reader {
    pub(super) fn new(spec: EndpointSpec, sink: Sink) -> Self {
        Self {
            spec,
            counters: Counters::default(),
            sink,
            gid: Mutex::new(None),
        }
    }

    pub(super) fn set_gid(&self, gid: Gid) {
        *self.gid.lock().unwrap_or_else(PoisonError::into_inner) = Some(gid);
    }

    pub(super) fn gid(&self) -> Option<Gid> {
        *self.gid.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// All endpoints that a node has at the moment.
#[derive(Default)]
pub(super) struct Endpoints {
    pub(super) writers: Vec<Arc<Writer>>,
    pub(super) readers: Vec<Arc<Reader>>,
}
