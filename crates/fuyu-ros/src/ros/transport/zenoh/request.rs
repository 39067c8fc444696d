//! Service clients. A request is sent as a Zenoh query, and again if the query ends without a reply.
//!
//! While two peers that a router has introduced connect to each other, routes change. A query that is sent at that
//! moment ends without having reached the server, although the server is in the graph (docs/upstream.md, "Zenoh").

use bytes::Bytes;
use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, MutexGuard, PoisonError, Weak, atomic::Ordering::Relaxed},
    thread,
    time::{Duration, Instant},
};
use zenoh::{
    Session, Wait,
    liveliness::LivelinessToken,
    query::{ConsolidationMode, Querier, QueryTarget},
    sample::{Locality, Sample},
};

use super::{
    attachment::Attachment,
    keys::TopicKey,
    service::{ServiceOfNode, received},
};
use crate::ros::{
    Gid, Time,
    endpoint::{Reader, Writer},
    graph_cache::GraphCache,
    sample::SampleIdentity,
    transport::{TransportError, WireWriter},
};

/// Timeout of queries for the result of an action, in place of the session's timeout.
const RESULT_TIMEOUT: Duration = Duration::from_secs(365 * 24 * 3600);

/// Largest number of times that a request is sent again. Small, since a server that does not detect duplicates may
/// serve each.
const RETRIES: u8 = 5;

/// Delay between the end of a query and the next attempt.
const RETRY_DELAY: Duration = Duration::from_millis(100);

/// Limits of the requests that wait for another attempt: number, and total length \[bytes\]. Beyond them the oldest are
/// discarded.
const WAITING: usize = 1024;
const WAITING_BYTES: usize = 16 << 20;

/// Subscriptions to replies, of all clients of a session.
#[derive(Default)]
pub(super) struct ReplyReaders {
    readers: Mutex<Vec<(ServiceOfNode, Arc<Reader>)>>,
}

impl ReplyReaders {
    pub(super) fn add(&self, reader: &Arc<Reader>) {
        let service = ServiceOfNode::new(&reader.node, &reader.spec.name);
        lock(&self.readers).push((service, Arc::clone(reader)));
    }

    pub(super) fn remove(&self, reader: &Arc<Reader>) {
        lock(&self.readers).retain(|(_, r)| !Arc::ptr_eq(r, reader));
    }

    /// Passes a reply to the client that sent the request.
    fn receive(&self, service: &ServiceOfNode, reply: &Sample, graph: &GraphCache) {
        let attachment = reply.attachment().map(|a| a.to_bytes());
        let attachment = attachment.and_then(|a| Attachment::decode(&a));
        let readers = lock(&self.readers).clone();
        for (_, reader) in readers.iter().filter(|(other, _)| other == service) {
            let Some(attachment) = attachment else {
                reader.report_invalid(graph, None, "its attachment is not one of rmw_zenoh");
                continue;
            };
            let request = attachment.identity();
            let cdr = Bytes::copy_from_slice(&reply.payload().to_bytes());
            reader.receive_remote(received(cdr, attachment, Some(request)), graph);
        }
    }
}

/// A request without a reply.
struct Request {
    cdr: Bytes,
    attachment: Attachment,
    retries: u8,
}

/// Sends the requests of a client.
struct RequestSender {
    service: ServiceOfNode,
    querier: Querier<'static>,
    replies: Arc<ReplyReaders>,
    graph: Arc<GraphCache>,
    /// Writer of the client's requests.
    writer: Weak<Writer>,
    retries: Mutex<RetryQueue>,
}

/// Requests that wait for another attempt, in order of time. A thread sends them and ends when none is left.
#[derive(Default)]
struct RetryQueue {
    requests: VecDeque<(Instant, Request)>,
    bytes: usize,
    has_thread: bool,
}

impl RequestSender {
    /// Sends a request. Returns whether the transport has accepted it.
    fn send(self: &Arc<Self>, request: Request) -> bool {
        let query = self.querier.get().payload(request.cdr.clone());
        let query = query.attachment(request.attachment.encode());
        let state = Arc::new(Mutex::new(QueryState {
            request: Some(request),
            is_accepted: false,
            has_ended: false,
        }));
        let outstanding = Outstanding {
            sender: Arc::downgrade(self),
            state: Arc::clone(&state),
        };
        let sent = query.callback(move |reply| {
            lock(&outstanding.state).request = None;
            let Some(sender) = outstanding.sender.upgrade() else {
                return;
            };
            let service = &sender.service;
            match reply.result() {
                Ok(sample) => sender.replies.receive(service, sample, &sender.graph),
                Err(e) => {
                    let text = e.payload().to_bytes();
                    let text = String::from_utf8_lossy(&text);
                    tracing::debug!("Zenoh: no reply of service {}: {text}", service.name());
                }
            }
        });
        let is_accepted = sent.wait().is_ok();
        let mut state = lock(&state);
        state.is_accepted = is_accepted;
        let is_over = is_accepted && state.has_ended;
        let request = state.request.take_if(|_| is_over);
        drop(state);
        if let Some(request) = request {
            self.send_later(request);
        }
        is_accepted
    }

