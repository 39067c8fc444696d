//! A DDS participant that the nodes of a process share, with their endpoints. It outlives the connections to DDS.
//!
//! Three locks, never taken in another order: the connection, which is held while rustdds creates an endpoint; the endpoints;
//! a topic inside the participant ([`LocalTopic`](super::local_delivery::LocalTopic)). Messages are delivered, sent and
//! received without the first one, and rustdds destroys endpoints without any.

use rustdds::DomainParticipant;
use std::{
    collections::BTreeSet,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Arc, Mutex, MutexGuard, PoisonError, Weak},
    thread,
    time::Duration,
};

use super::{
    Domain, Gid, NodeError, NodeName,
    discovery::{self, DiscoveredPublisher, LocalTopicUse},
    discovery_settling::DiscoverySettling,
    endpoint::{Destination, EndpointSpec, Endpoints, Member, Reader, Writer},
    graph_cache::{GraphCache, warn_of_namesake},
    invalid_samples::not_of_type,
    local_delivery::{LocalTopics, Mismatch},
    participant_watchdog::{AbandonedParticipant, EntityError},
    session::Session,
    signals,
    static_peers::StaticPeers,
};

/// DDS participants that are tried, one after the other, before a node fails.
const MAX_PARTICIPANTS: usize = 5;

/// Pause before the next participant is tried.
const PAUSE: Duration = Duration::from_millis(100);

/// How long the end of a subscription waits for its handler.
const LAST_SAMPLES: Duration = Duration::from_secs(5);

/// Whether the nodes are in the graph.
#[derive(Default)]
enum Connection {
    /// Not connected yet, or no more because DDS failed; it may connect.
    #[default]
    Disconnected,
    Connected(Box<Session>),
    /// Left the graph for good, with the last node; a new participant would never be closed.
    Closed,
}

impl Connection {
    fn session(&mut self) -> Option<&mut Session> {
        match self {
            Self::Connected(session) => Some(session),
            Self::Disconnected | Self::Closed => None,
        }
    }
}

/// Called when another node publishes or subscribes.
type Watcher = Arc<dyn Fn(&LocalTopicUse) + Send + Sync>;

/// One participant and its nodes.
pub(super) struct Participant {
    domain: Domain,
    static_peers: StaticPeers,
    connection: Mutex<Connection>,
    /// The DDS participant, for questions that must not wait for the connection.
    dds: Mutex<Option<DomainParticipant>>,
    pub(super) endpoints: Arc<Mutex<Endpoints>>,
    topics: LocalTopics,
    graph: Arc<GraphCache>,
    settling: Arc<DiscoverySettling>,
    /// Discovered topics and types against the rules of ROS that a warning was logged for.
    warned_topics: Mutex<BTreeSet<(String, String)>>,
    watchers: Mutex<Vec<(Member, Watcher)>>,
}

impl Participant {
    pub(super) fn new(domain: Domain, static_peers: StaticPeers) -> Self {
        Self {
            domain,
            static_peers,
            connection: Mutex::default(),
            dds: Mutex::default(),
            endpoints: Arc::default(),
            topics: LocalTopics::default(),
            graph: Arc::default(),
            settling: Arc::default(),
            warned_topics: Mutex::default(),
            watchers: Mutex::default(),
        }
    }

    /// The DDS domain.
    pub(super) fn domain(&self) -> Domain {
        self.domain
    }

    fn connection(&self) -> MutexGuard<'_, Connection> {
        self.connection
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn endpoints(&self) -> MutexGuard<'_, Endpoints> {
        self.endpoints
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn dds(&self) -> Option<DomainParticipant> {
        let dds = self.dds.lock().unwrap_or_else(PoisonError::into_inner);
        dds.clone()
    }

    fn set_dds(&self, new: Option<DomainParticipant>) {
        let mut dds = self.dds.lock().unwrap_or_else(PoisonError::into_inner);
        let old = std::mem::replace(&mut *dds, new);
        drop(dds);
        drop(old);
    }

