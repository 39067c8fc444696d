//! Receiving thread of a DDS participant, which waits for all its readers at once.

use rustdds::{
    DomainParticipant, GUID, QosPolicies, RTPSEntity, TopicKind,
    bytes::Bytes,
    mio1::{Events as PollEvents, Interest, Poll, Token},
};
use std::{
    collections::{HashMap, VecDeque},
    io,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc,
    },
    time::{Duration, Instant},
};

use super::{
    announcer::{self, Announcer},
    discovery_settling::DiscoverySettling,
    lost_peers::LostPeers,
    participant_watchdog,
    peers::{Peers, report_status},
    qos::for_reader,
    raw_endpoints::{CdrPassthrough, RawReader},
    ros_discovery_info,
    rtps_sender::RtpsSender,
};
use crate::ros::{
    Gid, Qos, RawSample,
    endpoint::{Endpoints, Reader},
    graph_cache::GraphCache,
    qos::{Durability, History},
    transport::{SequenceNumbers, TransportError},
};

pub(super) const WAKER: Token = Token(0);
const STATUS: Token = Token(1);
const ANNOUNCEMENTS: Token = Token(2);
const FIRST_READER: usize = 3;

/// Delay of the announcement after a change, so that the many endpoints of a new node are announced together.
const ANNOUNCEMENT_DELAY: Duration = Duration::from_millis(20);

/// Largest number of participants with unprocessed announcements.
const ANNOUNCEMENTS_DEPTH: usize = 100;

/// A request to the receiving thread.
pub(super) enum Request {
    /// Receive for a subscription; these earlier samples come first.
    Add(Box<RawReader>, Arc<Reader>, VecDeque<RawSample>),
    /// Receive for a subscription from a shared DDS reader.
    Join(Gid, Arc<Reader>),
    /// Stop receiving for a subscription.
    Remove(Arc<Reader>),
    /// Update a DDS writer after a publisher has joined it.
    Update(Gid),
    /// The DDS writer with this GID no longer exists.
    ForgetWriter(Gid),
    /// Announce the nodes and endpoints, which have changed.
    Announce,
}

/// Creates the reader of `ros_discovery_info`.
pub(super) fn subscribe_to_announcements(
    participant: &DomainParticipant,
    subscriber: &rustdds::Subscriber,
) -> Result<Box<RawReader>, TransportError> {
    let qos = for_reader(&Qos::LATCHED.depth(ANNOUNCEMENTS_DEPTH), false);
    let subscriber = subscriber.clone();
    let reader = participant_watchdog::create(participant, move |participant| {
        let (name, kind) = announcer::TOPIC;
        let topic_qos = QosPolicies::from(&Qos::LATCHED);
        let topic =
            participant.create_topic(name.into(), kind.into(), &topic_qos, TopicKind::NoKey)?;
        subscriber.create_simple_datareader_no_key::<Bytes, CdrPassthrough>(&topic, Some(qos))
    })?;
    Ok(Box::new(reader))
}

/// The receiving thread of a participant.
pub(super) struct Receiver {
    pub(super) poll: Poll,
    pub(super) inbox: mpsc::Receiver<Request>,
    pub(super) stop: Arc<AtomicBool>,
    pub(super) participant: DomainParticipant,
    pub(super) announcer: Arc<Announcer>,
    pub(super) announcements: Box<RawReader>,
    pub(super) endpoints: Arc<Mutex<Endpoints>>,
    pub(super) graph: Arc<GraphCache>,
    pub(super) settling: Arc<DiscoverySettling>,
    pub(super) lost_peers: Arc<LostPeers>,
    pub(super) rtps: Option<Arc<RtpsSender>>,
}

