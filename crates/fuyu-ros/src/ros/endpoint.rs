//! Publishers and subscriptions below the handles that programs use. They persist when the session of the transport is
//! replaced.

use bytes::Bytes;
use std::{
    collections::VecDeque,
    sync::{
        Arc, Mutex, PoisonError, RwLock,
        atomic::{AtomicBool, AtomicI64, AtomicU64, AtomicUsize, Ordering::Relaxed},
    },
    time::Duration,
};

use super::{
    Gid, NodeName, Qos, RawSample, Time,
    events::StopState,
    graph_cache::GraphCache,
    handler_queue::HandlerQueue,
    held_replies::HeldReplies,
    invalid_samples::{InvalidSamples, not_of_type},
    local_delivery::{LocalSample, LocalTopic},
    qos::{Durability, History, kept},
    sample::SampleIdentity,
    transport::WireWriter,
};
use crate::msg::{Definition, Interface, ServiceDefinition};

/// Types with messages of the order of a megabyte rather than a kilobyte.
const LARGE_TYPES: [&str; 4] = [
    "sensor_msgs::msg::dds_::Image_",
    "sensor_msgs::msg::dds_::CompressedImage_",
    "sensor_msgs::msg::dds_::PointCloud2_",
    "nav_msgs::msg::dds_::OccupancyGrid_",
];

/// Topic, type and QoS of an endpoint, as other participants see them.
#[derive(Debug, Clone)]
pub(super) struct EndpointSpec {
    /// Topic name: `/joint_states`.
    pub(super) name: String,
    /// DDS topic name: `rt/joint_states`.
    pub(super) dds_topic: String,
    /// DDS type name: `sensor_msgs::msg::dds_::JointState_`.
    pub(super) dds_type: String,
    pub(super) qos: Qos,
    /// Definition of the type, if it is known in this program.
    pub(super) definition: Option<&'static Definition>,
    /// Whether the endpoint belongs to a service or to the infrastructure, which the communication diagnostics omit.
    pub(super) internal: bool,
    /// Whether all nodes of a participant share one DDS writer. This requires messages that contain the node's name.
    pub(super) shared: bool,
    /// Role of the endpoint's samples.
    pub(super) role: Role,
    /// Hash of the type that a peer or a bag states; overrides that of `definition`.
    pub(super) stated_hash: Option<String>,
}

/// Role of the samples of an endpoint.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(
    not(feature = "zenoh"),
    expect(dead_code, reason = "DDS does not tell the definition of a service")
)]
pub(super) enum Role {
    /// Messages of a topic.
    Topic,
    /// Requests of a service.
    Request(ServiceDefinition),
    /// Replies of a service.
    Reply(ServiceDefinition),
}

impl EndpointSpec {
    /// A topic of type `M` that every node has.
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
            shared: false,
            role: Role::Topic,
            stated_hash: None,
        }
    }

    /// Whether messages have a size of the order of a megabyte rather than a kilobyte.
    pub(super) fn is_large(&self) -> bool {
        LARGE_TYPES.contains(&self.dds_type.as_str())
    }

    /// Largest number of samples that wait for the handler of a subscription. A reliable subscription keeps all, up to
    /// a limit for memory.
    pub(super) fn handler_limit(&self) -> usize {
        match self.qos.is_reliable() {
            true => self.qos.depth.max(kept(self.is_large())),
            false => self.qos.depth.max(1),
        }
    }

    /// Largest number of samples of one origin in the queue of a subscription: the depth. For reliable publishers of
    /// the same participant the limit is larger, so that a late program loses no message, unless it wants only the
    /// newest (depth 1).
    pub(super) fn queue_limit(&self, origin: Origin) -> usize {
        let depth = self.qos.depth.max(1);
        match origin {
            Origin::Local if self.qos.is_reliable() && depth > 1 => {
                depth.max(kept(self.is_large()))
            }
            Origin::Local | Origin::Remote => depth,
        }
    }

    /// Key of the DDS reader that subscriptions share: those of all nodes of the participant to the same topic.
    /// Transient-local subscriptions share a reader if it keeps enough samples for a late subscription.
    pub(super) fn reader_key(&self) -> Option<String> {
        let is_topic = !self.internal || self.shared;
        let is_latched = self.qos.durability == Durability::TransientLocal;
        if !is_topic || (is_latched && self.qos.history == History::KeepAll) {
            return None;
        }
        let same = match is_latched {
            true => self.reader_qos(),
            false => Qos {
                depth: 0,
                history: History::KeepLast,
                ..self.qos
            },
        };
        Some(format!("{} {} {same:?}", self.dds_topic, self.dds_type))
    }

    /// QoS of the DDS reader. A transient-local reader keeps enough samples for further subscriptions of its
    /// participant.
    pub(super) fn reader_qos(&self) -> Qos {
        match self.qos.durability {
            Durability::TransientLocal => self.qos.depth(self.qos.depth.max(LATCHED_DEPTH)),
            Durability::Volatile => self.qos,
        }
    }

    /// Makes all nodes of a participant share one DDS writer or reader.
    pub(super) fn shared(self) -> Self {
        Self {
            shared: true,
            ..self
        }
    }
}

