//! Service clients: a request is a query, which is sent again if it ends without a reply.
//!
//! While two peers that a router has introduced connect to each other, routes change, and a query sent at that moment
//! ends without having reached the server, although the graph shows the server: docs/upstream.md, "Zenoh".

use bytes::Bytes;
use std::{
    collections::VecDeque,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError, Weak,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
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
    endpoint::Reader,
    graph_cache::GraphCache,
    sample::SampleIdentity,
    transport::{TransportError, WireWriter},
};

/// How long the result of an action may take, in place of the timeout of the session.
const RESULT_TIMEOUT: Duration = Duration::from_secs(365 * 24 * 3600);

/// How often a request is sent again, and how long after its query ended. Few, since a server of another implementation
/// may serve each of them.
const RETRIES: u8 = 5;
const RETRY_DELAY: Duration = Duration::from_millis(100);

/// Requests that wait to be sent again; beyond it the oldest is lost.
const WAITING: usize = 1024;

/// The subscriptions to replies of a session.
#[derive(Default)]
pub(super) struct ReplyReaders {
    readers: Mutex<Vec<(ServiceOfNode, Arc<Reader>)>>,
}

impl ReplyReaders {
    pub(super) fn add(&self, reader: &Arc<Reader>) {
        let service = ServiceOfNode::new(&reader.node, &reader.spec.name);
        self.lock().push((service, Arc::clone(reader)));
    }

    pub(super) fn remove(&self, reader: &Arc<Reader>) {
        self.lock().retain(|(_, r)| !Arc::ptr_eq(r, reader));
    }

    /// Passes the reply to a request of a client on.
    fn receive(&self, service: &ServiceOfNode, reply: &Sample, graph: &GraphCache) {
        let attachment = reply.attachment().map(|a| a.to_bytes());
        let attachment = attachment.and_then(|a| Attachment::decode(&a));
        let readers = self.lock().clone();
        for (_, reader) in readers.iter().filter(|(other, _)| other == service) {
            let Some(attachment) = attachment else {
                reader.report_invalid(graph, None, "its attachment is not one of rmw_zenoh");
                continue;
            };
            let request = SampleIdentity {
                writer: attachment.gid,
                sequence_number: attachment.sequence_number,
            };
            let cdr = Bytes::copy_from_slice(&reply.payload().to_bytes());
            reader.receive_remote(received(cdr, attachment, Some(request)), graph);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Vec<(ServiceOfNode, Arc<Reader>)>> {
        self.readers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A request that has not been replied to.
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
    retries: Mutex<RetryQueue>,
}

/// Requests to be sent again, in order of time. A thread sends them; it ends when none is left.
#[derive(Default)]
struct RetryQueue {
    requests: VecDeque<(Instant, Request)>,
    has_thread: bool,
}

impl RequestSender {
    /// Returns whether the transport accepted the request.
    fn send(self: &Arc<Self>, request: Request) -> bool {
        let query = self.querier.get().payload(request.cdr.clone());
        let query = query.attachment(request.attachment.encode());
        let outstanding = Outstanding {
            sender: Arc::downgrade(self),
            request: Some(request),
            is_answered: AtomicBool::new(false),
        };
        let sent = query.callback(move |reply| {
            outstanding.is_answered.store(true, Relaxed);
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
        sent.wait().is_ok()
    }

    fn send_later(self: &Arc<Self>, request: Request) {
        let mut queue = self.retries.lock().unwrap_or_else(PoisonError::into_inner);
        let due = Instant::now() + RETRY_DELAY;
        if queue.requests.len() >= WAITING {
            queue.requests.pop_front();
        }
        queue.requests.push_back((due, request));
        if queue.has_thread {
            return;
        }
        let sender = Arc::downgrade(self);
        let thread = thread::Builder::new().name("zenoh-retry".to_owned());
        queue.has_thread = thread.spawn(move || send_due(&sender)).is_ok();
    }

    /// The next request to be sent again; `None` ends the thread.
    fn next_retry(&self) -> Option<(Instant, Request)> {
        let mut queue = self.retries.lock().unwrap_or_else(PoisonError::into_inner);
        let next = queue.requests.pop_front();
        queue.has_thread = next.is_some();
        next
    }
}

/// The thread of a [`RetryQueue`].
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

/// A query. Zenoh drops it when the query has ended.
struct Outstanding {
    sender: Weak<RequestSender>,
    /// `None` once dropped.
    request: Option<Request>,
    is_answered: AtomicBool,
}

impl Drop for Outstanding {
    fn drop(&mut self) {
        let Some(mut request) = self.request.take() else {
            return;
        };
        if *self.is_answered.get_mut() || request.retries == 0 {
            return;
        }
        if let Some(sender) = self.sender.upgrade() {
            request.retries -= 1;
            sender.send_later(request);
        }
    }
}

/// The requests of a client.
pub(super) struct RequestWriter {
    gid: Gid,
    sender: Arc<RequestSender>,
    /// Number of the last request.
    number: Mutex<i64>,
    _token: LivelinessToken,
}

impl RequestWriter {
    pub(super) fn new(
        session: &Session,
        (service, key, domain): (ServiceOfNode, &TopicKey, u16),
        (gid, token): (Gid, LivelinessToken),
        replies: &Arc<ReplyReaders>,
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
        let mut number = self.number.lock().unwrap_or_else(PoisonError::into_inner);
        *number += 1;
        let attachment = Attachment {
            sequence_number: *number,
            source_time: published,
            gid: self.gid,
        };
        // Replies may arrive in this thread.
        drop(number);
        let request = Request {
            cdr,
            attachment,
            retries: RETRIES,
        };
        self.sender.send(request).then_some(SampleIdentity {
            writer: self.gid,
            sequence_number: attachment.sequence_number,
        })
    }

    fn wait_for_acknowledgments(&self, _: Duration) {}
}
