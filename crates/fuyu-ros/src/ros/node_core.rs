//! State of a node, shared by its handle, endpoints and threads. It persists when the session of the transport is
//! replaced.

use bytes::Bytes;
use std::{
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
    },
    time::Duration,
};

use super::{
    Clock, Diagnostics, Domain, NodeError, NodeName, Qos,
    clock_follower::ClockFollower,
    endpoint::{Destination, EndpointSpec, Handler, Inbox, Member, Reader, Sink, Writer},
    events::{Events, StopState},
    handler_queue::HandlerQueue,
    local_delivery::{AnyMessage, Outgoing},
    names::Names,
    params::ParameterStore,
    participant::{Participant, Participants},
    publisher::SendQueue,
    sample::SampleIdentity,
};
use crate::msg::{Interface, cdr, rosgraph_msgs};

/// State of a node, shared by its handle, its endpoints and its threads.
pub(super) struct NodeCore {
    pub(super) names: Names,
    /// Name of the node; the pointer identifies the node within its participant.
    pub(super) name: Arc<NodeName>,
    pub(super) participant: Arc<Participant>,
    /// Whether the node is a process of its own.
    pub(super) is_only_node: bool,
    pub(super) events: Arc<Events>,
    pub(super) stop_state: Arc<StopState>,
    pub(super) send_queue: SendQueue,
    pub(super) handlers: Arc<HandlerQueue>,
    pub(super) params: Arc<ParameterStore>,
    pub(super) clock: Clock,
    pub(super) diagnostics: Diagnostics,
    /// Event count at the last wait of the program.
    pub(super) seen: AtomicU64,
    /// Whether the program has declared that it is ready.
    pub(super) is_ready: AtomicBool,
    follows_clock: Mutex<bool>,
    /// Publisher of `/rosout`, if it is enabled.
    log: OnceLock<Arc<Writer>>,
}

/// Process and participant of a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) domain: Domain,
    /// Whether the node has a participant of its own although the process has other nodes.
    pub(super) isolated: bool,
    /// Whether the node is a process of its own.
    pub(super) only_node: bool,
}

impl NodeCore {
    /// A node that uses one of the `participants`, or a new one if it is isolated.
    pub(super) fn new(
        names: Names,
        params: Arc<ParameterStore>,
        participants: &Participants,
        place: Place,
    ) -> Result<Self, NodeError> {
        let events = Arc::new(Events::default());
        let stop_state = Arc::new(StopState::new(Arc::clone(&events)));
        let name = Arc::new(names.node().clone());
        let member = Member {
            name: Arc::clone(&name),
            stop_state: Arc::clone(&stop_state),
        };
        Ok(Self {
            participant: participants.add_node(place.domain, &member, place.isolated)?,
            is_only_node: place.only_node,
            clock: Clock::new(Arc::clone(&events)),
            stop_state,
            names,
            name,
            events,
            send_queue: SendQueue::default(),
            handlers: Arc::default(),
            params,
            diagnostics: Diagnostics::default(),
            seen: AtomicU64::new(0),
            is_ready: AtomicBool::new(false),
            follows_clock: Mutex::new(false),
            log: OnceLock::new(),
        })
    }

    /// The node's entry in its participant.
    pub(super) fn member(&self) -> Member {
        Member {
            name: Arc::clone(&self.name),
            stop_state: Arc::clone(&self.stop_state),
        }
    }

    pub(super) fn set_log(&self, writer: Arc<Writer>) {
        // A node starts only once, so the log is not set yet.
        let _ = self.log.set(writer);
    }

    pub(super) fn log(&self) -> Option<&Arc<Writer>> {
        self.log.get()
    }

    /// Removes the node from the graph permanently.
    pub(super) fn leave(&self) {
        self.participant.remove_node(&self.name);
    }

    pub(super) fn add_writer(&self, spec: EndpointSpec) -> Result<Arc<Writer>, NodeError> {
        self.participant.add_writer(&self.name, spec)
    }

    /// Creates a subscription whose handler runs on the receiving thread.
    pub(super) fn add_reader(
        &self,
        spec: EndpointSpec,
        sink: Sink,
    ) -> Result<Arc<Reader>, NodeError> {
        self.add_patient_reader(spec, sink, Duration::ZERO)
    }

