//! Static peers (`ROS_STATIC_PEERS`): computers whose nodes are discovered without multicast.
//!
//! rustdds announces a participant by multicast, on this computer, and to every participant that it knows; further
//! addresses cannot be configured (docs/upstream.md). Therefore the participant receives, at its own discovery port, a
//! datagram that announces a placeholder for each static peer: a fictitious participant, with the discovery ports of
//! that computer, that only receives announcements. rustdds then announces itself at these ports, at once and every 10
//! s, and the participants there respond as to any announcement. Since rustdds prefers multicast for data, both sides
//! must do without it ([`occupy_multicast_ports`]).

use rustdds::DomainParticipant;
use std::{
    io,
    net::{IpAddr, Ipv4Addr, SocketAddr, ToSocketAddrs, UdpSocket},
    thread,
    time::{Duration, Instant},
};

use crate::ros::context::DomainError;

/// Number of participants of a peer that announcements are sent to, those with the lowest ids, as in discovery on one
/// computer.
const PARTICIPANTS: u16 = 12;

/// Longest time in which a participant is created.
const CREATION: Duration = Duration::from_secs(1);

/// Multicast group of discovery (RTPS 2.5, section 9.6.2.4.1).
const MULTICAST_GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);

/// First bytes of the GUID of a placeholder: the vendor id of rustdds and a text.
const PLACEHOLDER: [u8; 8] = [0x01, 0x12, b's', b't', b'a', b't', b'i', b'c'];

/// Entity ids of a participant, and of the reader and writer of announcements.
const PARTICIPANT: [u8; 4] = [0x00, 0x00, 0x01, 0xc1];
const READER: [u8; 4] = [0x00, 0x01, 0x00, 0xc7];
const WRITER: [u8; 4] = [0x00, 0x01, 0x00, 0xc2];

/// Parameter ids of an announcement.
const SENTINEL: u16 = 0x0001;
const LEASE: u16 = 0x0002;
const PROTOCOL_VERSION: u16 = 0x0015;
const VENDOR: u16 = 0x0016;
const METATRAFFIC_UNICAST_LOCATOR: u16 = 0x0032;
const PARTICIPANT_GUID: u16 = 0x0050;
const BUILTIN_ENDPOINTS: u16 = 0x0058;

/// Built-in endpoint set of a placeholder: only the reader of announcements.
const DETECTOR: u32 = 1 << 1;
const UDP_V4: u32 = 1;

/// Computers that receive announcements in addition to those reached by multicast.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(in crate::ros::transport) struct StaticPeers {
    /// IPv4 addresses or host names.
    names: Vec<String>,
}

impl StaticPeers {
    /// Reads `ROS_STATIC_PEERS`: IPv4 addresses or host names, separated by semicolons.
    ///
    /// # Errors
    /// [`DomainError`] if the value is not such a list.
    pub(in crate::ros::transport) fn from_env() -> Result<Self, DomainError> {
        Self::parse(&std::env::var("ROS_STATIC_PEERS").unwrap_or_default())
    }

    fn parse(value: &str) -> Result<Self, DomainError> {
        let names = value
            .split(';')
            .map(str::trim)
            .filter(|name| !name.is_empty());
        let names: Vec<_> = names.map(str::to_owned).collect();
        let is_allowed = |c: char| c.is_ascii_alphanumeric() || ".-_".contains(c);
        match names.iter().all(|name| name.chars().all(is_allowed)) {
            true => Ok(Self { names }),
            false => Err(DomainError::new(
                "ROS_STATIC_PEERS",
                value,
                "expected IPv4 addresses or host names separated by semicolons",
            )),
        }
    }

    /// The IPv4 addresses of all peers; peers without one are logged.
    pub(super) fn addresses(&self) -> Vec<Ipv4Addr> {
        let mut addresses = Vec::new();
        for name in &self.names {
            let found = (name.as_str(), 0).to_socket_addrs().into_iter().flatten();
            let found = found.filter_map(|address| match address.ip() {
                IpAddr::V4(address) => Some(address),
                IpAddr::V6(_) => None,
            });
            let before = addresses.len();
            addresses.extend(found);
            if addresses.len() == before {
                tracing::warn!(
                    "ROS_STATIC_PEERS: {name} has no IPv4 address now, and is not contacted"
                );
            }
        }
        addresses.sort();
        addresses.dedup();
        addresses
    }
}

/// This computer's addresses on the routes to these peers.
pub(super) fn local_addresses(peers: &[Ipv4Addr]) -> Vec<Ipv4Addr> {
    let local = |peer: &Ipv4Addr| -> io::Result<IpAddr> {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        // Connecting a UDP socket sends nothing, but selects the interface by the routing table.
        socket.connect((*peer, 7400))?;
        Ok(socket.local_addr()?.ip())
    };
    let mut addresses = Vec::new();
    for peer in peers {
        match local(peer) {
            Ok(IpAddr::V4(address)) => addresses.push(address),
            Ok(IpAddr::V6(_)) => {}
            Err(e) => tracing::warn!("ROS_STATIC_PEERS: there is no route to {peer}: {e}"),
        }
    }
    addresses.sort();
    addresses.dedup();
    addresses
}

