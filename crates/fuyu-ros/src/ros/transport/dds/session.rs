//! A connected DDS participant with the endpoints of its nodes. A session can be replaced while the handles of the
//! endpoints stay valid.

use rustdds::{
    DomainParticipant, GUID, QosPolicies, RTPSEntity, Topic, TopicKind,
    bytes::Bytes,
    mio1::{Poll, Waker},
};
use std::{
    collections::{HashMap, HashSet, VecDeque},
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, Mutex, PoisonError, Weak,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc,
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use super::{
    announcer::{self, Announcer},
    dds_discovery::DdsDiscovery,
    discovery_settling::DiscoverySettling,
    domain_participant,
    lost_peers::LostPeers,
    participant_watchdog,
    qos::for_reader,
    raw_endpoints::{CdrPassthrough, RawReader},
    receiver::{self, Receiver, Request},
    ros_discovery_info,
    rtps_sender::RtpsSender,
    static_peers::StaticPeers,
    writer::DdsWriter,
};
use crate::ros::{
    Domain, Gid, Qos, RawSample,
    endpoint::{self, EndpointSpec, Endpoints, Reader, Writer},
    qos::Durability,
    transport::{Discovery, Session, Shared, TransportError, WireWriter},
};

/// How long a new participant waits for the writers that its predecessor knew. The writers of a living peer are
/// discovered again within about a second.
const REDISCOVERY_OF_WRITERS: Duration = Duration::from_millis(1500);
const POLL: Duration = Duration::from_millis(5);

/// A connected participant.
pub(super) struct DdsSession {
    participant: DomainParticipant,
    publisher: rustdds::Publisher,
    subscriber: rustdds::Subscriber,
    /// DDS topics by name and type.
    topics: HashMap<(String, String), Topic>,
    /// Shared DDS writers by topic.
    shared_writers: HashMap<String, Weak<DdsWriter>>,
    /// Shared DDS readers by key ([`EndpointSpec::reader_key`]), with the number of their subscriptions.
    shared_readers: HashMap<String, (Gid, usize)>,
    /// Topics for which a DDS reader was created.
    read_topics: HashSet<String>,
    announcer: Arc<Announcer>,
    endpoints: Arc<Mutex<Endpoints>>,
    requests: mpsc::Sender<Request>,
    waker: Arc<Waker>,
    rtps: Option<Arc<RtpsSender>>,
    discovery: Arc<DdsDiscovery>,
    stop: Arc<AtomicBool>,
    receiver: Option<JoinHandle<()>>,
}

impl DdsSession {
    /// Creates a participant with all endpoints of `endpoints`. Its threads inherit the caller's signal mask.
    pub(super) fn open(
        (domain, static_peers): (Domain, &StaticPeers),
        Shared { endpoints, graph }: &Shared,
        settling: &Arc<DiscoverySettling>,
    ) -> Result<Self, TransportError> {
        let peers = static_peers.addresses();
        let participant =
            domain_participant::create(domain, &peers).map_err(TransportError::Other)?;
        settling.participant_created();
        let rediscovered_until = Instant::now() + REDISCOVERY_OF_WRITERS;
        ros_discovery_info::reset(graph, participant.guid());
        let qos = QosPolicies::from(&Qos::RELIABLE);
        let publisher = participant
            .create_publisher(&qos)
            .map_err(TransportError::other)?;
        let subscriber = participant
            .create_subscriber(&qos)
            .map_err(TransportError::other)?;
        let announcer = Arc::new(Announcer::new(&participant, &publisher)?);
        let announcements = receiver::subscribe_to_announcements(&participant, &subscriber)?;

        let poll = Poll::new().map_err(TransportError::other)?;
        let waker = Waker::new(poll.registry(), receiver::WAKER).map_err(TransportError::other)?;
        let (requests, inbox) = mpsc::channel();
        let stop = Arc::new(AtomicBool::new(false));
        let rtps = RtpsSender::new(participant.clone(), domain.range, !peers.is_empty())
            .inspect_err(|e| tracing::warn!("long replies may not arrive: {e}"));
        let rtps = rtps.ok().map(Arc::new);
        let lost_peers = Arc::new(LostPeers::default());
        let receiver = Receiver {
            poll,
            inbox,
            stop: Arc::clone(&stop),
            participant: participant.clone(),
            announcer: Arc::clone(&announcer),
            announcements,
            endpoints: Arc::clone(endpoints),
            graph: Arc::clone(graph),
            settling: Arc::clone(settling),
            lost_peers: Arc::clone(&lost_peers),
            rtps: rtps.clone(),
        };
        let all = Arc::clone(endpoints);
        let receiver = thread::Builder::new()
            .name("dds.receive".to_owned())
            .spawn(move || {
                let why = match catch_unwind(AssertUnwindSafe(|| receiver.run())) {
                    Ok(Ok(())) => return,
                    Ok(Err(e)) => format!("receiving has ended: {e}"),
                    Err(_) => "the receiving thread has panicked".to_owned(),
                };
                // Nodes that cannot receive must not continue to run.
                let nodes = lock(&all).nodes.clone();
                for node in nodes {
                    node.stop_state.fail(format!("node {}: {why}", node.name));
                }
            })
            .map_err(TransportError::other)?;
        let place = (domain, static_peers.clone());
        let discovery = DdsDiscovery::new(participant.clone(), place, lost_peers);
        let mut session = Self {
            participant,
            publisher,
            subscriber,
            topics: HashMap::new(),
            shared_writers: HashMap::new(),
            shared_readers: HashMap::new(),
            read_topics: HashSet::new(),
            announcer,
            endpoints: Arc::clone(endpoints),
            requests,
            waker: Arc::new(waker),
            rtps,
            discovery: Arc::new(discovery),
            stop,
            receiver: Some(receiver),
        };
        if let Err(e) = session.create_all(endpoints, settling, rediscovered_until) {
            let writers = endpoint::detach(&lock(endpoints));
            return Err(e.abandoning((writers, session)));
        }
        session.announce();
        Ok(session)
    }

    fn create_all(
        &mut self,
        endpoints: &Mutex<Endpoints>,
        settling: &DiscoverySettling,
        rediscovered_until: Instant,
    ) -> Result<(), TransportError> {
        let (writers, readers) = {
            let all = lock(endpoints);
            (all.writers.clone(), all.readers.clone())
        };
        for writer in &writers {
            settling.wait();
            self.create_writer(writer)?;
        }
        self.wait_for_writers(&readers, rediscovered_until);
        for reader in &readers {
            settling.wait();
            self.create_reader(reader)?;
        }
        Ok(())
    }

    /// Waits until the Fast DDS writers have been discovered that were matched with these subscriptions in the previous
    /// participant.
    ///
    /// After a match with a new reader, Fast DDS sends once which samples the reader will not get. If the new
    /// participant does not know the writer yet, the message is lost; the participant then considers later samples
    /// incomplete and withholds them for three to six seconds (docs/upstream.md). A reader that is created after the
    /// discovery of the writer receives the message.
    fn wait_for_writers(&self, readers: &[Arc<Reader>], deadline: Instant) {
        let mut expected = HashSet::new();
        for reader in readers.iter().filter(|r| r.spec.qos.is_reliable()) {
            let peers = reader.counters.peers.lock();
            let peers = peers.unwrap_or_else(PoisonError::into_inner);
            let peers = peers.iter().map(|&gid| GUID::from(gid));
            expected.extend(peers.filter(|&writer| RtpsSender::must_request_from(writer)));
        }
        while !expected.is_empty() && Instant::now() < deadline {
            for writer in self.participant.discovered_writers() {
                expected.remove(&writer.writer_proxy.remote_writer_guid);
            }
            if !expected.is_empty() {
                thread::sleep(POLL);
            }
        }
    }

    fn send(&self, request: Request) {
        // Sending fails only if the thread has ended, at the end of this session.
        if self.requests.send(request).is_ok() {
            let _ = self.waker.wake();
        }
    }

    fn topic(&mut self, spec: &EndpointSpec) -> Result<Topic, TransportError> {
        let key = (spec.dds_topic.clone(), spec.dds_type.clone());
        if let Some(topic) = self.topics.get(&key) {
            return Ok(topic.clone());
        }
        let (name, kind) = key.clone();
        let qos = QosPolicies::from(&spec.qos);
        let topic = participant_watchdog::create(&self.participant, move |participant| {
            participant.create_topic(name, kind, &qos, TopicKind::NoKey)
        })?;
        self.topics.insert(key, topic.clone());
        Ok(topic)
    }

    fn create_writer(&mut self, writer: &Writer) -> Result<(), TransportError> {
        let spec = &writer.spec;
        let shared = self.shared_writers.get(&spec.dds_topic);
        if let Some(dds) = shared.filter(|_| spec.shared).and_then(Weak::upgrade) {
            let gid = dds.gid();
            writer.attach(Some(dds));
            self.send(Request::Update(gid));
            return Ok(());
        }
        let topic = self.topic(spec)?;
        let qos = QosPolicies::from(&spec.qos);
        let publisher = self.publisher.clone();
        let dds = participant_watchdog::create(&self.participant, move |_| {
            publisher.create_datawriter_no_key::<Bytes, CdrPassthrough>(&topic, Some(qos))
        })?;
        let topic = (spec.dds_topic.clone(), Arc::clone(&writer.local));
        let dds = Arc::new(DdsWriter::new(dds, topic, self.rtps.clone()));
        if spec.shared {
            let topic = spec.dds_topic.clone();
            self.shared_writers.insert(topic, Arc::downgrade(&dds));
        }
        writer.counters.forget_remote();
        let gid = dds.gid();
        writer.attach(Some(dds));
        // Known peers may have been matched before the writer was attached.
        self.send(Request::Update(gid));
        Ok(())
    }

    fn create_reader(&mut self, reader: &Arc<Reader>) -> Result<(), TransportError> {
        let spec = &reader.spec;
        reader.counters.forget_remote();
        let key = spec.reader_key();
        if let Some(key) = &key
            && let Some((gid, count)) = self.shared_readers.get_mut(key)
        {
            *count += 1;
            reader.set_gid(*gid);
            let request = Request::Join(*gid, Arc::clone(reader));
            self.send(request);
            return Ok(());
        }
        let topic = self.topic(spec)?;
        let qos = for_reader(&spec.reader_qos(), spec.is_large());
        let subscriber = self.subscriber.clone();
        let dds = participant_watchdog::create(&self.participant, move |_| {
            subscriber.create_simple_datareader_no_key::<Bytes, CdrPassthrough>(&topic, Some(qos))
        })?;
        let gid = dds.guid().into();
        reader.set_gid(gid);
        if let Some(key) = key {
            self.shared_readers.insert(key, (gid, 1));
        }
        let earlier = match self.read_topics.insert(spec.dds_topic.clone()) {
            true => VecDeque::new(),
            false => left_by_others(&dds, &spec.qos),
        };
        let reader = Arc::clone(reader);
        self.send(Request::Add(Box::new(dds), reader, earlier));
        Ok(())
    }
}

impl Session for DdsSession {
    fn discovery(&self) -> Arc<dyn Discovery> {
        Arc::clone(&self.discovery) as Arc<dyn Discovery>
    }

    fn add_writer(&mut self, writer: &Arc<Writer>) -> Result<(), TransportError> {
        self.create_writer(writer)?;
        if !writer.spec.internal {
            // Announced before the first message, because its receiver may look up the node of the publisher. The later
            // announcement contains further changes.
            let nodes = announcer::nodes(&lock(&self.endpoints));
            self.announcer.publish(nodes);
        }
        self.announce();
        Ok(())
    }

    fn add_reader(&mut self, reader: &Arc<Reader>) -> Result<(), TransportError> {
        self.create_reader(reader)?;
        self.announce();
        Ok(())
    }

    fn remove_writer(&mut self, writer: &Writer) -> Option<Arc<dyn WireWriter>> {
        let gid = writer.gid();
        let wire = writer.detach();
        if let Some(gid) = gid
            && (wire.as_ref()).is_some_and(|wire| Arc::strong_count(wire) == 1)
        {
            self.send(Request::ForgetWriter(gid));
        }
        self.announce();
        wire
    }

    fn remove_reader(&mut self, reader: &Arc<Reader>) {
        if let Some(key) = reader.spec.reader_key()
            && let Some((_, count)) = self.shared_readers.get_mut(&key)
        {
            *count -= 1;
            if *count == 0 {
                self.shared_readers.remove(&key);
            }
        }
        self.send(Request::Remove(Arc::clone(reader)));
        self.announce();
    }

    fn announce(&mut self) {
        self.send(Request::Announce);
    }
}

fn lock(endpoints: &Mutex<Endpoints>) -> std::sync::MutexGuard<'_, Endpoints> {
    endpoints.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Samples that a new DDS reader finds in the cache of rustdds, which all readers of a topic in a participant share. A
/// volatile subscription must not get them, a transient-local one gets only the last `depth`.
fn left_by_others(dds: &RawReader, qos: &Qos) -> VecDeque<RawSample> {
    let mut kept = VecDeque::new();
    while let Ok(Some(change)) = dds.try_take_one() {
        if qos.durability == Durability::TransientLocal {
            if kept.len() >= qos.depth.max(1) {
                kept.pop_front();
            }
            kept.push_back(RawSample::from(change));
        }
    }
    kept
}

impl Drop for DdsSession {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        let _ = self.waker.wake();
        if let Some(receiver) = self.receiver.take()
            && receiver.thread().id() != thread::current().id()
        {
            let _ = receiver.join();
        }
        // The participant no longer has nodes.
        self.announcer.publish(Vec::new());
    }
}