/// Smallest number of samples per publisher that a transient-local DDS reader keeps.
const LATCHED_DEPTH: usize = 100;

/// Counters of an endpoint, for diagnostics.
#[derive(Debug, Default)]
pub(super) struct Counters {
    pub(super) messages: AtomicU64,
    /// Messages that were dropped because a queue was full.
    pub(super) dropped: AtomicU64,
    /// Messages that a newer one replaced before the program took them; intended for a queue of depth 1, so not a loss.
    pub(super) replaced: AtomicU64,
    /// Messages that the transport refused, or that are invalid for the type.
    pub(super) failed: AtomicU64,
    /// Messages that were never received, according to the publisher's sequence numbers.
    pub(super) missing: AtomicU64,
    /// Wall time of the last message [ns].
    pub(super) last: AtomicI64,
    /// Number of matched endpoints of other participants.
    pub(super) remote: AtomicUsize,
    /// Number of matched endpoints of the same participant.
    pub(super) local: AtomicUsize,
    /// GIDs of the matched endpoints of other participants.
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

    /// Number of matched endpoints.
    pub(super) fn matched(&self) -> usize {
        self.remote.load(Relaxed) + self.local.load(Relaxed)
    }

    /// Removes the endpoints of other participants.
    pub(super) fn forget_remote(&self) {
        self.remote.store(0, Relaxed);
        let mut peers = self.peers.lock().unwrap_or_else(PoisonError::into_inner);
        peers.clear();
    }

    pub(super) fn count(&self) {
        self.messages.fetch_add(1, Relaxed);
        self.last.store(Time::wall().as_nanos(), Relaxed);
    }
}

/// A publisher below its handle.
pub(super) struct Writer {
    pub(super) spec: EndpointSpec,
    /// The node that the publisher belongs to. This pointer, not the name, identifies a node within the participant.
    pub(super) node: Arc<NodeName>,
    pub(super) counters: Counters,
    /// Number of its messages in the node's send queue; changed only under the lock of the send queue.
    pub(super) queued: AtomicUsize,
    /// Replies of a service to clients that have not been matched yet.
    pub(super) held: HeldReplies,
    /// The topic inside the participant.
    pub(super) local: Arc<LocalTopic>,
    /// Whether the count of subscriptions of other participants may be too low.
    pub(super) count_is_unsure: AtomicBool,
    wire: RwLock<Option<Arc<dyn WireWriter>>>,
    /// GID of the present or last wire; before the first wire, a GID that no other publisher has.
    identity: RwLock<Gid>,
    /// Retained messages, which late joiners must also get from a new session.
    latched: Mutex<VecDeque<(Time, Bytes)>>,
}

impl Writer {
    pub(super) fn new(spec: EndpointSpec, node: Arc<NodeName>, local: Arc<LocalTopic>) -> Self {
        Self {
            spec,
            node,
            counters: Counters::default(),
            queued: AtomicUsize::new(0),
            held: HeldReplies::default(),
            local,
            count_is_unsure: AtomicBool::new(false),
            wire: RwLock::new(None),
            identity: RwLock::new(unused_gid()),
            latched: Mutex::default(),
        }
    }

    /// Whether messages have to be sent to other participants: to present subscriptions, or retained for later ones.
    /// Messages of services are always sent, since a client may be matched before this participant detects it.
    pub(super) fn is_needed_elsewhere(&self) -> bool {
        let spec = &self.spec;
        let is_topic = matches!(spec.role, Role::Topic);
        self.counters.remote.load(Relaxed) > 0
            || spec.qos.durability == Durability::TransientLocal
            || spec.shared
            || !is_topic
            || self.count_is_unsure.load(Relaxed)
    }

    /// Identity of a sample that the transport has not sent: its number is negative, unlike those of all transports.
    pub(super) fn unwritten_identity(&self) -> SampleIdentity {
        static NEXT: AtomicI64 = AtomicI64::new(-1);
        SampleIdentity {
            writer: self.identity(),
            sequence_number: NEXT.fetch_sub(1, Relaxed),
        }
    }

