//! Service servers: a server is a queryable, a call a query, and its reply the reply to the query.

use bytes::Bytes;
use std::{
    collections::{HashMap, HashSet, VecDeque},
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

/// Queries that may wait for their reply; beyond it the oldest ends without one.
const WAITING: usize = 4096;

/// Requests that are remembered, so that one that arrives twice is served once.
const REMEMBERED: usize = 4096;

/// A service of a node. Nodes are told apart by the address of their names.
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

/// Queries that wait for their replies.
#[derive(Default)]
pub(super) struct PendingQueries {
    inner: Mutex<Pending>,
}

/// A service, and the request.
type Question = (ServiceOfNode, Gid, i64);

#[derive(Default)]
struct Pending {
    queries: HashMap<Question, Query>,
    order: VecDeque<Question>,
    seen: SeenRequests,
}

/// The last requests, each with its time: a client that numbers all its requests alike does send more than one.
#[derive(Default)]
struct SeenRequests {
    requests: HashSet<(Question, Time)>,
    order: VecDeque<(Question, Time)>,
}

impl SeenRequests {
    /// Whether this is the first time.
    fn is_new(&mut self, request: (Question, Time)) -> bool {
        if !self.requests.insert(request.clone()) {
            return false;
        }
        self.order.push_back(request);
        if self.order.len() > REMEMBERED
            && let Some(oldest) = self.order.pop_front()
        {
            self.requests.remove(&oldest);
        }
        true
    }
}

/// A query that arrived at a server.
pub(super) enum Received {
    /// To be served.
    Request(RawSample),
    /// Received before: a client sends a request again whose query ended without a reply.
    Duplicate,
    /// Not a request of rmw_zenoh.
    Invalid,
}

impl PendingQueries {
    /// Keeps a query until its reply.
    pub(super) fn keep(&self, service: &ServiceOfNode, query: Query) -> Received {
        let attachment = query.attachment().map(|a| a.to_bytes());
        let attachment = attachment.and_then(|a| Attachment::decode(&a));
        let (Some(attachment), Some(payload)) = (attachment, query.payload()) else {
            return Received::Invalid;
        };
        let cdr = Bytes::copy_from_slice(&payload.to_bytes());
        let question = (service.clone(), attachment.gid, attachment.sequence_number);
        let mut pending = self.lock();
        if !(pending.seen).is_new((question.clone(), attachment.source_time)) {
            // The earlier query has ended, so that the reply goes to this one.
            if let Some(waiting) = pending.queries.get_mut(&question) {
                *waiting = query;
            }
            return Received::Duplicate;
        }
        if pending.order.len() >= WAITING
            && let Some(oldest) = pending.order.pop_front()
        {
            pending.queries.remove(&oldest);
        }
        pending.order.push_back(question.clone());
        pending.queries.insert(question, query);
        drop(pending);
        Received::Request(received(cdr, attachment, None))
    }

    fn take(&self, service: &ServiceOfNode, question: SampleIdentity) -> Option<Query> {
        let key = (service.clone(), question.writer, question.sequence_number);
        let mut pending = self.lock();
        let query = pending.queries.remove(&key)?;
        pending.order.retain(|other| *other != key);
        Some(query)
    }

    /// Ends the queries of a service that is no longer there.
    pub(super) fn forget(&self, service: &ServiceOfNode) {
        let mut pending = self.lock();
        pending.queries.retain(|(other, ..), _| other != service);
        pending.order.retain(|(other, ..)| other != service);
    }

    fn lock(&self) -> MutexGuard<'_, Pending> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A sample as it arrived. `related` is the request that it replies to.
pub(super) fn received(
    cdr: Bytes,
    attachment: Attachment,
    related: Option<SampleIdentity>,
) -> RawSample {
    let identity = SampleIdentity {
        writer: attachment.gid,
        sequence_number: attachment.sequence_number,
    };
    RawSample {
        cdr,
        source_time: Some(attachment.source_time),
        received_time: Time::wall(),
        publisher: attachment.gid,
        sequence_number: attachment.sequence_number,
        related,
        identity,
        reply_path: ReplyPath::Wire,
    }
}

/// The replies of a service server.
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
        let question = related?;
        let query = self.pending.take(&self.service, question)?;
        let attachment = Attachment {
            sequence_number: question.sequence_number,
            source_time: published,
            gid: question.writer,
        };
        let reply = query.reply(&self.key, cdr);
        let sent = reply.attachment(attachment.encode()).wait();
        sent.ok()?;
        Some(question)
    }

    fn wait_for_acknowledgments(&self, _: Duration) {}
}
