//! A DDS participant with the endpoints of a node. It can be replaced while the handles of the program stay valid.

use rustdds::{
    DomainParticipant, QosPolicies, RTPSEntity, Topic, TopicKind,
    bytes::Bytes,
    mio1::{Events as PollEvents, Interest, Poll, Token, Waker},
};
use std::{
    collections::{BTreeSet, HashMap},
    io,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc,
    },
    thread::{self, JoinHandle},
};

use super::{
    Domain, Gid, NodeName, Qos, RawSample,
    discovery::{self, Announcer, DiscoveredPublisher, Peers, report_status},
    discovery_settling::DiscoverySettling,
    endpoint::{EndpointSpec, Endpoints, Reader, Writer},
    events::StopState,
    graph_cache::GraphCache,
    invalid_samples::{InvalidSamples, not_of_type},
    participant_watchdog::{self, EntityError},
    raw_endpoints::{CdrPassthrough, RawReader, RawWriter},
    rtps_sender::RtpsSender,
};

/// Types whose messages have the size of a megabyte rather than a kilobyte.
const LARGE_TYPES: [&str; 4] = [
    "sensor_msgs::msg::dds_::Image_",
    "sensor_msgs::msg::dds_::CompressedImage_",
    "sensor_msgs::msg::dds_::PointCloud2_",
    "nav_msgs::msg::dds_::OccupancyGrid_",
];

enum SessionRequest {
    Add(Box<RawReader>, Arc<Reader>),
    Remove(Gid),
}

/// A connected participant.
pub(super) struct Session {
    participant: DomainParticipant,
    publisher: rustdds::Publisher,
    subscriber: rustdds::Subscriber,
    topics: HashMap<String, Topic>,
    announcer: Announcer,
    /// Discovered topics and types against the rules of ROS that a warning was logged for.
    warned_topics: BTreeSet<(String, String)>,
    requests: mpsc::Sender<SessionRequest>,
    waker: Arc<Waker>,
    rtps: Option<Arc<RtpsSender>>,
    stop: Arc<AtomicBool>,
    receiver: Option<JoinHandle<()>>,
}

impl Session {
    /// A participant with every endpoint of `endpoints`. Threads inherit the caller's signal mask.
    pub(super) fn open(
        domain: Domain,
        node: &NodeName,
        endpoints: &Arc<Mutex<Endpoints>>,
        stop_state: &Arc<StopState>,
        (graph, settling): (&Arc<GraphCache>, &Arc<DiscoverySettling>),
    ) -> Result<Self, EntityError> {
        let participant = domain.participant().map_err(EntityError::Dds)?;
        graph.reset(participant.guid().into());
        let qos = QosPolicies::from(&Qos::RELIABLE);
        let publisher = participant
            .create_publisher(&qos)
            .map_err(EntityError::dds)?;
        let subscriber = participant
            .create_subscriber(&qos)
            .map_err(EntityError::dds)?;
        let announcer = Announcer::new(&participant, &publisher, node)?;

        let poll = Poll::new().map_err(EntityError::dds)?;
        let waker = Waker::new(poll.registry(), WAKER).map_err(EntityError::dds)?;
        let (requests, inbox) = mpsc::channel();
        let stop = Arc::new(AtomicBool::new(false));
        let rtps = RtpsSender::new(participant.clone(), domain.range)
            .inspect_err(|e| tracing::warn!("node {node}: long replies may not arrive: {e}"));
        let rtps = rtps.ok().map(Arc::new);
        let receiver = Receiver {
            poll,
            inbox,
            stop: Arc::clone(&stop),
            participant: participant.clone(),
            node: node.clone(),
            endpoints: Arc::clone(endpoints),
            graph: Arc::clone(graph),
            settling: Arc::clone(settling),
            rtps: rtps.clone(),
        };
        let receiver = thread::Builder::new()
            .name(format!("{}.receive", node.name()))
            .spawn({
                let (node, stop_state) = (node.clone(), Arc::clone(stop_state));
                move || match catch_unwind(AssertUnwindSafe(|| receiver.run())) {
                    Ok(Ok(())) => {}
                    // A node that cannot receive must not continue as if it could.
                    Ok(Err(e)) => stop_state.fail(format!("node {node}: receiving has ended: {e}")),
                    Err(_) => stop_state.fail(format!("node {node}: a handler has panicked")),
                }
            })
            .map_err(EntityError::dds)?;
        let mut session = Self {
            participant,
            publisher,
            subscriber,
            topics: HashMap::new(),
            announcer,
            warned_topics: BTreeSet::new(),
            requests,
            waker: Arc::new(waker),
            rtps,
            stop,
            receiver: Some(receiver),
        };
        if let Err(e) = session.create_all(endpoints) {
            let writers = Self::detach(&endpoints.lock().unwrap_or_else(PoisonError::into_inner));
            return Err(e.abandoning((writers, session)));
        }
        session.announcer.announce();
        Ok(session)
    }