    /// GID of the publisher, part of the identity of its messages.
    pub(super) fn identity(&self) -> Gid {
        *self.identity.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn wire(&self) -> Option<Arc<dyn WireWriter>> {
        let wire = self.wire.read().unwrap_or_else(PoisonError::into_inner);
        wire.clone()
    }

    pub(super) fn gid(&self) -> Option<Gid> {
        self.wire().map(|wire| wire.gid())
    }

    /// Sends a message to other participants and returns its identity, or `None` if the transport refuses it. May block for
    /// a few milliseconds while the send window is full.
    pub(super) fn write(
        &self,
        cdr: Bytes,
        published: Time,
        related: Option<SampleIdentity>,
    ) -> Option<SampleIdentity> {
        let mut latched = self.latched.lock().unwrap_or_else(PoisonError::into_inner);
        if self.spec.qos.durability == Durability::TransientLocal {
            while latched.len() >= self.spec.qos.depth.max(1) {
                latched.pop_front();
            }
            latched.push_back((published, cdr.clone()));
        }
        // Either the present session sends the message, or the next one does, with the other retained messages.
        let wire = self.wire();
        drop(latched);
        let identity = wire.and_then(|wire| wire.write(cdr, published, related));
        match identity {
            Some(_) => self.counters.count(),
            None => {
                self.counters.failed.fetch_add(1, Relaxed);
            }
        }
        identity
    }

    /// Waits until living subscribers of other participants have acknowledged all messages, at most `timeout`. Returns
    /// whether they have. Returns at once for best-effort publishers and without such subscribers, where DDS would
    /// wait.
    pub(super) fn wait_for_all_acked(&self, timeout: Duration) -> bool {
        match self.wire() {
            Some(wire) if self.spec.qos.is_reliable() && self.counters.remote.load(Relaxed) > 0 => {
                wire.wait_for_all_acked(timeout)
            }
            _ => true,
        }
    }

    /// Waits, before the writer leaves, until living subscribers of other participants have taken all messages: at most
    /// `timeout` for their acknowledgements, plus the linger time of the transport after the last message.
    pub(super) fn finish(&self, timeout: Duration) {
        let is_awaited = self.spec.qos.is_reliable() && self.counters.remote.load(Relaxed) > 0;
        let Some(wire) = self.wire().filter(|_| is_awaited) else {
            return;
        };
        wire.wait_for_all_acked(timeout);
        let last = Time::from_nanos(self.counters.last.load(Relaxed));
        std::thread::sleep(wire.linger().saturating_sub(Time::wall().since(last)));
    }

    /// Replaces the wire and returns the previous one.
    pub(super) fn attach<W: WireWriter + 'static>(
        &self,
        wire: Option<Arc<W>>,
    ) -> Option<Arc<dyn WireWriter>> {
        let wire = wire.map(|wire| wire as Arc<dyn WireWriter>);
        // Locked until the end, so that every message is sent by either the old or the new wire.
        let mut latched = self.latched.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(new) = &wire {
            if let Some(lifespan) = self.spec.qos.lifespan {
                let now = Time::wall();
                latched.retain(|(published, _)| now.since(*published) <= lifespan);
            }
            for (published, cdr) in latched.iter() {
                if new.write(cdr.clone(), *published, None).is_none() {
                    self.counters.failed.fetch_add(1, Relaxed);
                }
            }
            let mut identity = self
                .identity
                .write()
                .unwrap_or_else(PoisonError::into_inner);
            *identity = new.gid();
        }
        let mut current = self.wire.write().unwrap_or_else(PoisonError::into_inner);
        std::mem::replace(&mut *current, wire)
    }

    /// Removes the wire and returns it.
    pub(super) fn detach(&self) -> Option<Arc<dyn WireWriter>> {
        let _latched = self.latched.lock().unwrap_or_else(PoisonError::into_inner);
        let mut current = self.wire.write().unwrap_or_else(PoisonError::into_inner);
        current.take()
    }
}

/// A GID that no participant uses: its prefix is not that of a DDS vendor.
fn unused_gid() -> Gid {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let mut bytes = [0; 16];
    bytes[8..].copy_from_slice(&NEXT.fetch_add(1, Relaxed).to_be_bytes());
    bytes.into()
}

/// Callback for every sample. Returns whether the sample was valid.
pub(super) type Sink = Box<dyn Fn(RawSample, &Counters) -> bool + Send + Sync>;

