//! Services: a request topic, a reply topic, and the identity that binds an answer to its question.

use rustdds::{SequenceNumber, rpc::SampleIdentity};
use std::sync::Arc;

use super::{
    NodeError, Qos, RawSample,
    endpoint::{Counters, EndpointSpec, Reader, Writer},
    node::Core,
};
use crate::msg::{Service, cdr};

/// Answers calls of a service until it is dropped.
pub struct ServiceServer {
    core: Arc<Core>,
    reader: Arc<Reader>,
    writer: Arc<Writer>,
}

impl ServiceServer {
    /// `handler` runs on the node's receiving thread: it should be quick.
    pub(super) fn new<S: Service>(
        core: &Arc<Core>,
        full_name: &str,
        handler: impl Fn(S::Request) -> S::Response + Send + Sync + 'static,
    ) -> Result<Self, NodeError> {
        let spec = |prefix: &str, suffix: &str, part: &str| EndpointSpec {
            name: full_name.to_owned(),
            dds_topic: format!("{prefix}{full_name}{suffix}"),
            dds_type: format!("{}::srv::dds_::{}_{part}_", S::PACKAGE, S::NAME),
            qos: Qos::SERVICES,
            internal: true,
        };
        let writer = core.add_writer(spec("rr", "Reply", "Response"))?;
        let replies = Arc::clone(&writer);
        let weak = Arc::downgrade(core);
        let sink = move |sample: RawSample, _: &Counters| {
            let Ok(request) = cdr::decode::<S::Request>(&sample.cdr) else {
                return false;
            };
            let response = cdr::encode(&handler(request));
            if let Some(core) = weak.upgrade() {
                let asked = Some(question(&sample));
                core.outbox.push(&replies, response.into(), asked);
            }
            true
        };
        let reader = core.add_reader(spec("rq", "Request", "Request"), Box::new(sink))?;
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
    fn drop(&mut self) {
        self.core.remove_reader(&self.reader);
        self.core.remove_writer(&self.writer);
    }
}

/// The request that a reply must name. Fast DDS names its reply reader and leaves the number unknown;
/// then the number of the sample counts. Without any name the sample is its own.
fn question(sample: &RawSample) -> SampleIdentity {
    let mut question = sample.related.unwrap_or(sample.identity);
    if question.sequence_number == SequenceNumber::UNKNOWN {
        question.sequence_number = sample.identity.sequence_number;
    }
    question
}