    /// Adds a node; the first one connects. Returns false if the last node has left already.
    pub(super) fn add_node(&self, node: &Member) -> Result<bool, NodeError> {
        let mut connection = self.connection();
        if matches!(*connection, Connection::Closed) {
            return Ok(false);
        }
        self.endpoints().nodes.push(node.clone());
        match connection.session() {
            Some(session) => session.announce(),
            None => {
                let connected = self.connect(&mut connection, AbandonedParticipant::default());
                if let Err(e) = connected {
                    let nodes = &mut self.endpoints().nodes;
                    nodes.retain(|n| !Arc::ptr_eq(&n.name, &node.name));
                    return Err(NodeError::dds(&node.name, "join the DDS domain", e));
                }
            }
        }
        drop(connection);
        if self.graph.add_own_node(&node.name) {
            warn_of_namesake(&node.name.full());
        }
        Ok(true)
    }

    /// Removes a node with its endpoints; the last one closes the connection.
    pub(super) fn remove_node(&self, node: &Arc<NodeName>) {
        let mut connection = self.connection();
        let mut endpoints = self.endpoints();
        if !endpoints.has_node(node) {
            return;
        }
        endpoints.nodes.retain(|n| !Arc::ptr_eq(&n.name, node));
        let is_last = endpoints.nodes.is_empty();
        let writers = endpoints
            .writers
            .extract_if(.., |w| Arc::ptr_eq(&w.node, node));
        let writers: Vec<_> = writers.collect();
        let readers = endpoints
            .readers
            .extract_if(.., |r| Arc::ptr_eq(&r.node, node));
        let readers: Vec<_> = readers.collect();
        drop(endpoints);
        let mut detached = Vec::new();
        if let Some(session) = connection.session() {
            detached.extend(writers.iter().filter_map(|w| session.remove_writer(w)));
            readers.iter().for_each(|r| session.remove_reader(r));
        }
        let closed = match is_last {
            true => std::mem::replace(&mut *connection, Connection::Closed),
            false => Connection::Disconnected,
        };
        drop(connection);
        for writer in writers {
            writer.local.remove_writer(&writer);
        }
        for reader in readers {
            reader.local.remove_reader(&reader);
        }
        self.graph.remove_own_node(node);
        let mut watchers = self.watchers();
        watchers.retain(|(watcher, _)| !Arc::ptr_eq(&watcher.name, node));
        drop(watchers);
        if is_last {
            self.set_dds(None);
        }
        // Without locks: rustdds may take its time.
        drop(detached);
        drop(closed);
    }

    /// Creates a new DDS participant with all endpoints in place of the present one, which no longer works. Returns false
    /// if there is none.
    pub(super) fn reconnect(&self) -> Result<bool, NodeError> {
        let mut connection = self.connection();
        if connection.session().is_none() {
            return Ok(false);
        }
        let connected = self.connect(&mut connection, AbandonedParticipant::default());
        let nodes = self.node_names().join(", ");
        connected.map_err(|e| NodeError::dds(nodes, "join the DDS domain again", e))?;
        Ok(true)
    }

    fn reconnect_and_log(&self, reason: &str) {
        match self.reconnect() {
            Ok(false) => {}
            Ok(true) => tracing::info!(
                "{}: {reason}, joined the graph again",
                self.node_names().join(", ")
            ),
            Err(e) => tracing::error!("{e}; trying again"),
        }
    }

    /// Which peer has returned after the end of its lease, for the log; once per loss.
    fn take_returned_peer(&self) -> Option<String> {
        // Somebody who connects or creates an endpoint must not be waited for; the next call will find it.
        let lost_peers = self.connection.try_lock().ok()?.session()?.lost_peers();
        lost_peers.take_returned(|| {
            let peers = self.static_peers.addresses();
            signals::with_blocked(|| self.domain.participant(&peers))
        })
    }

    /// Connects if an earlier attempt failed. Returns whether it has connected.
    fn connect_again(&self) -> bool {
        // Somebody else who connects now must not be waited for.
        let Ok(mut connection) = self.connection.try_lock() else {
            return false;
        };
        let has_nodes = !self.endpoints().nodes.is_empty();
        matches!(*connection, Connection::Disconnected)
            && has_nodes
            && self
                .connect(&mut connection, AbandonedParticipant::default())
                .is_ok()
    }

