//! A participant that the nodes of a process share, with their endpoints. It outlives the sessions of its transport.
//!
//! Three locks are taken in this order only: (1) the connection, which is locked while the transport creates an endpoint;
//! (2) the endpoints; (3) a topic inside the participant ([`LocalTopic`](super::local_delivery::LocalTopic)). Messages are
//! delivered, sent and received without lock 1, and the transport destroys endpoints without any lock.

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

/// Sessions that are tried, one after the other, before a node fails.
const MAX_SESSIONS: usize = 5;

/// Pause before the next session is tried.
const PAUSE: Duration = Duration::from_millis(100);

/// How long the end of a subscription waits for its handler.
const LAST_SAMPLES: Duration = Duration::from_secs(5);

/// Whether the nodes are in the graph.
#[derive(Default)]
enum Connection {
    /// Not connected yet, or no more because DDS failed; it may connect.
    #[default]
    Disconnected,
    Connected(Box<dyn Session>),
    /// Left the graph for good, with the last node; a new participant would never be closed.
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

/// Called when another node publishes or subscribes.
type Watcher = Arc<dyn Fn(&LocalTopicUse) + Send + Sync>;

/// One participant and its nodes.
pub(super) struct Participant {
    domain: Domain,
    transport: Arc<dyn Transport>,
    connection: Mutex<Connection>,
    /// For questions that must not wait for the connection.
    discovery: Mutex<Option<Arc<dyn Discovery>>>,
    pub(super) shared: Shared,
    topics: LocalTopics,
    /// Discovered topics and types against the rules of ROS that a warning was logged for.
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

    /// The DDS domain.
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
        // Without locks: the transport may take its time.
        drop(detached);
        drop(closed);
    }

    /// Opens a new session with all endpoints in place of the present one, which no longer works. Returns false
    /// if there is none.
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

    /// Which peer has returned after it was lost, for the log; once per loss.
    fn take_returned_peer(&self) -> Option<String> {
        // Somebody who connects or creates an endpoint must not be waited for; the next call will find it.
        drop(self.connection.try_lock().ok()?);
        self.discovery()?.take_returned_peer()
    }

    /// The same as [`Self::reconnect`], if an interruption of the process or of its time breaks the session.
    fn reconnect_after_interruption(&self, reason: &str) {
        if self.transport.breaks_when_interrupted() {
            self.reconnect_and_log(reason);
        }
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
                .connect(&mut connection, AbandonedSession::default())
                .is_ok()
    }

    /// Connects, in place of a session that may have deadlocked.
    fn connect(
        &self,
        connection: &mut Connection,
        mut old: AbandonedSession,
    ) -> Result<(), TransportError> {
        // Its drop may wait for threads that have ended, so it is dropped elsewhere.
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
                Err(TransportError::Deadlocked(_)) => {}
                // A signal can end the threads of a new participant too.
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

    /// Replaces the session when an endpoint cannot be added: it may have deadlocked, or a signal may have ended its
    /// threads while the node was created. The new one has all endpoints including this one, or it is an error. Where only
    /// descriptors are missing, everything else stays as it is.
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
        // Without locks: the transport may take its time.
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

    /// Topics of the other nodes of this participant, without the topics of every node.
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
    middleware: Middleware,
}

impl Participants {
    /// None yet; all will be connected by this middleware.
    pub(super) fn new(middleware: Middleware) -> Self {
        Self {
            all: Mutex::default(),
            middleware,
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
        let new = Arc::new(Participant::new(domain, &self.middleware));
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

    /// Reconnects all participants whose nodes are not stopping and whose session an interruption for this reason breaks;
    /// at the same time, as each spends most of it waiting.
    pub(super) fn reconnect_after_interruption(&self, reason: &str) {
        thread::scope(|scope| {
            for participant in self.working() {
                scope.spawn(move || participant.reconnect_after_interruption(reason));
            }
        });
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
