//! DDS transport, based on rustdds. Defects of rustdds and their workarounds: docs/upstream.md.

mod announcer;
mod dds_discovery;
mod discovery_settling;
mod domain_participant;
mod first_samples;
mod lost_peers;
mod new_writers;
mod participant_watchdog;
mod peers;
mod qos;
mod raw_endpoints;
mod receiver;
mod ros_discovery_info;
mod rtps_sender;
mod session;
mod static_peers;
mod type_hash_check;
mod writer;

use std::sync::Arc;

use super::{Session, Shared, Transport, TransportError};
use crate::ros::Domain;
use discovery_settling::DiscoverySettling;
use session::DdsSession;

pub(super) use static_peers::StaticPeers;

/// Opens sessions, each with a participant of a DDS domain.
pub(super) struct DdsTransport {
    domain: Domain,
    static_peers: StaticPeers,
    settling: Arc<DiscoverySettling>,
}

impl DdsTransport {
    pub(super) fn new(domain: Domain, static_peers: StaticPeers) -> Self {
        Self {
            domain,
            static_peers,
            settling: Arc::default(),
        }
    }
}

impl Transport for DdsTransport {
    fn settle(&self) {
        self.settling.wait();
    }

    fn open(&self, shared: &Shared) -> Result<Box<dyn Session>, TransportError> {
        let place = (self.domain, &self.static_peers);
        let session = DdsSession::open(place, shared, &self.settling)?;
        Ok(Box::new(session))
    }

    fn breaks_when_interrupted(&self) -> bool {
        true
    }
}