    /// Whether a server in this participant receives the requests in memory; then no server may receive the query.
    fn has_local_server(&self) -> bool {
        let writer = self.writer.upgrade();
        writer.is_some_and(|writer| writer.counters.local.load(Relaxed) > 0)
    }

    /// Schedules another attempt after a query has ended without a reply.
    fn send_later(self: &Arc<Self>, mut request: Request) {
        if self.has_local_server() {
            return;
        }
        let (number, name) = (request.attachment.sequence_number, self.service.name());
        if request.retries == 0 {
            tracing::warn!(
                "Zenoh: request {number} of service {name} has reached no server, or its reply was lost, in {} attempts",
                RETRIES + 1
            );
            return;
        }
        request.retries -= 1;
        let mut queue = lock(&self.retries);
        let due = Instant::now() + RETRY_DELAY;
        queue.bytes += request.cdr.len();
        queue.requests.push_back((due, request));
        while (queue.requests.len() > WAITING || queue.bytes > WAITING_BYTES)
            && let Some((_, lost)) = queue.requests.pop_front()
        {
            queue.bytes -= lost.cdr.len();
            let number = lost.attachment.sequence_number;
            tracing::warn!("Zenoh: request {number} of service {name} is lost: too many wait");
        }
        if queue.has_thread {
            return;
        }
        let sender = Arc::downgrade(self);
        let thread = thread::Builder::new().name("zenoh-retry".to_owned());
        queue.has_thread = thread.spawn(move || send_due(&sender)).is_ok();
    }

    /// Takes the next request for another attempt; with `None` the thread ends.
    fn next_retry(&self) -> Option<(Instant, Request)> {
        let mut queue = lock(&self.retries);
        let next = queue.requests.pop_front();
        queue.bytes -= next.as_ref().map_or(0, |(_, request)| request.cdr.len());
        queue.has_thread = next.is_some();
        next
    }
}

/// Runs the thread of a [`RetryQueue`].
fn send_due(sender: &Weak<RequestSender>) {
    while let Some((due, request)) = sender.upgrade().and_then(|s| s.next_retry()) {
        thread::sleep(due.saturating_duration_since(Instant::now()));
        if let Some(sender) = sender.upgrade() {
            let (number, name) = (request.attachment.sequence_number, sender.service.name());
            tracing::debug!("Zenoh: request {number} of service {name} ended, sent again");
            sender.send(request);
        }
    }
}

/// A query in progress. Zenoh drops it when the query has ended or was not accepted.
struct Outstanding {
    sender: Weak<RequestSender>,
    state: Arc<Mutex<QueryState>>,
}

struct QueryState {
    /// The request; `None` after a reply has arrived.
    request: Option<Request>,
    /// Whether the transport has accepted the query. If not, the caller is notified and the request is not sent again.
    is_accepted: bool,
    has_ended: bool,
}

impl Drop for Outstanding {
    fn drop(&mut self) {
        let mut state = lock(&self.state);
        state.has_ended = true;
        let is_accepted = state.is_accepted;
        let request = state.request.take_if(|_| is_accepted);
        drop(state);
        if let (Some(sender), Some(request)) = (self.sender.upgrade(), request) {
            sender.send_later(request);
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Wire of a client's requests.
pub(super) struct RequestWriter {
    gid: Gid,
    sender: Arc<RequestSender>,
    /// Sequence number of the last request.
    number: Mutex<i64>,
    _token: LivelinessToken,
}

impl RequestWriter {
    pub(super) fn new(
        session: &Session,
        (service, key, domain): (ServiceOfNode, &TopicKey, u16),
        (gid, token): (Gid, LivelinessToken),
        (writer, replies): (&Arc<Writer>, &Arc<ReplyReaders>),
        graph: &Arc<GraphCache>,
    ) -> Result<Self, TransportError> {
        let mut querier = session
            .declare_querier(key.data(domain))
            .target(QueryTarget::AllComplete)
            .consolidation(ConsolidationMode::None)
            .allowed_destination(Locality::Remote);
        if key.name.ends_with("/_action/get_result") {
            querier = querier.timeout(RESULT_TIMEOUT);
        }
        let sender = RequestSender {
            service,
            querier: querier.wait().map_err(TransportError::other)?,
            replies: Arc::clone(replies),
            graph: Arc::clone(graph),
            writer: Arc::downgrade(writer),
            retries: Mutex::default(),
        };
        Ok(Self {
            gid,
            sender: Arc::new(sender),
            number: Mutex::new(0),
            _token: token,
        })
    }
}

impl WireWriter for RequestWriter {
    fn gid(&self) -> Gid {
        self.gid
    }

    fn write(
        &self,
        cdr: Bytes,
        published: Time,
        _: Option<SampleIdentity>,
    ) -> Option<SampleIdentity> {
        let mut number = lock(&self.number);
        *number += 1;
        let attachment = Attachment {
            sequence_number: *number,
            source_time: published,
            gid: self.gid,
        };
        // Unlocked before sending, since replies may arrive in this thread.
        drop(number);
        let request = Request {
            cdr,
            attachment,
            retries: RETRIES,
        };
        let is_sent = self.sender.send(request);
        is_sent.then_some(attachment.identity())
    }

    fn wait_for_all_acked(&self, _: Duration) -> bool {
        true
    }
}
