//! A participant with the endpoints of the nodes that share it. It persists when the session of its transport is
//! replaced.
//!
//! There are three locks, which are always taken in this order: (1) the connection, locked while the transport creates
//! an endpoint; (2) the endpoints; (3) a topic inside the participant
//! ([`LocalTopic`](super::local_delivery::LocalTopic)). Messages are delivered, sent and received without lock 1, and
//! the transport destroys endpoints without any lock.

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
    endpoint::{self, Destination, EndpointSpec, Endpoints, Member, Reader, Writer},
    graph_cache::warn_of_namesake,
    invalid_samples::not_of_type,
    local_delivery::{LocalTopics, Mismatch},
    signals,
    transport::{
        AbandonedSession, Discovery, Middleware, Session, Shared, Transport, TransportError,
    },
};

/// Largest number of successive attempts to open a session before a node fails.
const MAX_SESSIONS: usize = 5;

/// Pause before another attempt.
const PAUSE: Duration = Duration::from_millis(100);

/// Longest time that the end of a subscription waits for its handler to process the last samples.
const LAST_SAMPLES: Duration = Duration::from_secs(5);

/// Connection of a participant to the ROS graph.
#[derive(Default)]
enum Connection {
    /// Not connected yet, or no longer because DDS failed; another attempt is possible.
    #[default]
    Disconnected,
    Connected(Box<dyn Session>),
    /// Left the graph permanently, with the last node. Nothing would close a new session.
    Closed,
}

impl Connection {
    fn session(&mut self) -> Option<&mut (dyn Session + 'static)> {
        match self {
            Self::Connected(session) => Some(&mut **session),
            Self::Disconnected | Self::Closed => None,
        }
    }
}

/// Callback for topics that another node publishes or subscribes to.
type Watcher = Arc<dyn Fn(&LocalTopicUse) + Send + Sync>;

/// One participant and its nodes.
pub(super) struct Participant {
    domain: Domain,
    transport: Arc<dyn Transport>,
    connection: Mutex<Connection>,
    /// Answers queries that must not wait for the lock of the connection.
    discovery: Mutex<Option<Arc<dyn Discovery>>>,
    pub(super) shared: Shared,
    topics: LocalTopics,
    /// Invalid topics and types in discovery for which a warning was logged.
    warned_topics: Mutex<BTreeSet<(String, String)>>,
    watchers: Mutex<Vec<(Member, Watcher)>>,
}

impl Participant {
    pub(super) fn new(domain: Domain, middleware: &Middleware) -> Self {
        Self {
            domain,
            transport: middleware.transport(domain),
            connection: Mutex::default(),
            discovery: Mutex::default(),
            shared: Shared::default(),
            topics: LocalTopics::default(),
            warned_topics: Mutex::default(),
            watchers: Mutex::default(),
        }
    }

    /// DDS domain of the participant.
    pub(super) fn domain(&self) -> Domain {
        self.domain
    }

