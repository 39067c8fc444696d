//! Creation of DDS participants.

use rustdds::{DomainParticipant, DomainParticipantBuilder};
use std::net::Ipv4Addr;

use super::static_peers;
use crate::ros::{DiscoveryRange, Domain};

/// Creates a participant of `domain` that also announces itself to `peers`. Its threads inherit the caller's signal
/// mask. As in ROS, peers are contacted unless the range is [`DiscoveryRange::Off`].
pub(super) fn create(domain: Domain, peers: &[Ipv4Addr]) -> Result<DomainParticipant, String> {
    let builder = DomainParticipantBuilder::new(domain.id);
    let builder = match domain.range {
        DiscoveryRange::Subnet => builder,
        DiscoveryRange::Localhost => {
            let mut networks = static_peers::local_addresses(peers);
            networks.push(Ipv4Addr::LOCALHOST);
            builder.with_only_networks(networks)
        }
        DiscoveryRange::Off => builder
            .with_only_networks([] as [Ipv4Addr; 0])
            .same_host_loopback(false),
    };
    // The multicast ports stay occupied until the participant exists, so that peers do not send it multicast.
    let _ports = match peers {
        [] => Vec::new(),
        _ => static_peers::occupy_multicast_ports(domain.id),
    };
    let participant = builder.build().map_err(|e| e.to_string())?;
    let on_subnet = domain.range == DiscoveryRange::Subnet;
    if domain.range != DiscoveryRange::Off
        && let Err(e) = static_peers::introduce(&participant, peers, on_subnet)
    {
        tracing::warn!("ROS_STATIC_PEERS: not contacted: {e}");
    }
    Ok(participant)
}