/// A queue that the program empties itself.
pub(super) trait Inbox: Send + Sync {
    /// Adds a sample; returns false if it is not of the expected type. Must be fast and must not call the program's
    /// code.
    fn accept(&self, sample: LocalSample, origin: Origin, counters: &Counters) -> bool;
}

/// Where a sample comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// From a publisher of the same participant, in memory.
    Local,
    /// From another participant, through the transport.
    Remote,
}

/// Destination of a subscription's samples.
pub(super) enum Destination {
    /// A queue, filled by the thread that publishes or receives.
    Inbox(Arc<dyn Inbox>),
    /// A handler, which runs on the receiving thread of the node.
    Handler(Handler),
}

/// A handler of samples.
pub(super) struct Handler {
    pub(super) sink: Sink,
    /// Longest time that a sample may wait, so that the thread handles several at once; zero to handle it at once.
    pub(super) patience: Duration,
    /// Samples of the node that wait for handlers.
    pub(super) queue: Arc<HandlerQueue>,
}

/// A subscription below its handle.
pub(super) struct Reader {
    pub(super) spec: EndpointSpec,
    /// The node that the subscription belongs to. This pointer, not the name, identifies a node within the participant.
    pub(super) node: Arc<NodeName>,
    pub(super) counters: Counters,
    pub(super) destination: Destination,
    /// The topic inside the participant.
    pub(super) local: Arc<LocalTopic>,
    invalid: Mutex<InvalidSamples>,
    gid: Mutex<Option<Gid>>,
}

impl Reader {
    pub(super) fn new(
        spec: EndpointSpec,
        node: Arc<NodeName>,
        destination: Destination,
        local: Arc<LocalTopic>,
    ) -> Self {
        Self {
            spec,
            node,
            counters: Counters::default(),
            destination,
            local,
            invalid: Mutex::default(),
            gid: Mutex::new(None),
        }
    }

    /// Passes a sample to its destination. Returns false if the sample is known not to be of the expected type;
    /// handlers check it later.
    pub(super) fn receive(self: &Arc<Self>, sample: LocalSample, origin: Origin) -> bool {
        self.counters.count();
        match &self.destination {
            Destination::Inbox(inbox) => {
                let is_valid = inbox.accept(sample, origin, &self.counters);
                if !is_valid {
                    self.counters.failed.fetch_add(1, Relaxed);
                }
                is_valid
            }
            Destination::Handler(handler) => {
                handler.queue.push(self, sample.raw, handler.patience);
                true
            }
        }
    }

    /// As [`Self::receive`], for a sample of another participant; logs invalid samples.
    pub(super) fn receive_remote(self: &Arc<Self>, sample: RawSample, graph: &GraphCache) {
        let (publisher, length) = (sample.publisher, sample.cdr.len());
        if !self.receive(sample.into(), Origin::Remote) {
            let problem = not_of_type(&self.spec, length);
            self.report_invalid(graph, Some(publisher), &problem);
        }
    }

    /// Logs an invalid sample, at a limited rate.
    pub(super) fn report_invalid(&self, graph: &GraphCache, publisher: Option<Gid>, problem: &str) {
        let invalid = self.invalid.lock();
        let mut invalid = invalid.unwrap_or_else(PoisonError::into_inner);
        invalid.report((&self.node, graph), &self.spec, publisher, problem);
    }

    pub(super) fn set_gid(&self, gid: Gid) {
        *self.gid.lock().unwrap_or_else(PoisonError::into_inner) = Some(gid);
    }

    pub(super) fn gid(&self) -> Option<Gid> {
        *self.gid.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The nodes of a participant with their present endpoints.
#[derive(Default)]
pub(super) struct Endpoints {
    pub(super) nodes: Vec<Member>,
    pub(super) writers: Vec<Arc<Writer>>,
    pub(super) readers: Vec<Arc<Reader>>,
}

/// A node of a participant.
#[derive(Clone)]
pub(super) struct Member {
    pub(super) name: Arc<NodeName>,
    pub(super) stop_state: Arc<StopState>,
}

/// Removes the wires of all publishers and returns them; the session can end once they are dropped.
pub(super) fn detach(endpoints: &Endpoints) -> Vec<Arc<dyn WireWriter>> {
    let writers = endpoints.writers.iter();
    writers.filter_map(|writer| writer.detach()).collect()
}

impl Endpoints {
    /// Whether a node is in the graph.
    pub(super) fn has_node(&self, node: &Arc<NodeName>) -> bool {
        self.nodes.iter().any(|n| Arc::ptr_eq(&n.name, node))
    }
}
