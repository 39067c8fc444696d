//! Services: a request topic, a reply topic, and the sample identity that links a reply to its request.

use std::{
    collections::VecDeque,
    marker::PhantomData,
    sync::{Arc, Mutex, PoisonError, Weak, atomic::Ordering::Relaxed},
};

use super::{
    NodeError, Qos, RawSample,
    endpoint::{Counters, EndpointSpec, Reader, Role, Writer},
    node_core::NodeCore,
    publisher::LAST_MESSAGES,
    sample::{ReplyPath, SampleIdentity},
};
use crate::msg::{Interface, Service, ServiceDefinition, cdr};

/// Largest number of calls that wait for the program; further ones get no reply.
const WAITING: usize = 64;

/// One direction of a service: prefix and suffix of the DDS topic, suffix of the type, and role of the samples.
pub(super) struct Direction {
    prefix: &'static str,
    suffix: &'static str,
    part: &'static str,
    role: fn(ServiceDefinition) -> Role,
}
/// From the client to the server.
pub(super) const REQUEST: Direction = Direction {
    prefix: "rq",
    suffix: "Request",
    part: "Request",
    role: Role::Request,
};
/// From the server to the client.
pub(super) const REPLY: Direction = Direction {
    prefix: "rr",
    suffix: "Reply",
    part: "Response",
    role: Role::Reply,
};

/// Topic, type and QoS of one direction of a service.
pub(super) fn service_spec<S: Service>(full_name: &str, direction: Direction) -> EndpointSpec {
    let Direction {
        prefix,
        suffix,
        part,
        role,
    } = direction;
    let kind = S::Request::DEFINITION.kind.name();
    EndpointSpec {
        name: full_name.to_owned(),
        dds_topic: format!("{prefix}{full_name}{suffix}"),
        dds_type: format!("{}::{kind}::dds_::{}_{part}_", S::PACKAGE, S::NAME),
        qos: Qos::SERVICES,
        // DDS peers state the hash of the service, not of this part.
        definition: None,
        internal: true,
        shared: false,
        role: role(ServiceDefinition::of::<S>()),
        stated_hash: None,
    }
}

/// Serves a service until it is dropped.
pub struct ServiceServer {
    core: Arc<NodeCore>,
    reader: Arc<Reader>,
    writer: Arc<Writer>,
}

impl ServiceServer {
    /// Creates a server. `handler` runs on the node's receiving thread: it should be fast, and may send the reply
    /// later.
    pub(super) fn new<S: Service>(
        core: &Arc<NodeCore>,
        full_name: &str,
        handler: impl Fn(S::Request, Reply<S>) + Send + Sync + 'static,
    ) -> Result<Self, NodeError> {
        let writer = core.add_writer(service_spec::<S>(full_name, REPLY))?;
        let replies = Arc::clone(&writer);
        let weak = Arc::downgrade(core);
        let sink = move |sample: RawSample, _: &Counters| {
            let Ok(request) = cdr::decode::<S::Request>(&sample.cdr) else {
                return false;
            };
            let reply = Reply {
                core: Weak::clone(&weak),
                writer: Arc::clone(&replies),
                question: question(&sample),
                path: sample.reply_path,
                service: PhantomData,
            };
            handler(request, reply);
            true
        };
        let reader = core.add_reader(service_spec::<S>(full_name, REQUEST), Box::new(sink))?;
        Ok(Self {
            core: Arc::clone(core),
            reader,
            writer,
        })
    }

    /// Full name of the service.
    pub fn name(&self) -> &str {
        &self.reader.spec.name
    }
}

impl Drop for ServiceServer {
    /// Ensures that living clients receive the last replies before the service leaves the graph.
    fn drop(&mut self) {
        self.core.remove_reader(&self.reader);
        self.core
            .send_queue
            .flush_writer(&self.writer, LAST_MESSAGES);
        if self.writer.counters.messages.load(Relaxed) > 0 {
            self.writer.finish(LAST_MESSAGES);
        }
        self.core.remove_writer(&self.writer);
    }
}

/// Sends the response to one call, at any time and from any thread. If it is dropped, the client gets no response.
pub struct Reply<S> {
    core: Weak<NodeCore>,
    writer: Arc<Writer>,
    question: SampleIdentity,
    path: ReplyPath,
    service: PhantomData<fn(S)>,
}

impl<S: Service> Reply<S> {
    /// Sends the response as soon as the client can receive it.
    pub fn send(self, response: &S::Response) {
        let Some(core) = self.core.upgrade() else {
            return;
        };
        match self.path {
            ReplyPath::Local => core.reply_locally(&self.writer, response, self.question),
            ReplyPath::Wire => core.reply(&self.writer, response, self.question),
            ReplyPath::Matched(client) => {
                let response = response.clone();
                let writer = Arc::clone(&self.writer);
                let send = move || {
                    if let Some(core) = self.core.upgrade() {
                        core.reply(&self.writer, &response, self.question);
                    }
                };
                writer.held.send(client, &writer.counters, send);
            }
        }
    }
}

/// A call that has not been responded to.
pub struct Call<S: Service> {
    /// The request.
    pub request: S::Request,
    /// Sender of the response.
    pub reply: Reply<S>,
}

/// Serves a service whose calls wait in a queue for the node's program, like the messages of a subscription.
pub struct Calls<S: Service> {
    queue: Arc<Mutex<VecDeque<Call<S>>>>,
    _server: ServiceServer,
}

impl<S: Service> Calls<S> {
    pub(super) fn new(core: &Arc<NodeCore>, full_name: &str) -> Result<Self, NodeError> {
        let queue = Arc::new(Mutex::new(VecDeque::new()));
        let (waiting, events) = (Arc::clone(&queue), Arc::clone(&core.events));
        let server = ServiceServer::new::<S>(core, full_name, move |request, reply| {
            let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
            if waiting.len() < WAITING {
                waiting.push_back(Call { request, reply });
            }
            drop(waiting);
            events.notify();
        })?;
        Ok(Self {
            queue,
            _server: server,
        })
    }

    /// Whether no call is waiting.
    pub fn is_empty(&self) -> bool {
        let queue = self.queue.lock().unwrap_or_else(PoisonError::into_inner);
        queue.is_empty()
    }

    /// Takes the oldest waiting call.
    pub fn take(&self) -> Option<Call<S>> {
        let mut queue = self.queue.lock().unwrap_or_else(PoisonError::into_inner);
        queue.pop_front()
    }
}

/// Identity that the reply must state. Fast DDS clients state the GUID of their reply reader without a sequence number;
/// the number is then that of the sample. If the request states nothing, it is the identity of the sample.
fn question(sample: &RawSample) -> SampleIdentity {
    let mut question = sample.related.unwrap_or(sample.identity);
    if question.sequence_number == SampleIdentity::UNKNOWN_NUMBER {
        question.sequence_number = sample.identity.sequence_number;
    }
    question
}
