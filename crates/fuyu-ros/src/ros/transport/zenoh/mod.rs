//! Zenoh transport, wire-compatible with `rmw_zenoh_cpp` of ROS 2 Jazzy and Kilted.
//!
//! The formats follow its [design document](https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md): key
//! expressions ([`keys`]), liveliness tokens from which every participant builds the graph ([`entity`]), attachments
//! ([`attachment`]). A participant is a Zenoh session. Zenoh restores interrupted connections itself, so a session is
//! never replaced.

mod attachment;
mod config;
mod entity;
mod graph;
mod keys;
mod qos;
mod reader;
mod request;
mod router;
mod router_check;
mod router_log;
mod service;
mod session;
mod writer;

use super::{Session, Shared, Transport, TransportError};
use crate::ros::Domain;
use session::ZenohSession;

pub use config::ZenohConfig;
pub use router::ZenohRouter;
pub use router_log::RouterLog;

/// Opens Zenoh sessions.
pub(super) struct ZenohTransport {
    domain: Domain,
    config: ZenohConfig,
}

impl ZenohTransport {
    pub(super) fn new(domain: Domain, config: ZenohConfig) -> Self {
        Self { domain, config }
    }
}

impl Transport for ZenohTransport {
    fn settle(&self) {}

    fn open(&self, shared: &Shared) -> Result<Box<dyn Session>, TransportError> {
        let session = ZenohSession::open(self.domain, &self.config, shared)?;
        Ok(Box::new(session))
    }

    fn breaks_when_interrupted(&self) -> bool {
        false
    }
}
