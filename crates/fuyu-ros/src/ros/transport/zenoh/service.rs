//! Service servers. A server is a Zenoh queryable, a call is a query, and the response is a reply to the query.

use bytes::Bytes;
use std::{
    collections::{HashMap, VecDeque},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};
use zenoh::{Wait, query::Query};

use super::attachment::Attachment;
use crate::ros::{
    Gid, NodeName, RawSample, Time,
    sample::{ReplyPath, SampleIdentity},
    transport::WireWriter,
};

/// Largest number of requests that wait for their reply; beyond it the oldest ends without one.
const WAITING: usize = 4096;

/// Largest total length of these requests \[bytes\]; beyond it the oldest end without a reply.
const WAITING_BYTES: usize = 16 << 20;

/// Number of requests that are remembered after their reply, so that a repeated request is not served again.
const REMEMBERED: usize = 4096;

/// Limits of the replies that are kept for these requests: length of one, and total length \[bytes\].
const LONGEST_REPLY: usize = 64 << 10;
const KEPT_REPLIES: usize = 8 << 20;

/// Largest number of queries that get the reply to one request.
const QUERIES: usize = 8;

/// A service of a node. The address of the node's name identifies the node.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct ServiceOfNode {
    node: usize,
    name: String,
}

impl ServiceOfNode {
    pub(super) fn new(node: &Arc<NodeName>, name: &str) -> Self {
        Self {
            node: Arc::as_ptr(node) as usize,
            name: name.to_owned(),
        }
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }
}

/// Requests to the services of a session.
#[derive(Default)]
pub(super) struct PendingQueries {
    inner: Mutex<Requests>,
}

/// Key of a request: service, GID of the client, sequence number.
type RequestKey = (ServiceOfNode, Gid, i64);

#[derive(Default)]
struct Requests {
    requests: HashMap<RequestKey, Request>,
    /// Requests without a reply, in order of arrival.
    waiting: VecDeque<RequestKey>,
    /// Total length of these requests \[bytes\].
    waiting_bytes: usize,
    /// Requests with a reply, in order of the replies.
    answered: VecDeque<RequestKey>,
    /// Total length of the kept replies \[bytes\].
    kept: usize,
}

struct Request {
    /// Time of publication. It distinguishes requests of clients that give all requests the same number.
    time: Time,
    /// Length of the request \[bytes\].
    length: usize,
    state: RequestState,
}

enum RequestState {
    /// Waiting for the reply. The same request may arrive in several queries: over two routes, or again after the first
    /// query has ended.
    Waiting(Vec<Query>),
    /// Replied, with the reply unless it is too long to be kept.
    Answered(Option<Bytes>),
}

/// Classification of a query that arrived at a server.
pub(super) enum Received {
    /// New request, to be served.
    Request(RawSample),
    /// Duplicate of a request that is being served, or whose reply was not kept.
    Duplicate,
    /// Duplicate of a request that has been served, with its reply.
    Answered(Query, Bytes, SampleIdentity),
    /// Not a request in the format of rmw_zenoh.
    Invalid,
}

impl PendingQueries {
    /// Classifies a query, and keeps it until its reply.
    pub(super) fn keep(&self, service: &ServiceOfNode, query: Query) -> Received {
        let attachment = query.attachment().map(|a| a.to_bytes());
        let attachment = attachment.and_then(|a| Attachment::decode(&a));
        let (Some(attachment), Some(payload)) = (attachment, query.payload()) else {
            return Received::Invalid;
        };
        let cdr = Bytes::copy_from_slice(&payload.to_bytes());
        let question = (service.clone(), attachment.gid, attachment.sequence_number);
        let mut guard = self.lock();
        let known = guard.requests.get_mut(&question);
        if let Some(known) = known.filter(|request| request.time == attachment.source_time) {
            return match &mut known.state {
                RequestState::Waiting(queries) => {
                    if queries.len() < QUERIES {
                        queries.push(query);
                    }
                    Received::Duplicate
                }
                RequestState::Answered(None) => Received::Duplicate,
                RequestState::Answered(Some(reply)) => {
                    let reply = reply.clone();
                    drop(guard);
                    Received::Answered(query, reply, attachment.identity())
                }
            };
        }
        let request = Request {
            time: attachment.source_time,
            length: cdr.len(),
            state: RequestState::Waiting(vec![query]),
        };
        let mut ended = vec![guard.forget_one(&question)];
        // A single request that exceeds the limit is served if no other waits.
        while (guard.waiting.len() >= WAITING || guard.waiting_bytes + cdr.len() > WAITING_BYTES)
            && let Some(oldest) = guard.waiting.front().cloned()
        {
            ended.push(guard.forget_one(&oldest));
        }
        guard.waiting.push_back(question.clone());
        guard.waiting_bytes += request.length;
        guard.requests.insert(question, request);
        // Dropping a query ends it, which sends a message; so this happens without the lock.
        drop(guard);
        drop(ended);
        Received::Request(received(cdr, attachment, None))
    }