    fn create_all(&mut self, endpoints: &Mutex<Endpoints>) -> Result<(), EntityError> {
        let (writers, readers) = {
            let all = endpoints.lock().unwrap_or_else(PoisonError::into_inner);
            (all.writers.clone(), all.readers.clone())
        };
        writers.iter().try_for_each(|w| self.create_writer(w))?;
        readers.iter().try_for_each(|r| self.create_reader(r))
    }

    pub(super) fn add_writer(&mut self, writer: &Writer) -> Result<(), EntityError> {
        self.create_writer(writer)?;
        self.announcer.announce();
        Ok(())
    }

    pub(super) fn add_reader(&mut self, reader: &Arc<Reader>) -> Result<(), EntityError> {
        self.create_reader(reader)?;
        self.announcer.announce();
        Ok(())
    }

    pub(super) fn remove_writer(&mut self, writer: &Writer) {
        if let Some(gid) = writer.gid() {
            self.announcer.forget(gid);
            self.announcer.announce();
        }
        writer.attach(None);
    }

    pub(super) fn remove_reader(&mut self, reader: &Reader) {
        if let Some(gid) = reader.gid() {
            self.announcer.forget(gid);
            self.announcer.announce();
            self.send(SessionRequest::Remove(gid));
        }
    }

    pub(super) fn discovered_publishers(&mut self, node: &NodeName) -> Vec<DiscoveredPublisher> {
        discovery::publishers(&self.participant, node, &mut self.warned_topics)
    }

    fn send(&self, request: SessionRequest) {
        // The thread ends only with this session.
        if self.requests.send(request).is_ok() {
            let _ = self.waker.wake();
        }
    }

    fn topic(&mut self, spec: &EndpointSpec) -> Result<Topic, EntityError> {
        if let Some(topic) = self.topics.get(&spec.dds_topic) {
            return Ok(topic.clone());
        }
        let (name, kind) = (spec.dds_topic.clone(), spec.dds_type.clone());
        let qos = QosPolicies::from(&spec.qos);
        let topic = participant_watchdog::create(&self.participant, move |participant| {
            participant.create_topic(name, kind, &qos, TopicKind::NoKey)
        })?;
        self.topics.insert(spec.dds_topic.clone(), topic.clone());
        Ok(topic)
    }

    fn create_writer(&mut self, writer: &Writer) -> Result<(), EntityError> {
        let topic = self.topic(&writer.spec)?;
        let qos = QosPolicies::from(&writer.spec.qos);
        let publisher = self.publisher.clone();
        let dds = participant_watchdog::create(&self.participant, move |_| {
            publisher.create_datawriter_no_key::<Bytes, CdrPassthrough>(&topic, Some(qos))
        })?;
        self.announcer.add_writer(dds.guid().into());
        writer.counters.forget_peers();
        writer.attach(Some(Arc::new(dds)));
        writer.set_rtps_sender(self.rtps.clone());
        Ok(())
    }

    fn create_reader(&mut self, reader: &Arc<Reader>) -> Result<(), EntityError> {
        let topic = self.topic(&reader.spec)?;
        let is_large = LARGE_TYPES.contains(&reader.spec.dds_type.as_str());
        let qos = reader.spec.qos.for_reader(is_large);
        let subscriber = self.subscriber.clone();
        let dds = participant_watchdog::create(&self.participant, move |_| {
            subscriber.create_simple_datareader_no_key::<Bytes, CdrPassthrough>(&topic, Some(qos))
        })?;
        let gid = dds.guid().into();
        self.announcer.add_reader(gid);
        reader.counters.forget_peers();
        reader.set_gid(gid);
        self.send(SessionRequest::Add(Box::new(dds), Arc::clone(reader)));
        Ok(())
    }

    /// Detaches every DDS writer, so that the participant can end when they are dropped.
    pub(super) fn detach(endpoints: &Endpoints) -> Vec<Arc<RawWriter>> {
        let writers = endpoints.writers.iter();
        writers.filter_map(|writer| writer.attach(None)).collect()
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.announcer.leave();
        self.stop.store(true, Relaxed);
        let _ = self.waker.wake();
        if let Some(receiver) = self.receiver.take()
            && receiver.thread().id() != thread::current().id()
        {
            let _ = receiver.join();
        }
    }
}

const WAKER: Token = Token(0);
const STATUS: Token = Token(1);
const FIRST_READER: usize = 2;

/// The receiving thread: waits for all readers of a participant at once.
struct Receiver {
    poll: Poll,
    inbox: mpsc::Receiver<SessionRequest>,
    stop: Arc<AtomicBool>,
    participant: DomainParticipant,
    node: NodeName,
    endpoints: Arc<Mutex<Endpoints>>,
    graph: Arc<GraphCache>,
    settling: Arc<DiscoverySettling>,
    rtps: Option<Arc<RtpsSender>>,
}

