//! Services: a server is a queryable, a call a query, and its reply the reply to the query.

use bytes::Bytes;
use std::{
    collections::{HashMap, VecDeque},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};
use zenoh::{
    Session, Wait,
    liveliness::LivelinessToken,
    query::{ConsolidationMode, Querier, Query, QueryTarget},
    sample::{Locality, Sample},
};

use super::{attachment::Attachment, keys::TopicKey};
use crate::ros::{
    Gid, NodeName, RawSample, Time,
    endpoint::Reader,
    graph_cache::GraphCache,
    sample::{ReplyPath, SampleIdentity},
    transport::{TransportError, WireWriter},
};

/// Queries that may wait for their reply; beyond it the oldest ends without one.
const WAITING: usize = 4096;

/// How long the result of an action may take, in place of the timeout of the session.
const RESULT_TIMEOUT: Duration = Duration::from_secs(365 * 24 * 3600);

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
}

impl PendingQueries {
    /// Keeps a query and returns its request, `None` if it is not one of ROS.
    pub(super) fn keep(&self, service: &ServiceOfNode, query: Query) -> Option<RawSample> {
        let attachment = Attachment::decode(&query.attachment()?.to_bytes())?;
        let cdr = Bytes::copy_from_slice(&query.payload()?.to_bytes());
        let question = (service.clone(), attachment.gid, attachment.sequence_number);
        let mut pending = self.lock();
        if pending.order.len() >= WAITING
            && let Some(oldest) = pending.order.pop_front()
        {
            pending.queries.remove(&oldest);
        }
        pending.order.push_back(question.clone());
        pending.queries.insert(question, query);
        drop(pending);
        Some(received(cdr, attachment, None))
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

/// The requests of a client.
pub(super) struct RequestWriter {
    gid: Gid,
    service: ServiceOfNode,
    querier: Querier<'static>,
    /// Number of the last request.
    number: Mutex<i64>,
    replies: Arc<ReplyReaders>,
    graph: Arc<GraphCache>,
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
        Ok(Self {
            gid,
            service,
            querier: querier.wait().map_err(TransportError::other)?,
            number: Mutex::new(0),
            replies: Arc::clone(replies),
            graph: Arc::clone(graph),
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
        let (service, replies) = (self.service.clone(), Arc::clone(&self.replies));
        let graph = Arc::clone(&self.graph);
        let query = self.querier.get().payload(cdr);
        let query = query.attachment(attachment.encode());
        let sent = query.callback(move |reply| match reply.result() {
            Ok(sample) => replies.receive(&service, sample, &graph),
            Err(e) => {
                let text = e.payload().to_bytes();
                let text = String::from_utf8_lossy(&text);
                tracing::debug!("Zenoh: no reply of service {}: {text}", service.name);
            }
        });
        sent.wait().ok()?;
        Some(SampleIdentity {
            writer: self.gid,
            sequence_number: attachment.sequence_number,
        })
    }

    fn wait_for_acknowledgments(&self, _: Duration) {}
}
