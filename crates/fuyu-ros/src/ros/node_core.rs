//! State of a node that its handle, endpoints and threads share; it outlives DDS participants.

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, atomic::AtomicU64};

use super::{
    Clock, Diagnostics, Domain, NodeError, Qos, RawSample,
    discovery_settling::DiscoverySettling,
    endpoint::{Counters, EndpointSpec, Endpoints, Reader, Sink, Writer},
    events::{Events, StopState},
    graph_cache::GraphCache,
    names::Names,
    params::ParameterStore,
    participant_watchdog::{AbandonedParticipant, EntityError},
    publisher::SendQueue,
    session::Session,
    signals,
};
use crate::msg::{cdr, rosgraph_msgs};

/// Participants that are tried, one after the other, before a node fails.
const MAX_PARTICIPANTS: usize = 5;

/// Whether a node is in the graph.
#[derive(Default)]
pub(super) enum Connection {
    /// Not connected yet, or no more because DDS failed; it may connect.
    #[default]
    Disconnected,
    Connected(Box<Session>),
    /// Left the graph for good; a new participant would never be closed.
    Closed,
}

impl Connection {
    pub(super) fn session(&mut self) -> Option<&mut Session> {
        match self {
            Self::Connected(session) => Some(session),
            Self::Disconnected | Self::Closed => None,
        }
    }
}

/// State of a node, shared by its handle, its endpoints and its threads.
pub(super) struct NodeCore {
    pub(super) names: Names,
    pub(super) domain: Domain,
    pub(super) events: Arc<Events>,
    pub(super) stop_state: Arc<StopState>,
    pub(super) send_queue: SendQueue,
    pub(super) endpoints: Arc<Mutex<Endpoints>>,
    session: Mutex<Connection>,
    pub(super) graph: Arc<GraphCache>,
    settling: Arc<DiscoverySettling>,
    pub(super) params: Arc<ParameterStore>,
    pub(super) clock: Clock,
    pub(super) diagnostics: Diagnostics,
    /// Count of events at the last wait of the program.
    pub(super) seen: AtomicU64,
    follows_clock: Mutex<bool>,
    /// Where `/rosout` is published, if it is.
    log: OnceLock<Arc<Writer>>,
}

impl NodeCore {
    pub(super) fn new(names: Names, domain: Domain, params: Arc<ParameterStore>) -> Self {
        let events = Arc::new(Events::default());
        Self {
            clock: Clock::new(Arc::clone(&events)),
            stop_state: Arc::new(StopState::new(Arc::clone(&events))),
            graph: Arc::new(GraphCache::new(names.node())),
            names,
            domain,
            events,
            send_queue: SendQueue::default(),
            endpoints: Arc::default(),
            session: Mutex::default(),
            settling: Arc::default(),
            params,
            diagnostics: Diagnostics::default(),
            seen: AtomicU64::new(0),
            follows_clock: Mutex::new(false),
            log: OnceLock::new(),
        }
    }

    pub(super) fn set_log(&self, writer: Arc<Writer>) {
        // A node starts once.
        let _ = self.log.set(writer);
    }

    pub(super) fn log(&self) -> Option<&Arc<Writer>> {
        self.log.get()
    }

    /// Creates a participant with all endpoints and replaces the present one, if any. Returns false if the node has left
    /// the graph for good.
    pub(super) fn open_session(&self) -> Result<bool, NodeError> {
        self.replace_session(&mut self.lock_session(), AbandonedParticipant::default())
    }

    /// The same in place of a participant that may have deadlocked.
    fn replace_session(
        &self,
        connection: &mut Connection,
        mut old: AbandonedParticipant,
    ) -> Result<bool, NodeError> {
        match std::mem::take(connection) {
            Connection::Closed => {
                *connection = Connection::Closed;
                return Ok(false);
            }
            // Its drop may wait for threads that have ended, so it is dropped elsewhere.
            Connection::Connected(session) => {
                old.keep((Session::detach(&self.lock_endpoints()), session));
            }
            Connection::Disconnected => {}
        }
        drop(old);
        let node = self.names.node();
        let others = (&self.graph, &self.settling);
        let open = || Session::open(self.domain, node, &self.endpoints, &self.stop_state, others);
        let mut new = signals::with_blocked(open);
        for _ in 1..MAX_PARTICIPANTS {
            if let Err(EntityError::Deadlocked(_)) = new {
                new = signals::with_blocked(open);
            }
        }
        let new = new.map_err(|e| NodeError::dds(node, "join the DDS domain", e))?;
        *connection = Connection::Connected(Box::new(new));
        Ok(true)
    }