impl Receiver {
    fn run(mut self) -> io::Result<()> {
        // Tokens are never used twice within one participant.
        let mut readers: HashMap<usize, ReaderState> = HashMap::new();
        let mut next_token = FIRST_READER;
        let mut peers = Peers::new(self.rtps.take());
        let mut status = self.participant.status_listener();
        let registered = self
            .poll
            .registry()
            .register(&mut status, STATUS, Interest::READABLE);
        if let Err(e) = registered {
            tracing::error!("node {}: no events of the participant: {e}", self.node);
        }
        let mut events = PollEvents::with_capacity(64);
        while !self.stop.load(Relaxed) {
            match self.poll.poll(&mut events, peers.first_samples.timeout()) {
                Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                outcome => outcome?,
            }
            for event in &events {
                match event.token() {
                    WAKER => {}
                    STATUS => report_status(
                        &status,
                        &self.node,
                        &self.endpoints,
                        &mut peers,
                        (&self.graph, &self.settling),
                    ),
                    Token(token) => {
                        if let Some(state) = readers.get_mut(&token) {
                            state.take_all(&self.node, &self.graph);
                        }
                    }
                }
            }
            peers.first_samples.request(|reader, writer| {
                let mut states = readers.values();
                let state = states.find(|state| state.dds.guid() == reader);
                state.is_some_and(|state| state.last.contains_key(&writer.into()))
            });
            while let Ok(request) = self.inbox.try_recv() {
                match request {
                    SessionRequest::Add(mut dds, reader) => {
                        let token = Token(next_token);
                        let registry = self.poll.registry();
                        if let Err(e) = registry.register(&mut *dds, token, Interest::READABLE) {
                            let topic = &reader.spec.name;
                            tracing::error!("node {}: cannot receive {topic}: {e}", self.node);
                        }
                        // Samples that arrived before the registration.
                        let mut state = ReaderState {
                            dds,
                            reader,
                            last: HashMap::new(),
                            invalid: InvalidSamples::default(),
                        };
                        state.take_all(&self.node, &self.graph);
                        readers.insert(next_token, state);
                        next_token += 1;
                    }
                    SessionRequest::Remove(gid) => {
                        readers.retain(|_, r| Gid::from(r.dds.guid()) != gid);
                    }
                }
            }
        }
        Ok(())
    }
}

/// A reader on the receiving thread.
struct ReaderState {
    dds: Box<RawReader>,
    reader: Arc<Reader>,
    /// The number of the last sample of each publisher.
    last: HashMap<Gid, i64>,
    invalid: InvalidSamples,
}

impl ReaderState {
    fn take_all(&mut self, node: &NodeName, graph: &GraphCache) {
        let Self {
            dds,
            reader,
            last,
            invalid,
        } = self;
        dds.drain_read_notifications();
        loop {
            match dds.try_take_one() {
                Ok(None) => return,
                Ok(Some(change)) => {
                    let sample = RawSample::from(change);
                    let missing = missing(last, sample.publisher, sample.sequence_number);
                    reader.counters.missing.fetch_add(missing, Relaxed);
                    reader.counters.count();
                    let (publisher, length) = (sample.publisher, sample.cdr.len());
                    if !(reader.sink)(sample, &reader.counters) {
                        reader.counters.failed.fetch_add(1, Relaxed);
                        let problem = not_of_type(&reader.spec, length);
                        invalid.report((node, graph), &reader.spec, Some(publisher), &problem);
                    }
                }
                // The reader has skipped the sample that it could not take.
                Err(e) => {
                    reader.counters.failed.fetch_add(1, Relaxed);
                    invalid.report((node, graph), &reader.spec, None, &e.to_string());
                }
            }
        }
    }
}

/// Number of samples missing between the last one of a publisher and this one. Samples before the first one received here
/// were not meant for this reader.
fn missing(last: &mut HashMap<Gid, i64>, publisher: Gid, number: i64) -> u64 {
    let before = last.entry(publisher).or_insert(number);
    let gap = number.saturating_sub(*before).saturating_sub(1).max(0);
    *before = number.max(*before);
    gap as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    // Would break if a late start, a repetition or another publisher's numbers counted as holes.
    #[test]
    fn missing_samples_are_counted_for_each_publisher() {
        let gid = |n| Gid::from([n; 16]);
        let mut last = HashMap::new();
        let numbers = [(1, 40), (1, 41), (2, 7), (1, 45), (1, 45), (2, 8), (1, 46)];
        let holes: Vec<_> = numbers
            .iter()
            .map(|&(publisher, number)| missing(&mut last, gid(publisher), number))
            .collect();
        assert_eq!(holes, [0, 0, 0, 3, 0, 0, 0]);
    }
}
