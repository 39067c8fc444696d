//! Transports, which carry messages between participants.
//!
//! A [`Transport`] opens a [`Session`], and another one if a session has to be replaced. A session gives every
//! publisher a [`WireWriter`], passes received samples to the subscriptions ([`Reader::receive`]), counts the matched
//! peers of every endpoint in its [`Counters`](super::endpoint::Counters), and reports other nodes to the
//! [`GraphCache`]. All higher layers (queues, services, parameters, actions, delivery in memory) are independent of the
//! transport.

mod dds;
mod error;
mod middleware;
mod sequence_numbers;
#[cfg(feature = "zenoh")]
mod zenoh;

use bytes::Bytes;
use std::{
    sync::{Arc, Mutex},
    time::Duration,
};

use super::{
    Gid, Qos, Time,
    endpoint::{Endpoints, Reader, Writer},
    graph_cache::GraphCache,
    sample::SampleIdentity,
};

pub(super) use error::{AbandonedSession, TransportError};
use sequence_numbers::SequenceNumbers;

pub use middleware::Middleware;
#[cfg(feature = "zenoh")]
pub use zenoh::{RouterLog, ZenohConfig, ZenohRouter};

/// Data that a participant shares with its transport.
#[derive(Clone, Default)]
pub(super) struct Shared {
    /// Nodes and endpoints of the participant.
    pub(super) endpoints: Arc<Mutex<Endpoints>>,
    /// The nodes of other participants, which the transport discovers.
    pub(super) graph: Arc<GraphCache>,
}

/// Connects a participant to others. It persists when its session is replaced.
pub(super) trait Transport: Send + Sync {
    /// Blocks until new endpoints may be created.
    fn settle(&self);

    /// Opens a session with all present endpoints of the participant. Its threads inherit the caller's signal mask.
    fn open(&self, shared: &Shared) -> Result<Box<dyn Session>, TransportError>;

    /// Whether a session must be replaced after the process was suspended or the wall clock was set back.
    fn breaks_when_interrupted(&self) -> bool;
}

/// A connected participant with the endpoints of its nodes. Dropping it removes the participant from the graph.
pub(super) trait Session: Send {
    /// Interface for queries that must not wait for this session.
    fn discovery(&self) -> Arc<dyn Discovery>;

    /// Connects a publisher: calls [`Writer::attach`].
    fn add_writer(&mut self, writer: &Arc<Writer>) -> Result<(), TransportError>;

    /// Connects a subscription, which receives messages from then on.
    fn add_reader(&mut self, reader: &Arc<Reader>) -> Result<(), TransportError>;

    /// Disconnects a publisher that is no longer among the endpoints. Returns its wire, which the caller drops without
    /// holding locks.
    fn remove_writer(&mut self, writer: &Writer) -> Option<Arc<dyn WireWriter>>;

    /// Disconnects a subscription that is no longer among the endpoints.
    fn remove_reader(&mut self, reader: &Arc<Reader>);

    /// Announces the present nodes, after a short delay.
    fn announce(&mut self);
}

/// Transport side of a publisher.
pub(super) trait WireWriter: Send + Sync {
    /// GID of the publisher, part of the identity of its samples.
    fn gid(&self) -> Gid;

    /// Sends a message to other participants and returns its identity, or `None` if the transport refuses it.
    /// `related` is the request that a reply responds to, or the reader that expects the reply to a request. May
    /// block for a few milliseconds.
    fn write(
        &self,
        cdr: Bytes,
        published: Time,
        related: Option<SampleIdentity>,
    ) -> Option<SampleIdentity>;

    /// Waits until living reliable subscribers have acknowledged all samples, at most `timeout`. Returns whether they
    /// have.
    fn wait_for_all_acked(&self, timeout: Duration) -> bool;

    /// How long the writer must persist after its last sample, so that subscribers take the sample before the writer
    /// leaves.
    fn linger(&self) -> Duration {
        Duration::ZERO
    }
}

/// Discovery of a session.
pub(super) trait Discovery: Send + Sync {
    /// The publishers of other participants.
    fn publishers(&self) -> Vec<RemotePublisher>;

    /// Description of a lost peer whose return requires a new session, for the log; reported once per loss.
    fn take_returned_peer(&self) -> Option<String>;
}

/// A publisher of another participant.
pub(super) struct RemotePublisher {
    /// `rt/joint_states`
    pub(super) dds_topic: String,
    /// `sensor_msgs::msg::dds_::JointState_`
    pub(super) dds_type: String,
    /// Offered quality of service.
    pub(super) qos: Qos,
    /// Type hash that the publisher states, if any.
    pub(super) type_hash: Option<String>,
    pub(super) gid: Gid,
}