    fn connection(&self) -> MutexGuard<'_, Connection> {
        self.connection
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn endpoints(&self) -> MutexGuard<'_, Endpoints> {
        let endpoints = self.shared.endpoints.lock();
        endpoints.unwrap_or_else(PoisonError::into_inner)
    }

    fn discovery(&self) -> Option<Arc<dyn Discovery>> {
        let discovery = self.discovery.lock();
        discovery.unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set_discovery(&self, new: Option<Arc<dyn Discovery>>) -> Option<Arc<dyn Discovery>> {
        let discovery = self.discovery.lock();
        let mut discovery = discovery.unwrap_or_else(PoisonError::into_inner);
        std::mem::replace(&mut *discovery, new)
    }

    /// Adds a node; the first node connects the participant. Returns false if the last node has left already.
    pub(super) fn add_node(&self, node: &Member) -> Result<bool, NodeError> {
        let mut connection = self.connection();
        if matches!(*connection, Connection::Closed) {
            return Ok(false);
        }
        self.endpoints().nodes.push(node.clone());
        match connection.session() {
            Some(session) => session.announce(),
            None => {
                let connected = self.connect(&mut connection, AbandonedSession::default());
                if let Err(e) = connected {
                    let nodes = &mut self.endpoints().nodes;
                    nodes.retain(|n| !Arc::ptr_eq(&n.name, &node.name));
                    return Err(NodeError::dds(&node.name, "join the graph", e));
                }
            }
        }
        drop(connection);
        if self.shared.graph.add_own_node(&node.name) {
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
        self.shared.graph.remove_own_node(node);
        let mut watchers = self.watchers();
        watchers.retain(|(watcher, _)| !Arc::ptr_eq(&watcher.name, node));
        drop(watchers);
        if is_last {
            drop(self.set_discovery(None));
        }
        // Dropped without locks, since the transport may take long.
        drop(detached);
        drop(closed);
    }

    /// Replaces the present session, which no longer works, by a new one with all endpoints. Returns false if there is
    /// no session.
    pub(super) fn reconnect(&self) -> Result<bool, NodeError> {
        let mut connection = self.connection();
        if connection.session().is_none() {
            return Ok(false);
        }
        let connected = self.connect(&mut connection, AbandonedSession::default());
        let nodes = self.node_names().join(", ");
        connected.map_err(|e| NodeError::dds(nodes, "join the graph again", e))?;
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

    /// Description of a lost peer that has returned, for the log; reported once per loss.
    fn take_returned_peer(&self) -> Option<String> {
        // Does not wait while a thread connects or creates an endpoint; the next call reports the peer.
        drop(self.connection.try_lock().ok()?);
        self.discovery()?.take_returned_peer()
    }

    /// As [`Self::reconnect`], if the session does not survive an interruption of the process or a step of the wall
    /// clock.
    fn reconnect_after_interruption(&self, reason: &str) {
        if self.transport.breaks_when_interrupted() {
            self.reconnect_and_log(reason);
        }
    }

    /// Connects if an earlier attempt failed. Returns whether it has connected.
    fn connect_again(&self) -> bool {
        // Does not wait while another thread connects.
        let Ok(mut connection) = self.connection.try_lock() else {
            return false;
        };
        let has_nodes = !self.endpoints().nodes.is_empty();
        matches!(*connection, Connection::Disconnected)
            && has_nodes
            && self
                .connect(&mut connection, AbandonedSession::default())
                .is_ok()
    }

    /// Connects the participant. Replaces the present session, if any, which may have deadlocked.
    fn connect(
        &self,
        connection: &mut Connection,
        mut old: AbandonedSession,
    ) -> Result<(), TransportError> {
        // Dropping a session may wait for threads that have ended, so `AbandonedSession` drops it in another thread.
        if let Connection::Connected(session) = std::mem::take(connection) {
            let discovery = self.set_discovery(None);
            old.keep((endpoint::detach(&self.endpoints()), session, discovery));
        }
        drop(old);
        let open = || self.transport.open(&self.shared);
        let mut new = signals::with_blocked(open);
        for _ in 1..MAX_SESSIONS {
            match new {
                Ok(_) | Err(TransportError::NoDescriptors(_)) => break,
                Err(TransportError::Deadlocked(_)) => tracing::warn!(
                    "{}: a DDS participant deadlocked while its endpoints were created; creating another one",
                    self.node_names().join(", ")
                ),
                // A signal may have ended the threads of the new participant as well.
                Err(TransportError::Other(_)) => thread::sleep(PAUSE),
            }
            new = signals::with_blocked(open);
        }
        let session = new?;
        self.set_discovery(Some(session.discovery()));
        *connection = Connection::Connected(session);
        Ok(())
    }

    pub(super) fn add_writer(
        &self,
        node: &Arc<NodeName>,
        spec: EndpointSpec,
    ) -> Result<Arc<Writer>, NodeError> {
        let topic = self.topics.topic(&spec.dds_topic);
        let writer = Arc::new(Writer::new(spec, Arc::clone(node), topic));
        self.transport.settle();
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
        self.transport.settle();
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

    /// Replaces the session after a failure to add an endpoint: the session may have deadlocked, or a signal may have
    /// ended its threads while the node was created. The new session has all endpoints including this one; otherwise an
    /// error is returned. If only file descriptors are missing, the session is kept.
    fn reconnect_with_endpoint(
        &self,
        connection: &mut Connection,
        node: &NodeName,
        (verb, spec): (&str, &EndpointSpec),
        why: TransportError,
    ) -> Result<(), NodeError> {
        let error = NodeError::dds(node, format!("{verb} {}", spec.name), &why);
        let old = match why {
            TransportError::NoDescriptors(_) => return Err(error),
            TransportError::Deadlocked(stuck) => {
                tracing::warn!("{error}; joining the graph again");
                stuck
            }
            TransportError::Other(_) => AbandonedSession::default(),
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
        // Dropped without locks, since the transport may take long.
        drop(detached);
    }

    /// Removes a subscription. Samples that were received before are still handled.
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
        if let Some(discovery) = self.discovery() {
            let found = discovery.publishers();
            let warned = self.warned_topics.lock();
            let mut warned = warned.unwrap_or_else(PoisonError::into_inner);
            publishers.extend(discovery::publishers(found, node, &mut warned));
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

    /// Topics of the other nodes of this participant, except those that every node has.
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

    /// Calls `watcher` for every present and future topic that another node of this participant publishes or subscribes
    /// to. For a new endpoint the call comes before its first message, in the thread that creates it.
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

    /// Logs that a sample is not of its subscription's type, at a limited rate.
    pub(super) fn report_invalid(&self, reader: &Reader, publisher: Gid, length: usize) {
        let problem = not_of_type(&reader.spec, length);
        reader.report_invalid(&self.shared.graph, Some(publisher), &problem);
    }

    /// Full name of the node that `publisher` belongs to, if it is known.
    pub(super) fn node_of(&self, publisher: Gid) -> Option<String> {
        let endpoints = self.endpoints();
        let mut writers = endpoints.writers.iter();
        let own = writers.find(|w| w.identity() == publisher);
        let own = own.map(|writer| writer.node.full());
        drop(endpoints);
        own.or_else(|| self.shared.graph.node_of(publisher))
    }

    /// Full names of the nodes.
    pub(super) fn node_names(&self) -> Vec<String> {
        let endpoints = self.endpoints();
        endpoints.nodes.iter().map(|n| n.name.full()).collect()
    }

    /// Whether all nodes are stopping.
    pub(super) fn is_stopping(&self) -> bool {
        let endpoints = self.endpoints();
        endpoints.nodes.iter().all(|n| n.stop_state.is_stopping())
    }
}

fn warn_of_mismatches(spec: &EndpointSpec, node: &NodeName, mismatches: &[Mismatch]) {
    // One warning suffices.
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

/// The participants of a process. Each has a domain and at least one node.
#[derive(Default)]
pub(super) struct Participants {
    all: Mutex<Vec<Weak<Participant>>>,
    middleware: Middleware,
}

impl Participants {
    /// No participants yet; all future ones use this middleware.
    pub(super) fn new(middleware: Middleware) -> Self {
        Self {
            all: Mutex::default(),
            middleware,
        }
    }

    /// Adds a node to the participant of its domain. Creates the participant if there is none, if the existing one is
    /// closed, or if the node is `isolated`.
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
        let new = Arc::new(Participant::new(domain, &self.middleware));
        new.add_node(node)?;
        all.push(Arc::downgrade(&new));
        Ok(new)
    }

    /// Participants that are not stopping.
    fn working(&self) -> Vec<Arc<Participant>> {
        let all = self.all.lock().unwrap_or_else(PoisonError::into_inner);
        let all = all.iter().filter_map(Weak::upgrade);
        all.filter(|p| !p.is_stopping()).collect()
    }

    /// Connects the participants whose reconnection has failed. Must be called periodically.
    pub(super) fn connect_again(&self) {
        for participant in self.working() {
            if participant.connect_again() {
                let nodes = participant.node_names().join(", ");
                tracing::info!("{nodes}: joined the graph again");
            }
        }
    }

    /// Reconnects, in parallel, all participants that are not stopping and whose session does not survive this
    /// interruption. Each spends most of the time waiting.
    pub(super) fn reconnect_after_interruption(&self, reason: &str) {
        thread::scope(|scope| {
            for participant in self.working() {
                scope.spawn(move || participant.reconnect_after_interruption(reason));
            }
        });
    }

    /// Reconnects the participants to which a lost peer has returned. Must be called periodically.
    pub(super) fn reconnect_after_loss(&self) {
        for participant in self.working() {
            if let Some(reason) = participant.take_returned_peer() {
                participant.reconnect_and_log(&reason);
            }
        }
    }
}