impl Receiver {
    pub(super) fn run(mut self) -> io::Result<()> {
        let mut readers = Readers {
            own: self.participant.guid(),
            graph: Arc::clone(&self.graph),
            states: HashMap::new(),
            next: FIRST_READER,
        };
        let mut peers = Peers::new(self.rtps.take());
        let mut status = self.participant.status_listener();
        let registry = self.poll.registry();
        registry.register(&mut status, STATUS, Interest::READABLE)?;
        registry.register(&mut *self.announcements, ANNOUNCEMENTS, Interest::READABLE)?;
        // Announcements from before the registration.
        self.take_announcements();
        let mut announce_at: Option<Instant> = None;
        let mut events = PollEvents::with_capacity(64);
        while !self.stop.load(Relaxed) {
            let wait = announce_at.map(|at| at.saturating_duration_since(Instant::now()));
            let wait = wait.into_iter().chain(peers.first_samples.timeout()).min();
            match self.poll.poll(&mut events, wait) {
                Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                outcome => outcome?,
            }
            // Status events come first, so that a subscription is known before the messages that its participant sends
            // afterwards.
            let others = (&*self.graph, &*self.settling, &*self.lost_peers);
            report_status(&status, &self.endpoints, &mut peers, others);
            for event in &events {
                match event.token() {
                    WAKER => {}
                    STATUS => readers.forget_lost_publishers(&peers),
                    ANNOUNCEMENTS => self.take_announcements(),
                    Token(token) => readers.take(token),
                }
            }
            (peers.first_samples).request(|reader, writer| readers.has_sample(reader, writer));
            while let Ok(request) = self.inbox.try_recv() {
                match request {
                    Request::Add(dds, reader, earlier) => {
                        let gid = dds.guid().into();
                        readers.add(&self.poll, dds, reader, earlier);
                        self.update(&mut peers, gid);
                    }
                    Request::Join(gid, reader) => {
                        readers.join(gid, reader, &peers);
                        self.update(&mut peers, gid);
                    }
                    Request::Update(gid) => self.update(&mut peers, gid),
                    Request::Remove(reader) => {
                        if let Some(gid) = readers.remove(&reader) {
                            peers.forget(gid);
                        }
                    }
                    Request::ForgetWriter(gid) => peers.forget(gid),
                    Request::Announce => {
                        announce_at.get_or_insert_with(|| Instant::now() + ANNOUNCEMENT_DELAY);
                    }
                }
            }
            if announce_at.is_some_and(|at| at <= Instant::now()) {
                announce_at = None;
                let endpoints = self.endpoints.lock();
                let nodes = announcer::nodes(&endpoints.unwrap_or_else(PoisonError::into_inner));
                self.announcer.publish(nodes);
            }
        }
        Ok(())
    }

    /// Updates one of this participant's DDS endpoints, which may have been matched before this thread knew it.
    fn update(&self, peers: &mut Peers, local: Gid) {
        let endpoints = self.endpoints.lock();
        peers.update(&endpoints.unwrap_or_else(PoisonError::into_inner), local);
    }

    fn take_announcements(&self) {
        self.announcements.drain_read_notifications();
        // A sample that cannot be read is skipped.
        while let Some(change) = self.announcements.try_take_one().transpose() {
            if let Ok(change) = change {
                let sample = RawSample::from(change);
                ros_discovery_info::receive(&self.graph, sample.publisher, &sample.cdr);
            }
        }
    }
}

/// DDS readers of a participant by token. Tokens are not reused.
struct Readers {
    /// GUID of this participant. Its own samples are ignored, since they have been delivered in memory.
    own: GUID,
    graph: Arc<GraphCache>,
    states: HashMap<usize, ReaderState>,
    next: usize,
}

/// A DDS reader with its subscriptions.
struct ReaderState {
    dds: Box<RawReader>,
    /// The subscriptions that the DDS reader serves.
    readers: Vec<Arc<Reader>>,
    /// Sequence number of the last sample of each publisher.
    last: SequenceNumbers,
    /// Last samples of each publisher, oldest first, for late transient-local subscriptions.
    kept: HashMap<Gid, VecDeque<RawSample>>,
}