/// Announces the placeholders of its static peers to a participant. With `uses_multicast` there is also a placeholder
/// for the multicast group, since a participant without multicast addresses would not announce itself there.
///
/// # Errors
/// If the datagrams cannot be sent.
pub(super) fn introduce(
    participant: &DomainParticipant,
    peers: &[Ipv4Addr],
    uses_multicast: bool,
) -> io::Result<()> {
    if peers.is_empty() {
        return Ok(());
    }
    let domain = participant.domain_id();
    let own = discovery_port(domain, participant.participant_id());
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    let introduce = |address: Ipv4Addr, ports: &[u16]| {
        let message = placeholder(address, ports);
        socket.send_to(&message, SocketAddr::from((Ipv4Addr::LOCALHOST, own)))
    };
    let ports: Vec<_> = (0..PARTICIPANTS)
        .map(|id| discovery_port(domain, id))
        .collect();
    for peer in peers {
        introduce(*peer, &ports)?;
    }
    if uses_multicast {
        introduce(MULTICAST_GROUP, &[multicast_port(domain)])?;
    }
    Ok(())
}

/// Sockets that occupy the multicast ports of a domain. A participant that is created meanwhile cannot bind these ports
/// and so announces no multicast addresses; otherwise peers that multicast does not reach would be sent multicast only.
/// The participant is still discovered by multicast if it announces itself that way ([`introduce`]).
pub(super) fn occupy_multicast_ports(domain: u16) -> Vec<UdpSocket> {
    let base = multicast_port(domain);
    let bind = || {
        let sockets = [base, base + 1].map(|port| UdpSocket::bind((Ipv4Addr::UNSPECIFIED, port)));
        sockets.into_iter().flatten().collect::<Vec<_>>()
    };
    let mut sockets = bind();
    // Another process that is creating a participant occupies the ports for a short time.
    let end = Instant::now() + CREATION;
    while sockets.len() < 2 && Instant::now() < end {
        drop(sockets);
        thread::sleep(CREATION / 20);
        sockets = bind();
    }
    if sockets.len() < 2 {
        tracing::warn!(
            "ROS_STATIC_PEERS: another process uses multicast in domain {domain}, so this one does as well; peers that \
             multicast does not reach may receive nothing"
        );
    }
    sockets
}

/// Whether a GUID prefix belongs to a placeholder.
pub(super) fn is_placeholder(prefix: &[u8]) -> bool {
    prefix.starts_with(&PLACEHOLDER)
}

/// UDP port of unicast discovery (RTPS 2.5, section 9.6.2.3).
fn discovery_port(domain: u16, participant: u16) -> u16 {
    multicast_port(domain) + 10 + 2 * participant
}

/// UDP port of multicast discovery; the port of multicast data is the next one.
fn multicast_port(domain: u16) -> u16 {
    7400 + 250 * domain
}

/// RTPS message that announces a placeholder with this address and these ports.
fn placeholder(peer: Ipv4Addr, ports: &[u16]) -> Vec<u8> {
    let mut prefix = PLACEHOLDER.to_vec();
    prefix.extend(peer.octets());
    // Parameters, little endian, after their encapsulation header.
    let mut parameters = vec![0x00, 0x03, 0x00, 0x00];
    let mut add = |id: u16, value: &[u8]| {
        parameters.extend(id.to_le_bytes());
        parameters.extend((value.len() as u16).to_le_bytes());
        parameters.extend(value);
    };
    add(PROTOCOL_VERSION, &[2, 3, 0, 0]);
    add(VENDOR, &[PLACEHOLDER[0], PLACEHOLDER[1], 0, 0]);
    add(PARTICIPANT_GUID, &[&prefix[..], &PARTICIPANT].concat());
    for port in ports {
        let mut locator = UDP_V4.to_le_bytes().to_vec();
        locator.extend(u32::from(*port).to_le_bytes());
        locator.extend([0; 12]);
        locator.extend(peer.octets());
        add(METATRAFFIC_UNICAST_LOCATOR, &locator);
    }
    add(BUILTIN_ENDPOINTS, &DETECTOR.to_le_bytes());
    // The lease never ends.
    let infinite = [i32::MAX.to_le_bytes(), u32::MAX.to_le_bytes()].concat();
    add(LEASE, &infinite);
    add(SENTINEL, &[]);
    // DATA submessage: the first sample of its writer, without inline QoS.
    let mut data = vec![0, 0, 16, 0];
    data.extend(READER);
    data.extend(WRITER);
    data.extend([0, 0, 0, 0, 1, 0, 0, 0]);
    data.extend(parameters);
    let mut message = b"RTPS\x02\x03\x01\x12".to_vec();
    message.extend(prefix);
    message.extend([0x15, 0x05]);
    message.extend((data.len() as u16).to_le_bytes());
    message.extend(data);
    message
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_peers_is_read_as_in_ros() {
        let names = |value: &str| StaticPeers::parse(value).map(|peers| peers.names);
        assert_eq!(names("").unwrap(), [""; 0]);
        assert_eq!(
            names(" 10.0.0.1; robot.local;").unwrap(),
            ["10.0.0.1", "robot.local"]
        );
        let error = names("10.0.0.1, 10.0.0.2").unwrap_err().to_string();
        assert!(
            error.contains("ROS_STATIC_PEERS") && error.contains("10.0.0.1, 10.0.0.2"),
            "{error}"
        );
        assert!(names("[fe80::1]").is_err());
        let peers = StaticPeers::parse("10.0.0.2;10.0.0.1;10.0.0.2").unwrap();
        assert_eq!(
            peers.addresses(),
            [Ipv4Addr::new(10, 0, 0, 1), Ipv4Addr::new(10, 0, 0, 2)]
        );
        assert_eq!(
            local_addresses(&[Ipv4Addr::LOCALHOST]),
            [Ipv4Addr::LOCALHOST]
        );
    }
}
