//! Handle of a node, which its program uses.

use std::{
    sync::{Arc, atomic::Ordering},
    time::{Duration, Instant},
};

use super::{
    Clock, Declare, Diagnostics, Domain, Gid, NodeError, NodeName, Publisher, Qos, RawPublisher,
    RawSample, RawSubscription, RosArgs, ServiceClient, Subscription, Time, Timer,
    discovery::{self, DiscoveredPublisher, LocalTopicUse},
    endpoint::{Counters, EndpointSpec, Role},
    node_core::NodeCore,
    params::ParameterStore,
    receive_queue::ReceiveQueue,
    service::{Calls, Reply, ServiceServer},
};
use crate::msg::{self, Interface, Service};

/// Options for starting a node.
#[derive(Debug, Clone)]
pub struct NodeOptions {
    /// Name that the program gives the node; remaps may change it.
    pub name: String,
    /// Namespace, `/` unless given.
    pub namespace: String,
    /// Remaps and parameters.
    pub args: Arc<RosArgs>,
    /// DDS domain and discovery range of the participant.
    pub domain: Domain,
    /// Whether the node has the six parameter services and publishes parameter events, as nodes usually do.
    pub parameter_services: bool,
}

/// A node of the ROS graph. Clones refer to the same node; only one thread at a time may wait on it.
#[derive(Clone)]
pub struct Node {
    pub(super) core: Arc<NodeCore>,
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

    /// Creates a publisher on `topic`, which is expanded and remapped.
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

    /// Creates a publisher of serialized messages on `topic`, which is expanded and remapped. The type (`pkg/msg/Name`)
    /// need not be declared in this program.
    ///
    /// # Errors
    /// As [`Self::subscribe_raw`].
    pub fn advertise_raw(
        &self,
        topic: &str,
        type_name: &str,
        qos: Qos,
    ) -> Result<RawPublisher, NodeError> {
        self.advertise_recorded(topic, type_name, None, qos)
    }

    /// As [`Self::advertise_raw`], with the type hash (`RIHS01_...`) from a bag or a peer. Zenoh needs the hash of
    /// types that are not declared in this program, since it is part of the topic's key.
    ///
    /// # Errors
    /// As [`Self::subscribe_raw`].
    pub fn advertise_recorded(
        &self,
        topic: &str,
        type_name: &str,
        type_hash: Option<&str>,
        qos: Qos,
    ) -> Result<RawPublisher, NodeError> {
        let mut spec = raw_spec(self.core.names.topic(topic)?, type_name, qos)?;
        spec.stated_hash = type_hash.map(str::to_owned);
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
        let events = Arc::clone(&self.core.events);
        let inbox = Arc::new(ReceiveQueue::<M>::new(&spec, events));
        let queue = Arc::clone(&inbox);
        let reader = self.core.add_queue(spec, queue)?;
        Ok(Subscription::new(Arc::clone(&self.core), reader, inbox))
    }

    /// Subscribes to serialized messages of `topic`, whose type (`pkg/msg/Name`) need not be declared in this program.
    /// The handler runs on the node's receiving thread: it should be fast. A panic in it ends the node.
    ///
    /// # Errors
    /// [`NodeError::Name`] for an invalid name, [`NodeError::Input`] for a type that is not of the form above,
    /// [`NodeError::Dds`] if DDS refuses.
    pub fn subscribe_raw(
        &self,
        topic: &str,
        type_name: &str,
        qos: Qos,
        handler: impl Fn(RawSample) + Send + Sync + 'static,
    ) -> Result<RawSubscription, NodeError> {
        self.subscribe_resolved(self.core.names.topic(topic)?, type_name, qos, handler)
    }