    /// As [`Self::add_reader`]; samples may wait for `patience`, so that the thread handles several at once.
    pub(super) fn add_patient_reader(
        &self,
        spec: EndpointSpec,
        sink: Sink,
        patience: Duration,
    ) -> Result<Arc<Reader>, NodeError> {
        let handler = Handler {
            sink,
            patience,
            queue: Arc::clone(&self.handlers),
        };
        let destination = Destination::Handler(handler);
        self.participant.add_reader(&self.name, spec, destination)
    }

    /// Creates a subscription with a queue.
    pub(super) fn add_queue(
        &self,
        spec: EndpointSpec,
        inbox: Arc<dyn Inbox>,
    ) -> Result<Arc<Reader>, NodeError> {
        let destination = Destination::Inbox(inbox);
        self.participant.add_reader(&self.name, spec, destination)
    }

    pub(super) fn remove_writer(&self, writer: &Arc<Writer>) {
        self.participant.remove_writer(writer);
    }

    pub(super) fn remove_reader(&self, reader: &Arc<Reader>) {
        self.participant.remove_reader(reader);
    }

    /// Publishes a message: in memory within this participant, through the transport to others.
    pub(super) fn publish<M: Interface>(&self, writer: &Arc<Writer>, message: &M) {
        let share = || -> AnyMessage { Arc::new(message.clone()) };
        self.publish_bytes(writer, cdr::encode(message).into(), Some(&share));
    }

    /// As [`Self::publish`], for a message that is already serialized (CDR).
    pub(super) fn publish_cdr(&self, writer: &Arc<Writer>, cdr: Bytes) {
        self.publish_bytes(writer, cdr, None);
    }

    /// Sends the response to a request of a client in the same participant.
    pub(super) fn reply_locally<M: Interface>(
        &self,
        writer: &Arc<Writer>,
        response: &M,
        question: SampleIdentity,
    ) {
        let outgoing = Outgoing {
            cdr: cdr::encode(response).into(),
            message: None,
            related: Some(question),
            identity: None,
        };
        writer.local.deliver(writer, outgoing);
        writer.counters.count();
    }

    /// Sends the response to a request of a client in another participant.
    pub(super) fn reply<M: Interface>(
        &self,
        writer: &Arc<Writer>,
        response: &M,
        question: SampleIdentity,
    ) {
        let cdr = cdr::encode(response).into();
        self.send_queue.push(writer, cdr, Some(question));
    }

    fn publish_bytes(
        &self,
        writer: &Arc<Writer>,
        cdr: Bytes,
        message: Option<&dyn Fn() -> AnyMessage>,
    ) {
        let outgoing = Outgoing {
            cdr: cdr.clone(),
            message,
            related: None,
            identity: None,
        };
        writer.local.deliver(writer, outgoing);
        match writer.is_needed_elsewhere() {
            true => self.send_queue.push(writer, cdr, None),
            false => writer.counters.count(),
        }
    }

    /// Switches between the computer's time and simulated time; subscribes to `/clock` when that is first needed.
    pub(super) fn use_sim_time(&self, simulated: bool) -> Result<(), NodeError> {
        let mut following = self
            .follows_clock
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if simulated && !*following {
            let topic = self.names.topic("/clock")?;
            let spec = EndpointSpec::topic::<rosgraph_msgs::Clock>(&topic, Qos::CLOCK_SUBSCRIPTION);
            let participant = Arc::downgrade(&self.participant);
            let follower = ClockFollower::new(
                topic,
                self.clock.clone(),
                Arc::clone(&self.name),
                participant,
            );
            self.add_queue(spec.shared(), Arc::new(follower))?;
            *following = true;
        }
        self.clock.simulate(simulated);
        Ok(())
    }

    pub(super) fn request_stop(&self) {
        self.stop_state.stop();
    }

    /// Number of lost messages of a publisher.
    pub(super) fn lost(writer: &Writer) -> u64 {
        let counters = &writer.counters;
        counters.dropped.load(Relaxed) + counters.failed.load(Relaxed)
    }
}