    /// Connects, in place of a DDS participant that may have deadlocked.
    fn connect(
        &self,
        connection: &mut Connection,
        mut old: AbandonedParticipant,
    ) -> Result<(), EntityError> {
        // Its drop may wait for threads that have ended, so it is dropped elsewhere.
        if let Connection::Connected(session) = std::mem::take(connection) {
            let dds = self.dds();
            self.set_dds(None);
            old.keep((Session::detach(&self.endpoints()), session, dds));
        }
        drop(old);
        let place = (self.domain, &self.static_peers);
        let open = || Session::open(place, &self.endpoints, &self.graph, &self.settling);
        let mut new = signals::with_blocked(open);
        for _ in 1..MAX_PARTICIPANTS {
            match new {
                Ok(_) | Err(EntityError::NoDescriptors(_)) => break,
                Err(EntityError::Deadlocked(_)) => {}
                // A signal can end the threads of a new participant too.
                Err(EntityError::Dds(_)) => thread::sleep(PAUSE),
            }
            new = signals::with_blocked(open);
        }
        let session = new?;
        self.set_dds(Some(session.participant().clone()));
        *connection = Connection::Connected(Box::new(session));
        Ok(())
    }

    pub(super) fn add_writer(
        &self,
        node: &Arc<NodeName>,
        spec: EndpointSpec,
    ) -> Result<Arc<Writer>, NodeError> {
        let topic = self.topics.topic(&spec.dds_topic);
        let writer = Arc::new(Writer::new(spec, Arc::clone(node), topic));
        self.settling.wait();
        let mut connection = self.connection();
        let mut endpoints = self.endpoints();
        if !endpoints.has_node(node) {
            return Ok(writer);
        }
        endpoints.writers.push(Arc::clone(&writer));
        drop(endpoints);
        if let Some(Err(e)) = connection.session().map(|s| s.add_writer(&writer))
            && let Err(e) =
                self.reconnect_with_endpoint(&mut connection, node, ("publish", &writer.spec), e)
        {
            let writers = &mut self.endpoints().writers;
            writers.retain(|w| !Arc::ptr_eq(w, &writer));
            return Err(e);
        }
        let mismatches = writer.local.add_writer(&writer);
        drop(connection);
        warn_of_mismatches(&writer.spec, node, &mismatches);
        self.show_to_watchers(node, &writer.spec, true);
        Ok(writer)
    }

    pub(super) fn add_reader(
        &self,
        node: &Arc<NodeName>,
        spec: EndpointSpec,
        destination: Destination,
    ) -> Result<Arc<Reader>, NodeError> {
        let topic = self.topics.topic(&spec.dds_topic);
        let reader = Arc::new(Reader::new(spec, Arc::clone(node), destination, topic));
        self.settling.wait();
        let mut connection = self.connection();
        let mut endpoints = self.endpoints();
        if !endpoints.has_node(node) {
            return Ok(reader);
        }
        endpoints.readers.push(Arc::clone(&reader));
        drop(endpoints);
        if let Some(Err(e)) = connection.session().map(|s| s.add_reader(&reader))
            && let Err(e) = self.reconnect_with_endpoint(
                &mut connection,
                node,
                ("subscribe to", &reader.spec),
                e,
            )
        {
            let readers = &mut self.endpoints().readers;
            readers.retain(|r| !Arc::ptr_eq(r, &reader));
            return Err(e);
        }
        let mismatches = reader.local.add_reader(&reader);
        drop(connection);
        warn_of_mismatches(&reader.spec, node, &mismatches);
        self.show_to_watchers(node, &reader.spec, false);
        Ok(reader)
    }

    /// Replaces the DDS participant when an endpoint cannot be added: it may have deadlocked, or a signal may have ended its
    /// threads while the node was created. The new one has all endpoints including this one, or it is an error. Where only
    /// descriptors are missing, everything else stays as it is.
    fn reconnect_with_endpoint(
        &self,
        connection: &mut Connection,
        node: &NodeName,
        (verb, spec): (&str, &EndpointSpec),
        why: EntityError,
    ) -> Result<(), NodeError> {
        let error = NodeError::dds(node, format!("{verb} {}", spec.name), &why);
        let old = match why {
            EntityError::NoDescriptors(_) => return Err(error),
            EntityError::Deadlocked(stuck) => {
                tracing::warn!("{error}; joining the graph again");
                stuck
            }
            EntityError::Dds(_) => AbandonedParticipant::default(),
        };
        self.connect(connection, old).map_err(|_| error)
    }