    /// As [`Self::subscribe_raw`], to the topic of a discovered publisher, whose name is not remapped.
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
        let mut spec = raw_spec(topic, &publisher.type_name, qos)?;
        spec.stated_hash.clone_from(&publisher.type_hash);
        self.subscribe_spec(spec, Duration::ZERO, handler)
    }

    /// As [`Self::subscribe_raw`], to a topic by its full name, which is not remapped.
    ///
    /// # Errors
    /// [`NodeError::Input`] for a type that is not of the form `pkg/msg/Name`, [`NodeError::Dds`] if DDS refuses.
    pub fn subscribe_resolved(
        &self,
        name: String,
        type_name: &str,
        qos: Qos,
        handler: impl Fn(RawSample) + Send + Sync + 'static,
    ) -> Result<RawSubscription, NodeError> {
        self.subscribe_patiently(name, type_name, qos, Duration::ZERO, handler)
    }

    /// As [`Self::subscribe_resolved`], with a handler that may run up to `patience` after a sample has arrived, or
    /// later while the receiving thread is busy. The receiving thread then handles all samples of that time together,
    /// in the order of their arrival, which costs much less than waking for each. Service calls of the node do not
    /// wait.
    ///
    /// # Errors
    /// As [`Self::subscribe_resolved`].
    pub fn subscribe_patiently(
        &self,
        name: String,
        type_name: &str,
        qos: Qos,
        patience: Duration,
        handler: impl Fn(RawSample) + Send + Sync + 'static,
    ) -> Result<RawSubscription, NodeError> {
        self.subscribe_spec(raw_spec(name, type_name, qos)?, patience, handler)
    }

    fn subscribe_spec(
        &self,
        spec: EndpointSpec,
        patience: Duration,
        handler: impl Fn(RawSample) + Send + Sync + 'static,
    ) -> Result<RawSubscription, NodeError> {
        let sink = move |sample: RawSample, _: &Counters| {
            handler(sample);
            true
        };
        let sink = Box::new(sink);
        let reader = self.core.add_patient_reader(spec, sink, patience)?;
        Ok(RawSubscription::new(Arc::clone(&self.core), reader))
    }

    /// Serves `name`, which is expanded and remapped. The handler runs on the node's receiving thread: it should be
    /// fast.
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

    /// As [`Self::serve`], but the handler may return before the reply is sent, later and from any thread.
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

    /// Serves `name`, which is expanded and remapped. Calls wait in a queue for the program and wake it.
    ///
    /// # Errors
    /// As [`Self::serve`].
    pub fn serve_calls<S: Service>(&self, name: &str) -> Result<Calls<S>, NodeError> {
        let full_name = self.core.names.service(name)?;
        Calls::new(&self.core, &full_name)
    }

    /// Creates a client of the service `name`, which is expanded and remapped.
    ///
    /// # Errors
    /// As [`Self::serve`].
    pub fn client<S: Service>(&self, name: &str) -> Result<ServiceClient<S>, NodeError> {
        let full_name = self.core.names.service(name)?;
        ServiceClient::new(&self.core, &full_name)
    }

    /// The full name of a topic, expanded and remapped.
    ///
    /// # Errors
    /// [`NodeError::Name`] for a name against the rules.
    pub fn resolve_topic(&self, topic: &str) -> Result<String, NodeError> {
        Ok(self.core.names.topic(topic)?)
    }

    /// Publishers of other nodes, of the same participant and discovered ones.
    pub fn discovered_publishers(&self) -> Vec<DiscoveredPublisher> {
        self.core.participant.publishers(&self.core.name)
    }

    /// Topics of other nodes of the same participant, except those that every node has.
    pub fn local_topics(&self) -> Vec<LocalTopicUse> {
        self.core.participant.local_topics(&self.core.name)
    }

    /// Calls `handler` for every present and future topic that another node of the same participant publishes or
    /// subscribes to. For a new endpoint the call comes before its first message, in the thread that creates it. The
    /// handler may subscribe; it should be fast, and a panic in it ends this node.
    pub fn watch_local_topics(&self, handler: impl Fn(&LocalTopicUse) + Send + Sync + 'static) {
        let (participant, node) = (&self.core.participant, self.core.member());
        participant.watch_topics(&node, Arc::new(handler));
    }

    /// Whether the node is a process of its own, started by [`run`](super::run).
    pub fn is_only_node(&self) -> bool {
        self.core.is_only_node
    }

    /// Text for log messages that identifies a publisher: `node` with the full name of its node, or its GID if the node
    /// is not known.
    pub fn owner_of(&self, publisher: Gid) -> String {
        match self.node_of(publisher) {
            Some(name) => format!("node {name}"),
            None => format!("publisher {publisher:?}"),
        }
    }

    /// Full name of the node that a publisher belongs to, if known.
    pub fn node_of(&self, publisher: Gid) -> Option<String> {
        self.core.participant.node_of(publisher)
    }

    /// Topics on which the node has lost messages because it was too slow, with their numbers.
    pub fn lost_messages(&self) -> Vec<(String, u64)> {
        let endpoints = self.core.participant.endpoints();
        let own = |node: &Arc<NodeName>| Arc::ptr_eq(node, &self.core.name);
        let writers = endpoints.writers.iter().filter(|w| own(&w.node));
        let writers = writers.map(|w| (&w.spec, &w.counters));
        let readers = endpoints.readers.iter().filter(|r| own(&r.node));
        let readers = readers.map(|r| (&r.spec, &r.counters));
        (writers.chain(readers))
            .filter(|(spec, counters)| !spec.internal && counters.overrun() > 0)
            .map(|(spec, counters)| (spec.name.clone(), counters.overrun()))
            .collect()
    }

    /// Diagnostics of the node.
    pub fn diagnostics(&self) -> &Diagnostics {
        &self.core.diagnostics
    }

    /// The node's clock.
    pub fn clock(&self) -> &Clock {
        &self.core.clock
    }

    /// The node's time: of the computer, or from `/clock`.
    pub fn now(&self) -> Time {
        self.core.clock.now()
    }

    /// A timer in the node's time.
    pub fn timer(&self, period: Duration) -> Timer {
        Timer::new(self.core.clock.clone(), period)
    }

    /// Whether the node should continue; false after a stop request.
    pub fn ok(&self) -> bool {
        !self.core.stop_state.is_stopping()
    }

    /// Declares that the program has created the endpoints that other nodes should find.
    pub fn set_ready(&self) {
        self.core.is_ready.store(true, Ordering::Release);
    }

    /// Whether the program has declared that it is ready ([`Self::set_ready`]).
    pub fn is_ready(&self) -> bool {
        self.core.is_ready.load(Ordering::Acquire)
    }

    /// Requests the node to stop.
    pub fn request_stop(&self) {
        self.core.request_stop();
    }

    /// Waits for an event: a message, a service call, a changed parameter, a tick of the simulated clock or a stop
    /// request. Returns at once if an event has occurred since the last wait. Returns [`Self::ok`].
    pub fn wait(&self) -> bool {
        self.wait_event(None)
    }

    /// As [`Self::wait`], for at most `patience` (wall time).
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

    /// Sleeps until `deadline` in the node's time. Only a stop request ends the sleep early. Returns [`Self::ok`].
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

/// Specification of an endpoint whose type is known only by name.
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
        definition: msg::find(type_name),
        internal: false,
        shared: false,
        role: Role::Topic,
        stated_hash: None,
    })
}