    /// Leaves the graph for good.
    pub(super) fn close_session(&self) {
        let connection = std::mem::replace(&mut *self.lock_session(), Connection::Closed);
        Session::detach(&self.lock_endpoints());
        drop(connection);
    }

    pub(super) fn lock_session(&self) -> MutexGuard<'_, Connection> {
        self.session.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn lock_endpoints(&self) -> MutexGuard<'_, Endpoints> {
        self.endpoints
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn add_writer(&self, spec: EndpointSpec) -> Result<Arc<Writer>, NodeError> {
        let writer = Arc::new(Writer::new(spec));
        self.settling.wait();
        let mut connection = self.lock_session();
        self.lock_endpoints().writers.push(Arc::clone(&writer));
        if let Some(Err(e)) = connection.session().map(|s| s.add_writer(&writer)) {
            self.reconnect_with_endpoint(&mut connection, "publish", &writer.spec, e)?;
        }
        Ok(writer)
    }

    pub(super) fn add_reader(
        &self,
        spec: EndpointSpec,
        sink: Sink,
    ) -> Result<Arc<Reader>, NodeError> {
        let reader = Arc::new(Reader::new(spec, sink));
        self.settling.wait();
        let mut connection = self.lock_session();
        self.lock_endpoints().readers.push(Arc::clone(&reader));
        if let Some(Err(e)) = connection.session().map(|s| s.add_reader(&reader)) {
            self.reconnect_with_endpoint(&mut connection, "subscribe to", &reader.spec, e)?;
        }
        Ok(reader)
    }

    /// Replaces the participant when an endpoint cannot be added: it may have deadlocked, or a signal may have ended its
    /// threads while the node was created. The new participant has all endpoints including this one, or it is an error.
    fn reconnect_with_endpoint(
        &self,
        connection: &mut Connection,
        verb: &str,
        spec: &EndpointSpec,
        why: EntityError,
    ) -> Result<(), NodeError> {
        let (node, topic) = (self.names.node(), &spec.name);
        let error = NodeError::dds(node, format!("{verb} {topic}"), &why);
        let old = match why {
            EntityError::Deadlocked(stuck) => {
                tracing::warn!("{error}; joining the graph again");
                stuck
            }
            EntityError::Dds(_) => AbandonedParticipant::default(),
        };
        self.replace_session(connection, old)
            .map(drop)
            .map_err(|_| error)
    }

    pub(super) fn remove_writer(&self, writer: &Arc<Writer>) {
        let mut session = self.lock_session();
        if let Some(session) = session.session() {
            session.remove_writer(writer);
        }
        self.lock_endpoints()
            .writers
            .retain(|w| !Arc::ptr_eq(w, writer));
    }

    pub(super) fn remove_reader(&self, reader: &Arc<Reader>) {
        let mut session = self.lock_session();
        if let Some(session) = session.session() {
            session.remove_reader(reader);
        }
        self.lock_endpoints()
            .readers
            .retain(|r| !Arc::ptr_eq(r, reader));
    }

    /// Changes between the computer's time and that of `/clock`, which is subscribed to from then on.
    pub(super) fn use_sim_time(&self, simulated: bool) -> Result<(), NodeError> {
        let mut following = self
            .follows_clock
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if simulated && !*following {
            let topic = self.names.topic("/clock")?;
            let spec = EndpointSpec::topic::<rosgraph_msgs::Clock>(&topic, Qos::CLOCK_SUBSCRIPTION);
            let clock = self.clock.clone();
            let sink = move |sample: RawSample, _: &Counters| {
                let message = cdr::decode::<rosgraph_msgs::Clock>(&sample.cdr);
                message.map(|m| clock.set(m.clock.into())).is_ok()
            };
            self.add_reader(spec, Box::new(sink))?;
            *following = true;
        }
        self.clock.simulate(simulated);
        Ok(())
    }

    pub(super) fn request_stop(&self) {
        self.stop_state.stop();
    }
}