    /// Takes the queries of a request, and keeps its reply.
    fn answer(
        &self,
        service: &ServiceOfNode,
        question: SampleIdentity,
        reply: &Bytes,
    ) -> Vec<Query> {
        let key = (service.clone(), question.writer, question.sequence_number);
        let mut guard = self.lock();
        let Some(request) = guard.requests.get_mut(&key) else {
            return Vec::new();
        };
        let RequestState::Waiting(queries) = &mut request.state else {
            return Vec::new();
        };
        let queries = std::mem::take(queries);
        let kept = (reply.len() <= LONGEST_REPLY).then(|| reply.clone());
        let length = kept.as_ref().map_or(0, Bytes::len);
        request.state = RequestState::Answered(kept);
        let asked = request.length;
        guard.kept += length;
        guard.waiting_bytes -= asked;
        guard.waiting.retain(|other| *other != key);
        guard.answered.push_back(key);
        while (guard.answered.len() > REMEMBERED || guard.kept > KEPT_REPLIES)
            && let Some(oldest) = guard.answered.front().cloned()
        {
            guard.forget_one(&oldest);
        }
        queries
    }

    /// Ends the queries of a removed service, and removes its requests.
    pub(super) fn forget(&self, service: &ServiceOfNode) {
        let mut guard = self.lock();
        let of_service = guard.requests.keys().filter(|(other, ..)| other == service);
        let of_service: Vec<_> = of_service.cloned().collect();
        let ended: Vec<_> = (of_service.iter())
            .map(|question| guard.forget_one(question))
            .collect();
        drop(guard);
        drop(ended);
    }

    fn lock(&self) -> MutexGuard<'_, Requests> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Requests {
    /// Removes a request, if known. Its queries end when the result is dropped.
    fn forget_one(&mut self, question: &RequestKey) -> Option<Request> {
        let request = self.requests.remove(question)?;
        let order = match &request.state {
            RequestState::Waiting(_) => {
                self.waiting_bytes -= request.length;
                &mut self.waiting
            }
            RequestState::Answered(reply) => {
                self.kept -= reply.as_ref().map_or(0, Bytes::len);
                &mut self.answered
            }
        };
        // Usually the oldest.
        let at = order.iter().position(|other| other == question);
        at.and_then(|at| order.remove(at));
        Some(request)
    }
}

/// Replies to a query.
pub(super) fn reply(
    query: &Query,
    key: &str,
    cdr: Bytes,
    request: SampleIdentity,
    now: Time,
) -> bool {
    let attachment = Attachment {
        sequence_number: request.sequence_number,
        source_time: now,
        gid: request.writer,
    };
    let reply = query.reply(key, cdr).attachment(attachment.encode());
    reply.wait().is_ok()
}

/// Creates a sample. `related` is the request that it replies to.
pub(super) fn received(
    cdr: Bytes,
    attachment: Attachment,
    related: Option<SampleIdentity>,
) -> RawSample {
    RawSample {
        cdr,
        source_time: Some(attachment.source_time),
        received_time: Time::wall(),
        publisher: attachment.gid,
        sequence_number: attachment.sequence_number,
        related,
        identity: attachment.identity(),
        reply_path: ReplyPath::Wire,
    }
}

/// Wire of a service server's replies.
pub(super) struct ReplyWriter {
    pub(super) gid: Gid,
    pub(super) service: ServiceOfNode,
    /// Key expression of the service.
    pub(super) key: String,
    pub(super) pending: Arc<PendingQueries>,
}

impl WireWriter for ReplyWriter {
    fn gid(&self) -> Gid {
        self.gid
    }

    fn write(
        &self,
        cdr: Bytes,
        published: Time,
        related: Option<SampleIdentity>,
    ) -> Option<SampleIdentity> {
        let request = related?;
        let queries = self.pending.answer(&self.service, request, &cdr);
        let mut is_sent = false;
        for query in &queries {
            is_sent |= reply(query, &self.key, cdr.clone(), request, published);
        }
        is_sent.then_some(request)
    }

    fn wait_for_all_acked(&self, _: Duration) -> bool {
        true
    }
}