    pub(super) fn remove_writer(&self, writer: &Arc<Writer>) {
        let mut connection = self.connection();
        let writers = &mut self.endpoints().writers;
        writers.retain(|w| !Arc::ptr_eq(w, writer));
        let session = connection.session();
        let detached = session.and_then(|session| session.remove_writer(writer));
        drop(connection);
        writer.local.remove_writer(writer);
        // Without locks: rustdds may take its time.
        drop(detached);
    }

    /// Removes a subscription. Samples that it has received are handled before it ends.
    pub(super) fn remove_reader(&self, reader: &Arc<Reader>) {
        let mut connection = self.connection();
        let mut endpoints = self.endpoints();
        let before = endpoints.readers.len();
        endpoints.readers.retain(|r| !Arc::ptr_eq(r, reader));
        let was_there = endpoints.readers.len() < before;
        drop(endpoints);
        if let Some(session) = connection.session().filter(|_| was_there) {
            session.remove_reader(reader);
        }
        drop(connection);
        reader.local.remove_reader(reader);
        if let Destination::Handler(handler) = &reader.destination {
            handler.queue.flush(reader, LAST_SAMPLES);
        }
    }

    /// Publishers of other nodes, in this and in other participants.
    pub(super) fn publishers(&self, node: &Arc<NodeName>) -> Vec<DiscoveredPublisher> {
        let mut publishers = self.local_publishers(node);
        if let Some(dds) = self.dds() {
            let warned = self.warned_topics.lock();
            let mut warned = warned.unwrap_or_else(PoisonError::into_inner);
            publishers.extend(discovery::publishers(&dds, node, &mut warned));
        }
        publishers
    }

    fn local_publishers(&self, node: &Arc<NodeName>) -> Vec<DiscoveredPublisher> {
        let endpoints = self.endpoints();
        let others = endpoints.writers.iter();
        let others = others.filter(|writer| !Arc::ptr_eq(&writer.node, node));
        others
            .filter_map(|w| DiscoveredPublisher::local(w))
            .collect()
    }

    /// What the other nodes of this participant publish and subscribe to, without what every node has.
    pub(super) fn local_topics(&self, node: &Arc<NodeName>) -> Vec<LocalTopicUse> {
        let endpoints = self.endpoints();
        let writers = endpoints.writers.iter();
        let writers = writers.filter(|w| !Arc::ptr_eq(&w.node, node));
        let readers = endpoints.readers.iter();
        let readers = readers.filter(|r| !Arc::ptr_eq(&r.node, node) && !r.spec.internal);
        writers
            .map(|w| LocalTopicUse::of(&w.spec, true))
            .chain(readers.map(|r| LocalTopicUse::of(&r.spec, false)))
            .flatten()
            .collect()
    }

    /// Calls `watcher` for everything that another node of this participant publishes or subscribes to, now or later: in the
    /// thread that creates the endpoint, before its first message.
    pub(super) fn watch_topics(&self, node: &Member, watcher: Watcher) {
        self.watchers().push((node.clone(), Arc::clone(&watcher)));
        for topic in self.local_topics(&node.name) {
            watcher(&topic);
        }
    }

    fn watchers(&self) -> MutexGuard<'_, Vec<(Member, Watcher)>> {
        self.watchers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn show_to_watchers(&self, owner: &Arc<NodeName>, spec: &EndpointSpec, is_published: bool) {
        let watchers = self.watchers().clone();
        if watchers.is_empty() || (spec.internal && !is_published) {
            return;
        }
        let Some(topic) = LocalTopicUse::of(spec, is_published) else {
            return;
        };
        for (node, watcher) in watchers {
            if Arc::ptr_eq(&node.name, owner) {
                continue;
            }
            if catch_unwind(AssertUnwindSafe(|| watcher(&topic))).is_err() {
                let reason = format!("node {}: a handler has panicked", node.name);
                node.stop_state.fail(reason);
            }
        }
    }

