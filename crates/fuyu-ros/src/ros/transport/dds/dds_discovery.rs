//! Discovered state of a DDS participant, for queries that must not wait for the lock of the connection.

use rustdds::DomainParticipant;
use std::sync::Arc;

use super::{domain_participant, lost_peers::LostPeers, peers, static_peers::StaticPeers};
use crate::ros::{
    Domain, signals,
    transport::{Discovery, RemotePublisher},
};

/// Discovered state of a participant.
pub(super) struct DdsDiscovery {
    participant: DomainParticipant,
    /// Domain and static peers of further participants.
    place: (Domain, StaticPeers),
    /// Peers that the participant has lost.
    lost_peers: Arc<LostPeers>,
}

impl DdsDiscovery {
    pub(super) fn new(
        participant: DomainParticipant,
        place: (Domain, StaticPeers),
        lost_peers: Arc<LostPeers>,
    ) -> Self {
        Self {
            participant,
            place,
            lost_peers,
        }
    }
}

impl Discovery for DdsDiscovery {
    fn publishers(&self) -> Vec<RemotePublisher> {
        peers::publishers(&self.participant)
    }

    fn take_returned_peer(&self) -> Option<String> {
        self.lost_peers.take_returned(|| {
            let (domain, static_peers) = &self.place;
            let peers = static_peers.addresses();
            signals::with_blocked(|| domain_participant::create(*domain, &peers))
        })
    }
}
