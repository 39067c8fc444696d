//! Choice of the transport, as in ROS: `RMW_IMPLEMENTATION`.

use std::sync::Arc;

use super::{
    Transport,
    dds::{DdsTransport, StaticPeers},
};
use crate::ros::{Domain, context::DomainError};

/// What carries messages between processes.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Middleware(Kind);

#[derive(Debug, Clone, PartialEq, Eq)]
enum Kind {
    Dds(StaticPeers),
}

impl Default for Middleware {
    /// DDS without static peers.
    fn default() -> Self {
        Self(Kind::Dds(StaticPeers::default()))
    }
}

impl Middleware {
    /// Reads `RMW_IMPLEMENTATION` and the variables of that implementation. All implementations of DDS are compatible, so
    /// each of their names means the one of this crate.
    ///
    /// # Errors
    /// [`DomainError`] names the variable, its value and what would be right.
    pub fn from_env() -> Result<Self, DomainError> {
        Ok(Self(Kind::Dds(StaticPeers::from_env()?)))
    }

    /// For a participant in this domain.
    pub(in crate::ros) fn transport(&self, domain: Domain) -> Arc<dyn Transport> {
        match &self.0 {
            Kind::Dds(peers) => Arc::new(DdsTransport::new(domain, peers.clone())),
        }
    }
}
