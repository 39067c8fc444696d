//! Selection of the transport by `RMW_IMPLEMENTATION`, as in ROS.

use std::sync::Arc;

#[cfg(feature = "zenoh")]
use super::zenoh::{ZenohConfig, ZenohTransport};
use super::{
    Transport,
    dds::{DdsTransport, StaticPeers},
};
use crate::ros::{Domain, context::DomainError};

const VARIABLE: &str = "RMW_IMPLEMENTATION";
const ZENOH: &str = "rmw_zenoh_cpp";

/// Transport of messages between processes.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Middleware(Kind);

#[derive(Debug, Clone)]
enum Kind {
    Dds(StaticPeers),
    #[cfg(feature = "zenoh")]
    Zenoh(Box<ZenohConfig>),
}

impl Default for Middleware {
    /// DDS without static peers.
    fn default() -> Self {
        Self(Kind::Dds(StaticPeers::default()))
    }
}

impl Middleware {
    /// Reads `RMW_IMPLEMENTATION` and the variables of that implementation. All DDS implementations are compatible, so
    /// the name of any of them selects the DDS of this crate.
    ///
    /// # Errors
    /// [`DomainError`] names the variable, its value and what would be right.
    pub fn from_env() -> Result<Self, DomainError> {
        let name = std::env::var(VARIABLE).unwrap_or_default();
        match name.trim() {
            ZENOH => Self::zenoh_from_env(),
            other if other.contains("zenoh") => {
                let expected = "expected rmw_zenoh_cpp for Zenoh";
                Err(DomainError::new(VARIABLE, other, expected))
            }
            _ => Ok(Self(Kind::Dds(StaticPeers::from_env()?))),
        }
    }

    #[cfg(feature = "zenoh")]
    fn zenoh_from_env() -> Result<Self, DomainError> {
        Ok(Self::zenoh(ZenohConfig::from_env()?))
    }

    #[cfg(not(feature = "zenoh"))]
    fn zenoh_from_env() -> Result<Self, DomainError> {
        let expected =
            "this program was built without Zenoh; build it with the feature zenoh, or use DDS";
        Err(DomainError::new(VARIABLE, ZENOH, expected))
    }

    /// Zenoh, compatible with `rmw_zenoh_cpp`.
    #[cfg(feature = "zenoh")]
    pub fn zenoh(config: ZenohConfig) -> Self {
        Self(Kind::Zenoh(Box::new(config)))
    }

    /// Creates the transport of a participant in this domain.
    pub(in crate::ros) fn transport(&self, domain: Domain) -> Arc<dyn Transport> {
        match &self.0 {
            Kind::Dds(peers) => Arc::new(DdsTransport::new(domain, peers.clone())),
            #[cfg(feature = "zenoh")]
            Kind::Zenoh(config) => Arc::new(ZenohTransport::new(domain, (**config).clone())),
        }
    }
}
