//! Subscriptions to topics, and service servers.

use bytes::Bytes;
use std::{
    sync::{Arc, Mutex, PoisonError, atomic::Ordering::Relaxed},
    time::Duration,
};
use zenoh::{
    Session, Wait,
    liveliness::LivelinessToken,
    query::Queryable,
    sample::{Locality, Sample},
};
use zenoh_ext::{
    AdvancedSubscriber, AdvancedSubscriberBuilderExt as _, HistoryConfig, RecoveryConfig,
};

use super::{
    attachment::Attachment,
    service::{self, PendingQueries, Received, ServiceOfNode},
};
use crate::ros::{
    Time,
    endpoint::Reader,
    graph_cache::GraphCache,
    qos::{Durability, History},
    transport::{SequenceNumbers, TransportError},
};

/// Longest time in which the cache of a publisher may respond.
const HISTORY_TIMEOUT: Duration = Duration::from_secs(600);

/// Receiver of a subscription or service server; ends when dropped.
pub(super) enum ZenohReader {
    Topic {
        _subscriber: AdvancedSubscriber<()>,
        _token: LivelinessToken,
    },
    Service {
        _queryable: Queryable<()>,
        _token: LivelinessToken,
    },
    /// Subscription to replies. Nothing to declare: replies arrive through the queries of the client.
    Replies,
}

impl ZenohReader {
    /// Subscribes to `key`, with the options of rmw_zenoh.
    pub(super) fn topic(
        session: &Session,
        key: String,
        (reader, graph): (&Arc<Reader>, &Arc<GraphCache>),
        token: LivelinessToken,
    ) -> Result<Self, TransportError> {
        let qos = reader.spec.qos;
        let numbers = Mutex::new(SequenceNumbers::default());
        let (receiver, graph) = (Arc::clone(reader), Arc::clone(graph));
        let mut builder = session
            .declare_subscriber(key)
            .callback(move |sample| receive(&receiver, &graph, &numbers, &sample))
            // Publishers of this session deliver in memory.
            .allowed_origin(Locality::Remote)
            .advanced();
        if qos.durability == Durability::TransientLocal {
            let mut history = HistoryConfig::default().detect_late_publishers();
            if qos.history == History::KeepLast {
                history = history.max_samples(qos.depth.max(1));
            }
            builder = builder
                .subscriber_detection()
                .query_timeout(HISTORY_TIMEOUT)
                .history(history);
            if qos.is_reliable() {
                builder = builder.recovery(RecoveryConfig::default().heartbeat());
            }
        }
        Ok(Self::Topic {
            _subscriber: builder.wait().map_err(TransportError::other)?,
            _token: token,
        })
    }

    /// Serves a service at `key`.
    pub(super) fn service(
        session: &Session,
        key: String,
        (reader, graph): (&Arc<Reader>, &Arc<GraphCache>),
        pending: &Arc<PendingQueries>,
        token: LivelinessToken,
    ) -> Result<Self, TransportError> {
        let service = ServiceOfNode::new(&reader.node, &reader.spec.name);
        let (receiver, graph) = (Arc::clone(reader), Arc::clone(graph));
        let pending = Arc::clone(pending);
        let queryable = session
            .declare_queryable(key.clone())
            .complete(true)
            .allowed_origin(Locality::Remote)
            .callback(move |query| match pending.keep(&service, query) {
                Received::Request(request) => receiver.receive_remote(request, &graph),
                Received::Duplicate => {}
                Received::Answered(query, cdr, request) => {
                    service::reply(&query, &key, cdr, request, Time::wall());
                }
                Received::Invalid => {
                    receiver.report_invalid(&graph, None, "it is not a request of rmw_zenoh");
                }
            });
        Ok(Self::Service {
            _queryable: queryable.wait().map_err(TransportError::other)?,
            _token: token,
        })
    }
}

fn receive(
    reader: &Arc<Reader>,
    graph: &GraphCache,
    numbers: &Mutex<SequenceNumbers>,
    sample: &Sample,
) {
    let attachment = sample.attachment().map(|a| a.to_bytes());
    let Some(attachment) = attachment.and_then(|a| Attachment::decode(&a)) else {
        reader.counters.failed.fetch_add(1, Relaxed);
        reader.report_invalid(graph, None, "its attachment is not one of rmw_zenoh");
        return;
    };
    let missing = {
        let mut numbers = numbers.lock().unwrap_or_else(PoisonError::into_inner);
        numbers.missing_before(attachment.gid, attachment.sequence_number)
    };
    reader.counters.missing.fetch_add(missing, Relaxed);
    let cdr = Bytes::copy_from_slice(&sample.payload().to_bytes());
    reader.receive_remote(service::received(cdr, attachment, None), graph);
}
