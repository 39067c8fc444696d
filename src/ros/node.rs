//! The handle that a node's program works with.

use std::{
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use super::{
    Clock, Declare, Diagnostics, Domain, NodeError, NodeName, Publisher, Qos, RawPublisher,
    RawSample, RawSubscription, RosArgs, Subscription, Time, Timer,
    discovery::{self, DiscoveredPublisher},
    endpoint::{Counters, EndpointSpec, Endpoints, Reader, Sink, Writer},
    names::Names,
    newcomers::Newcomers,
    owners::Owners,
    params::ParameterStore,
    publisher::Outbox,
    service::{Calls, Reply, ServiceServer},
    session::Session,
    signals,
    subscription::Inbox,
    wait::{Events, Fate},
};
use crate::msg::{Interface, Service, cdr, rosgraph_msgs};

/// How a node is started.
#[derive(Debug, Clone)]
pub struct NodeOptions {
    /// Name that the program gives the node; remaps may change it.
    pub name: String,
    /// Namespace, `/` unless given.
    pub namespace: String,
    /// Remaps and parameters.
    pub args: Arc<RosArgs>,
    /// Where its participant lives.
    pub domain: Domain,
}

/// Whether a node is in the graph.
#[derive(Default)]
pub(super) enum Connection {
    /// Not yet, or not any more since DDS refused; it may join.
    #[default]
    Apart,
    Joined(Box<Session>),
    /// It has left for good: nothing may bring it back, since nobody would end it then.
    Left,
}

impl Connection {
    pub(super) fn session(&mut self) -> Option<&mut Session> {
        match self {
            Self::Joined(session) => Some(session),
            Self::Apart | Self::Left => None,
        }
    }
}

/// What a node is made of; shared by its handle, its endpoints and its threads.
pub(super) struct Core {
    pub(super) names: Names,
    pub(super) domain: Domain,
    pub(super) events: Arc<Events>,
    pub(super) fate: Arc<Fate>,
    pub(super) outbox: Outbox,
    pub(super) endpoints: Arc<Mutex<Endpoints>>,
    pub(super) session: Mutex<Connection>,
    newcomers: Arc<Newcomers>,
    pub(super) params: Arc<ParameterStore>,
    pub(super) clock: Clock,
    pub(super) diagnostics: Diagnostics,
    /// Events that the program has seen.
    seen: AtomicU64,
    follows_clock: Mutex<bool>,
    /// Where `/rosout` is published, if it is.
    log: OnceLock<Arc<Writer>>,
}

impl Core {
    pub(super) fn new(names: Names, domain: Domain, params: Arc<ParameterStore>) -> Self {
        let events = Arc::new(Events::default());
        Self {
            clock: Clock::new(Arc::clone(&events)),
            fate: Arc::new(Fate::new(Arc::clone(&events))),
            names,
            domain,
            events,
            outbox: Outbox::default(),
            endpoints: Arc::default(),
            session: Mutex::default(),
            newcomers: Arc::default(),
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

    /// Makes a participant with all endpoints, in place of the one that is there, if any. Gives false
    /// if the node has left the graph, where it stays.
    pub(super) fn open_session(&self) -> Result<bool, NodeError> {
        let mut connection = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        match std::mem::take(&mut *connection) {
            Connection::Left => {
                *connection = Connection::Left;
                return Ok(false);
            }
            Connection::Joined(old) => {
                Session::detach(&self.lock_endpoints());
                // It may wait for threads that are no more; nobody waits for it.
                std::thread::spawn(move || drop(old));
            }
            Connection::Apart => {}
        }
        let node = self.names.node();
        let (endpoints, newcomers) = (&self.endpoints, &self.newcomers);
        let open = || Session::open(self.domain, node, endpoints, &self.fate, newcomers);
        let new = signals::with_blocked(open)
            .map_err(|e| NodeError::dds(node, "join the DDS domain", e))?;
        *connection = Connection::Joined(Box::new(new));
        Ok(true)
    }

    /// Leaves the graph for good.
    pub(super) fn close_session(&self) {
        let connection = {
            let mut connection = self.session.lock().unwrap_or_else(PoisonError::into_inner);
            std::mem::replace(&mut *connection, Connection::Left)
        };
        Session::detach(&self.lock_endpoints());
        drop(connection);
    }

    fn lock_endpoints(&self) -> std::sync::MutexGuard<'_, Endpoints> {
        self.endpoints
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn add_writer(&self, spec: EndpointSpec) -> Result<Arc<Writer>, NodeError> {
        let writer = Arc::new(Writer::new(spec));
        self.newcomers.let_settle();
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        self.lock_endpoints().writers.push(Arc::clone(&writer));
        let added = session.session().map(|session| session.add_writer(&writer));
        drop(session);
        if let Some(Err(e)) = added {
            self.replace_session(|| self.endpoint_error("publish", &writer.spec, &e))?;
        }
        Ok(writer)
    }

    pub(super) fn add_reader(
        &self,
        spec: EndpointSpec,
        sink: Sink,
    ) -> Result<Arc<Reader>, NodeError> {
        let reader = Arc::new(Reader::new(spec, sink));
        self.newcomers.let_settle();
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        self.lock_endpoints().readers.push(Arc::clone(&reader));
        let added = session.session().map(|session| session.add_reader(&reader));
        drop(session);
        if let Some(Err(e)) = added {
            self.replace_session(|| self.endpoint_error("subscribe to", &reader.spec, &e))?;
        }
        Ok(reader)
    }

    /// When an endpoint cannot be added: a signal may have ended the participant's threads while the node was
    /// being made. A participant made anew has all endpoints, this one too; what it cannot have is an error.
    fn replace_session(&self, error: impl FnOnce() -> NodeError) -> Result<(), NodeError> {
        self.open_session().map(drop).map_err(|_| error())
    }

    fn endpoint_error(&self, verb: &str, spec: &EndpointSpec, reason: &str) -> NodeError {
        NodeError::dds(self.names.node(), format!("{verb} {}", spec.name), reason)
    }

    pub(super) fn remove_writer(&self, writer: &Arc<Writer>) {
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(session) = session.session() {
            session.remove_writer(writer);
        }
        self.lock_endpoints()
            .writers
            .retain(|w| !Arc::ptr_eq(w, writer));
    }

    pub(super) fn remove_reader(&self, reader: &Arc<Reader>) {
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
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
        self.fate.stop();
    }
}

/// A node of the ROS graph. Clones are the same node; one thread at a time may wait on it.
#[derive(Clone)]
pub struct Node {
    pub(super) core: Arc<Core>,
}

impl Node {
    /// Namespace and name.
    pub fn name(&self) -> &NodeName {
        self.core.names.node()
    }

    /// Starts the declaration of parameters.
    pub fn declare(&self) -> Declare {
        Declare::new(Arc::clone(&self.core.params))
    }

    /// The node's parameters.
    pub fn parameters(&self) -> &Arc<ParameterStore> {
        &self.core.params
    }

    /// Publishes on `topic`, which is expanded and remapped.
    ///
    /// # Errors
    /// [`NodeError::Name`] for a name against the rules, [`NodeError::Dds`] if DDS refuses.
    pub fn advertise<M: Interface>(
        &self,
        topic: &str,
        qos: Qos,
    ) -> Result<Publisher<M>, NodeError> {
        let spec = self.spec::<M>(topic, qos)?;
        let writer = self.core.add_writer(spec)?;
        Ok(Publisher::new(Arc::clone(&self.core), writer))
    }

    /// Publishes bytes on `topic`, which is expanded and remapped, of a type (`pkg/msg/Name`) that need not be
    /// known to fuyu.
    ///
    /// # Errors
    /// As [`Self::subscribe_raw`].
    pub fn advertise_raw(
        &self,
        topic: &str,
        type_name: &str,
        qos: Qos,
    ) -> Result<RawPublisher, NodeError> {
        let spec = raw_spec(self.core.names.topic(topic)?, type_name, qos)?;
        let writer = self.core.add_writer(spec)?;
        Ok(RawPublisher::new(Arc::clone(&self.core), writer))
    }

    /// Subscribes to `topic`, which is expanded and remapped; messages queue up to the depth of `qos`.
    ///
    /// # Errors
    /// [`NodeError::Name`] for a name against the rules, [`NodeError::Dds`] if DDS refuses.
    pub fn subscribe<M: Interface>(
        &self,
        topic: &str,
        qos: Qos,
    ) -> Result<Subscription<M>, NodeError> {
        let spec = self.spec::<M>(topic, qos)?;
        let inbox = Arc::new(Inbox::<M>::new(qos.depth));
        let queue = Arc::clone(&inbox);
        let events = Arc::clone(&self.core.events);
        let sink = move |sample: RawSample, counters: &Counters| {
            let accepted = queue.accept(&sample, counters);
            events.notify();
            accepted
        };
        let reader = self.core.add_reader(spec, Box::new(sink))?;
        Ok(Subscription::new(Arc::clone(&self.core), reader, inbox))
    }

    /// Subscribes to the bytes of `topic`, whose type (`pkg/msg/Name`) need not be known to fuyu. The
    /// handler runs on the node's receiving thread: it should be quick, and its panic ends the node.
    ///
    /// # Errors
    /// [`NodeError::Name`] for a name against the rules, [`NodeError::Input`] for a type that is not of
    /// the form above, [`NodeError::Dds`] if DDS refuses.
    pub fn subscribe_raw(
        &self,
        topic: &str,
        type_name: &str,
        qos: Qos,
        handler: impl Fn(RawSample) + Send + Sync + 'static,
    ) -> Result<RawSubscription, NodeError> {
        self.subscribe_resolved(self.core.names.topic(topic)?, type_name, qos, handler)
    }

    /// As [`Self::subscribe_raw`], to the topic of a discovered publisher: its name is not remapped.
    ///
    /// # Errors
    /// [`NodeError::Dds`] if DDS refuses.
    pub fn subscribe_discovered(
        &self,
        publisher: &DiscoveredPublisher,
        qos: Qos,
        handler: impl Fn(RawSample) + Send + Sync + 'static,
    ) -> Result<RawSubscription, NodeError> {
        let topic = publisher.topic.clone();
        self.subscribe_resolved(topic, &publisher.type_name, qos, handler)
    }

    fn subscribe_resolved(
        &self,
        name: String,
        type_name: &str,
        qos: Qos,
        handler: impl Fn(RawSample) + Send + Sync + 'static,
    ) -> Result<RawSubscription, NodeError> {
        let spec = raw_spec(name, type_name, qos)?;
        let sink = move |sample: RawSample, _: &Counters| {
            handler(sample);
            true
        };
        let reader = self.core.add_reader(spec, Box::new(sink))?;
        Ok(RawSubscription::new(Arc::clone(&self.core), reader))
    }

    /// Answers calls of the service `name`, which is expanded and remapped. The handler runs on the
    /// node's receiving thread: it should be quick.
    ///
    /// # Errors
    /// [`NodeError::Name`] for a name against the rules, [`NodeError::Dds`] if DDS refuses.
    pub fn serve<S: Service>(
        &self,
        name: &str,
        handler: impl Fn(S::Request) -> S::Response + Send + Sync + 'static,
    ) -> Result<ServiceServer, NodeError> {
        self.serve_later::<S>(name, move |request, reply| reply.send(&handler(request)))
    }

    /// As [`Self::serve`], but the handler may send the reply later, from any thread.
    ///
    /// # Errors
    /// As [`Self::serve`].
    pub fn serve_later<S: Service>(
        &self,
        name: &str,
        handler: impl Fn(S::Request, Reply<S>) + Send + Sync + 'static,
    ) -> Result<ServiceServer, NodeError> {
        let full_name = self.core.names.service(name)?;
        ServiceServer::new::<S>(&self.core, &full_name, handler)
    }

    /// Lets the program answer calls of the service `name`, which is expanded and remapped, when it gets to
    /// it: they wait in a queue.
    ///
    /// # Errors
    /// As [`Self::serve`].
    pub fn serve_calls<S: Service>(&self, name: &str) -> Result<Calls<S>, NodeError> {
        let full_name = self.core.names.service(name)?;
        Calls::new(&self.core, &full_name)
    }

    /// The full name of a topic, expanded and remapped.
    ///
    /// # Errors
    /// [`NodeError::Name`] for a name against the rules.
    pub fn resolve_topic(&self, topic: &str) -> Result<String, NodeError> {
        Ok(self.core.names.topic(topic)?)
    }

    /// Publishers of other nodes, as far as they are discovered.
    pub fn discovered_publishers(&self) -> Vec<DiscoveredPublisher> {
        let mut connection = self
            .core
            .session
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        connection
            .session()
            .map(|s| s.discovered_publishers(self.name()))
            .unwrap_or_default()
    }

    /// Begins to listen whose publishers are.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn owners(&self) -> Result<Owners, NodeError> {
        Owners::new(&self.core)
    }

    /// What the node says of its health.
    pub fn diagnostics(&self) -> &Diagnostics {
        &self.core.diagnostics
    }

    /// The node's clock.
    pub fn clock(&self) -> &Clock {
        &self.core.clock
    }

    /// The node's time: of the computer, or of `/clock`.
    pub fn now(&self) -> Time {
        self.core.clock.now()
    }

    /// A timer in the node's time.
    pub fn timer(&self, period: Duration) -> Timer {
        Timer::new(self.core.clock.clone(), period)
    }

    /// Whether the node should go on; false once it is asked to stop.
    pub fn ok(&self) -> bool {
        !self.core.fate.is_stopping()
    }

    /// Asks the node to stop.
    pub fn request_stop(&self) {
        self.core.request_stop();
    }

    /// Waits until something happens to the node: a message, a changed parameter, a tick of a simulated
    /// clock, the stop. What happened since the last wait counts. Gives [`Self::ok`].
    pub fn wait(&self) -> bool {
        self.wait_event(None)
    }

    /// As [`Self::wait`], but at most `patience` (wall time).
    pub fn wait_for(&self, patience: Duration) -> bool {
        self.wait_event(Instant::now().checked_add(patience))
    }

    /// As [`Self::wait`], but not beyond `deadline` in the node's time.
    pub fn wait_until(&self, deadline: Time) -> bool {
        if self.now() >= deadline {
            return self.ok();
        }
        self.wait_event(self.core.clock.instant(deadline))
    }

    /// Sleeps until `deadline` in the node's time, whatever else happens; only the stop ends it early.
    /// Gives [`Self::ok`].
    pub fn sleep_until(&self, deadline: Time) -> bool {
        while self.ok() && self.now() < deadline {
            self.wait_until(deadline);
        }
        self.ok()
    }

    fn wait_event(&self, deadline: Option<Instant>) -> bool {
        if self.ok() {
            let seen = self.core.seen.load(Ordering::Acquire);
            let seen = self.core.events.wait(seen, deadline);
            self.core.seen.store(seen, Ordering::Release);
        }
        self.ok()
    }

    fn spec<M: Interface>(&self, topic: &str, qos: Qos) -> Result<EndpointSpec, NodeError> {
        let name = self.core.names.topic(topic)?;
        Ok(EndpointSpec {
            internal: false,
            ..EndpointSpec::topic::<M>(&name, qos)
        })
    }
}

/// An endpoint of a type that is known by name only.
fn raw_spec(name: String, type_name: &str, qos: Qos) -> Result<EndpointSpec, NodeError> {
    let Some(dds_type) = discovery::dds_type(type_name) else {
        return Err(NodeError::Input(format!(
            "topic {name}: type {type_name:?} is not of the form pkg/msg/Name"
        )));
    };
    Ok(EndpointSpec {
        dds_topic: format!("rt{name}"),
        name,
        dds_type,
        qos,
        internal: false,
    })
}