impl Readers {
    fn add(
        &mut self,
        poll: &Poll,
        mut dds: Box<RawReader>,
        reader: Arc<Reader>,
        earlier: VecDeque<RawSample>,
    ) {
        let (token, registry) = (Token(self.next), poll.registry());
        if let Err(e) = registry.register(&mut *dds, token, Interest::READABLE) {
            let (node, topic) = (&reader.node, &reader.spec.name);
            tracing::error!("node {node}: cannot receive {topic}: {e}");
        }
        let mut state = ReaderState {
            dds,
            readers: vec![reader],
            last: SequenceNumbers::default(),
            kept: HashMap::new(),
        };
        for sample in earlier {
            state.receive(sample, self.own, &self.graph);
        }
        // Samples that arrived before the registration.
        state.take_all(self.own, &self.graph);
        self.states.insert(self.next, state);
        self.next += 1;
    }

    fn join(&mut self, gid: Gid, reader: Arc<Reader>, peers: &Peers) {
        let mut states = self.states.values_mut();
        if let Some(state) = states.find(|state| state.gid() == gid) {
            state.kept.retain(|&p, _| peers.are_matched(gid, p));
            for kept in state.kept.values() {
                let others = kept.len().saturating_sub(reader.spec.qos.depth.max(1));
                for sample in kept.iter().skip(others) {
                    reader.receive_remote(sample.clone(), &self.graph);
                }
            }
            state.readers.push(reader);
        }
    }

    /// Removes the retained samples of publishers that have left; late subscriptions do not receive them.
    fn forget_lost_publishers(&mut self, peers: &Peers) {
        for state in self.states.values_mut() {
            let gid = state.gid();
            state.kept.retain(|&p, _| peers.are_matched(gid, p));
        }
    }

    /// Stops receiving for a subscription. Returns the GID of its DDS reader if no other subscription uses it.
    fn remove(&mut self, reader: &Arc<Reader>) -> Option<Gid> {
        let serves = |state: &ReaderState| state.readers.iter().any(|r| Arc::ptr_eq(r, reader));
        let (&token, state) = self.states.iter_mut().find(|(_, state)| serves(state))?;
        state.readers.retain(|r| !Arc::ptr_eq(r, reader));
        if !state.readers.is_empty() {
            return None;
        }
        self.states.remove(&token).map(|state| state.gid())
    }

    /// Whether the DDS reader with this GUID has received a sample of a writer.
    fn has_sample(&self, reader: GUID, writer: GUID) -> bool {
        let mut states = self.states.values();
        let state = states.find(|state| state.dds.guid() == reader);
        state.is_some_and(|state| state.last.has_any_of(writer.into()))
    }

    fn take(&mut self, token: usize) {
        if let Some(state) = self.states.get_mut(&token) {
            state.take_all(self.own, &self.graph);
        }
    }
}

impl ReaderState {
    fn gid(&self) -> Gid {
        self.dds.guid().into()
    }

    fn take_all(&mut self, own: GUID, graph: &GraphCache) {
        self.dds.drain_read_notifications();
        loop {
            match self.dds.try_take_one() {
                Ok(None) => return,
                Ok(Some(change)) => self.receive(change.into(), own, graph),
                // The DDS reader has skipped an invalid sample.
                Err(e) => {
                    for reader in &self.readers {
                        reader.counters.failed.fetch_add(1, Relaxed);
                        reader.report_invalid(graph, None, &e.to_string());
                    }
                }
            }
        }
    }

    fn receive(&mut self, sample: RawSample, own: GUID, graph: &GraphCache) {
        if GUID::from(sample.publisher).prefix == own.prefix {
            return;
        }
        let missing = self
            .last
            .missing_before(sample.publisher, sample.sequence_number);
        for reader in &self.readers {
            reader.counters.missing.fetch_add(missing, Relaxed);
            reader.receive_remote(sample.clone(), graph);
        }
        let qos = self.readers.first().map(|reader| reader.spec.reader_qos());
        let is_kept =
            |q: &Qos| q.durability == Durability::TransientLocal && q.history == History::KeepLast;
        if let Some(qos) = qos.filter(is_kept) {
            let kept = self.kept.entry(sample.publisher).or_default();
            while kept.len() >= qos.depth {
                kept.pop_front();
            }
            kept.push_back(sample);
        }
    }
}