    /// Logs that a sample is not of the type of its subscription, unless that has been said often enough.
    pub(super) fn report_invalid(&self, reader: &Reader, publisher: Gid, length: usize) {
        let problem = not_of_type(&reader.spec, length);
        reader.report_invalid(&self.graph, Some(publisher), &problem);
    }

    /// Full name of the node that `publisher` belongs to, if it is known.
    pub(super) fn node_of(&self, publisher: Gid) -> Option<String> {
        let endpoints = self.endpoints();
        let mut writers = endpoints.writers.iter();
        let own = writers.find(|w| w.identity() == publisher);
        let own = own.map(|writer| writer.node.full());
        drop(endpoints);
        own.or_else(|| self.graph.node_of(publisher))
    }

    /// Full names of the nodes.
    pub(super) fn node_names(&self) -> Vec<String> {
        let endpoints = self.endpoints();
        endpoints.nodes.iter().map(|n| n.name.full()).collect()
    }

    /// Whether every node is to stop.
    pub(super) fn is_stopping(&self) -> bool {
        let endpoints = self.endpoints();
        endpoints.nodes.iter().all(|n| n.stop_state.is_stopping())
    }
}

fn warn_of_mismatches(spec: &EndpointSpec, node: &NodeName, mismatches: &[Mismatch]) {
    // One warning says enough.
    match mismatches.first() {
        Some(Mismatch::Types(offered, requested)) => tracing::warn!(
            "node {node}: topic {} is not exchanged with another node of this process: {offered} is offered, {requested} \
             is requested",
            spec.name
        ),
        Some(Mismatch::Qos(qos)) => tracing::warn!(
            "node {node}: {}",
            discovery::not_exchanged(&spec.name, &qos.0, &qos.1)
        ),
        None => {}
    }
}

/// Participants of a process, by domain; each has at least one node.
#[derive(Default)]
pub(super) struct Participants {
    all: Mutex<Vec<Weak<Participant>>>,
    static_peers: StaticPeers,
}

impl Participants {
    /// None yet; all will announce themselves to these peers.
    pub(super) fn new(static_peers: StaticPeers) -> Self {
        Self {
            all: Mutex::default(),
            static_peers,
        }
    }

    /// Adds a node to the participant of its domain, or to a new one if that is missing, has been closed, or if nodes are
    /// `isolated`.
    pub(super) fn add_node(
        &self,
        domain: Domain,
        node: &Member,
        isolated: bool,
    ) -> Result<Arc<Participant>, NodeError> {
        let mut all = self.all.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|participant| participant.strong_count() > 0);
        let same = all.iter().filter_map(Weak::upgrade);
        let same: Vec<_> = same.filter(|p| !isolated && p.domain() == domain).collect();
        for participant in same {
            if participant.add_node(node)? {
                return Ok(participant);
            }
        }
        let new = Arc::new(Participant::new(domain, self.static_peers.clone()));
        new.add_node(node)?;
        all.push(Arc::downgrade(&new));
        Ok(new)
    }

    /// Those whose nodes are not stopping.
    fn working(&self) -> Vec<Arc<Participant>> {
        let all = self.all.lock().unwrap_or_else(PoisonError::into_inner);
        let all = all.iter().filter_map(Weak::upgrade);
        all.filter(|p| !p.is_stopping()).collect()
    }

    /// Connects the participants that could not be reconnected. To be called from time to time.
    pub(super) fn connect_again(&self) {
        for participant in self.working() {
            if participant.connect_again() {
                let nodes = participant.node_names().join(", ");
                tracing::info!("{nodes}: joined the graph again");
            }
        }
    }

    /// Reconnects all participants whose nodes are not stopping ([`Participant::reconnect`]), for this reason.
    pub(super) fn reconnect(&self, reason: &str) {
        for participant in self.working() {
            participant.reconnect_and_log(reason);
        }
    }

    /// Reconnects the participants that a lost peer has returned to. To be called from time to time.
    pub(super) fn reconnect_after_loss(&self) {
        for participant in self.working() {
            if let Some(reason) = participant.take_returned_peer() {
                participant.reconnect_and_log(&reason);
            }
        }
    }
}
