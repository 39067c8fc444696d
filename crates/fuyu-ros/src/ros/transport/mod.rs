//! Transports carry messages between participants.
//!
//! A [`Transport`] opens [`Session`]s, one after the other if need be. A session gives every publisher a
//! [`WireWriter`], passes received samples to the subscriptions ([`Reader::receive`]), counts the matched peers of every
//! endpoint in its [`Counters`](super::endpoint::Counters), and reports other nodes to the [`GraphCache`].
//! Everything above (queues, services, parameters, actions, delivery in memory) is the same for all transports.

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
    /// Its nodes and endpoints.
    pub(super) endpoints: Arc<Mutex<Endpoints>>,
    /// The nodes of other participants, which the transport discovers.
    pub(super) graph: Arc<GraphCache>,
}

/// Connects a participant with others. It outlives its sessions.
pub(super) trait Transport: Send + Sync {
    /// Blocks until endpoints may be created.
    fn settle(&self);

    /// Opens a session with all endpoints that the participant has. Threads inherit the signal mask of the caller.
    fn open(&self, shared: &Shared) -> Result<Box<dyn Session>, TransportError>;

    /// Whether a session must be replaced after its process was stopped for a while, or the wall clock was set back.
    fn breaks_when_interrupted(&self) -> bool;
}

/// A connected participant with the endpoints of its nodes. It leaves the graph when it is dropped.
pub(super) trait Session: Send {
    /// Answers questions that must not wait for this session.
    fn discovery(&self) -> Arc<dyn Discovery>;

    /// Connects a publisher: calls [`Writer::attach`].
    fn add_writer(&mut self, writer: &Arc<Writer>) -> Result<(), TransportError>;

    /// Connects a subscription: from now on it receives.
    fn add_reader(&mut self, reader: &Arc<Reader>) -> Result<(), TransportError>;

    /// Disconnects a publisher that is no longer among the endpoints. Its wire is for the caller to drop, without
    /// locks.
    fn remove_writer(&mut self, writer: &Writer) -> Option<Arc<dyn WireWriter>>;

    /// Disconnects a subscription that is no longer among the endpoints.
    fn remove_reader(&mut self, reader: &Arc<Reader>);

    /// Announces the present nodes, soon.
    fn announce(&mut self);
}

/// The wire of a publisher.
pub(super) trait WireWriter: Send + Sync {
    /// Identity of its samples.
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

    /// Waits until living reliable subscribers have all written samples, at most `timeout`. Whether they have.
    fn wait_for_all_acked(&self, timeout: Duration) -> bool;

    /// How long it stays after its last sample, so that subscribers take that before they forget the writer.
    fn linger(&self) -> Duration {
        Duration::ZERO
    }
}

/// Discovery of a session.
pub(super) trait Discovery: Send + Sync {
    /// The publishers of other participants.
    fn publishers(&self) -> Vec<RemotePublisher>;

    /// Which peer, lost before, makes a new session necessary since it has returned; for the log, once per loss.
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
    /// Hash of its definition of the type, if it states one.
    pub(super) type_hash: Option<String>,
    pub(super) gid: Gid,
}
