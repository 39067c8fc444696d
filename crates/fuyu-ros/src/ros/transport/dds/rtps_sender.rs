//! Sender of RTPS messages that rustdds does not send, or sends in a form that no peer can read (docs/upstream.md).
//!
//! The messages carry GUIDs of the participant's own endpoints, so peers treat them as messages of rustdds.

use rustdds::{
    DomainParticipant, GUID, RTPSEntity, SequenceNumber, Timestamp, rpc::SampleIdentity,
};
use std::{
    io, iter,
    net::{Ipv4Addr, SocketAddr, UdpSocket},
    thread,
    time::Duration,
};

use crate::ros::{DiscoveryRange, Gid};

/// RTPS header: protocol version 2.3 and the vendor id of rustdds.
const HEADER: [u8; 8] = *b"RTPS\x02\x03\x01\x12";
/// Vendor id of Fast DDS: the first bytes of its GUIDs.
const FAST_DDS: [u8; 2] = [0x01, 0x0f];

/// Submessage ids and flags; all submessages are little endian.
const INFO_DESTINATION: [u8; 2] = [0x0e, 0x01];
const INFO_TIMESTAMP: [u8; 2] = [0x09, 0x01];
/// Final flag set: no heartbeat is requested.
const ACKNACK: [u8; 2] = [0x06, 0x03];
/// Flag set: inline QoS is present.
const DATA_FRAG: [u8; 2] = [0x16, 0x03];

/// Parameter ids of inline QoS. Implementations disagree on the first id, so the parameter is sent with both, as
/// rustdds does.
const RELATED_SAMPLE_IDENTITY: [u16; 2] = [0x0083, 0x800f];
const END_OF_PARAMETERS: u16 = 0x0001;

/// Size of a rustdds datagram without payload \[bytes\].
const AROUND_PAYLOAD: usize = 80;
/// Largest rustdds datagram over loopback \[bytes\].
const LOOPBACK: usize = 65_488;
/// Size of the headers that rustdds subtracts from the MTU of an interface, and the MTU that it assumes for peers
/// behind a router \[bytes\].
const DATAGRAM_HEADERS: usize = 48;
const ETHERNET: usize = 1_500;

/// Size of the part of a sample in one datagram to another computer \[bytes\]; with all headers it fits into an
/// Ethernet frame.
const FRAGMENT: u16 = 1024;
/// As [`FRAGMENT`], within this computer. Larger, because the receive buffer of a socket counts the allocated memory of
/// each datagram, which for short datagrams is twice their length.
const FRAGMENT_WITHIN_COMPUTER: u16 = 16 * 1024;

/// Number of bytes that are sent without a pause: the receive buffer of a peer has 200 kB by default.
const BURST: usize = 64 * 1024;
/// Pause after a burst: on a busy computer, several time slices of other processes pass before a peer empties its
/// buffer.
const PAUSE: Duration = Duration::from_millis(10);
/// Number of times that a reply of several bursts is sent. Nothing requests a lost fragment, and a peer ignores
/// fragments that it already has.
const ROUNDS: usize = 2;

/// Smallest MTU of this computer's interfaces, at most that of Ethernet \[bytes\]. Tunnels and cloud networks have
/// smaller MTUs than Ethernet.
fn smallest_mtu() -> usize {
    let interfaces = std::fs::read_dir("/sys/class/net").into_iter().flatten();
    let texts = interfaces.filter_map(|i| std::fs::read_to_string(i.ok()?.path().join("mtu")).ok());
    let mtus = texts.filter_map(|text| text.trim().parse().ok());
    mtus.fold(ETHERNET, usize::min)
}

/// Content of an acknowledgement (ACKNACK) of a reader.
#[derive(Clone, Copy)]
enum Acknowledged {
    /// No sample has been received, and the first one is requested.
    FirstMissing,
    /// All samples up to this number have been received, and none is requested.
    UpTo(i64),
}

/// Sends RTPS messages to peers of a participant, and to the participant itself, from a socket of its own.
pub(super) struct RtpsSender {
    participant: DomainParticipant,
    socket: UdpSocket,
    /// Largest rustdds datagram to a peer that does not listen on loopback only \[bytes\].
    elsewhere: usize,
}

impl RtpsSender {
    /// Creates the sender of `participant`, whose discovery has this range: with [`DiscoveryRange::Localhost`] no
    /// message leaves the computer, unless the participant `has_peers` elsewhere.
    ///
    /// # Errors
    /// If the socket cannot be created.
    pub(super) fn new(
        participant: DomainParticipant,
        range: DiscoveryRange,
        has_peers: bool,
    ) -> io::Result<Self> {
        let address = match range {
            DiscoveryRange::Subnet => Ipv4Addr::UNSPECIFIED,
            DiscoveryRange::Localhost if has_peers => Ipv4Addr::UNSPECIFIED,
            DiscoveryRange::Localhost | DiscoveryRange::Off => Ipv4Addr::LOCALHOST,
        };
        let socket = UdpSocket::bind((address, 0))?;
        socket.set_nonblocking(true)?;
        Ok(Self {
            participant,
            socket,
            elsewhere: smallest_mtu().saturating_sub(DATAGRAM_HEADERS),
        })
    }

    /// Whether a writer ignores the request that rustdds sends after a match, as Fast DDS does.
    pub(super) fn must_request_from(writer: GUID) -> bool {
        writer.prefix.as_ref()[..2] == FAST_DDS
    }

    /// Requests the first sample of `writer`, with which `reader` has been matched. `count` is the number of this
    /// request, from 1. Fast DDS accepts a request only if its count is larger than the previous one, initially 0, but
    /// rustdds counts from 0.
    pub(super) fn request_first_sample(&self, reader: GUID, writer: GUID, count: u32) {
        let writers = self.participant.discovered_writers();
        let found = writers
            .iter()
            .find(|found| found.writer_proxy.remote_writer_guid == writer);
        let Some(found) = found else { return };
        let message = self.acknack(reader, writer, Acknowledged::FirstMissing, count);
        for locator in &found.writer_proxy.unicast_locator_list {
            if locator.is_udp() {
                self.send(&message, SocketAddr::from(*locator));
            }
        }
    }

    /// Acknowledges all samples up to `number` to the participant's own `writer`, on behalf of the participant's own
    /// `readers`.
    ///
    /// On loopback rustdds does not deliver the samples to these readers, but waits for their acknowledgements
    /// (docs/upstream.md).
    pub(super) fn acknowledge_own(&self, writer: GUID, readers: Vec<Gid>, number: i64) {
        let Some(port) = self.own_port() else { return };
        let to = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        for reader in readers {
            // rustdds ignores an acknowledgement with the same count as the previous one.
            let count = number as u32;
            let acknowledged = Acknowledged::UpTo(number);
            self.send(
                &self.acknack(reader.into(), writer, acknowledged, count),
                to,
            );
        }
    }

    /// The port on which the participant receives user data (RTPS 2.5, section 9.6.2.3).
    fn own_port(&self) -> Option<u16> {
        let participant = self.participant.participant_id();
        let port =
            7411 + 250 * u32::from(self.participant.domain_id()) + 2 * u32::from(participant);
        u16::try_from(port).ok()
    }

    /// Whether rustdds cannot send a reply of this length \[bytes\] to all readers of a topic. rustdds damages the
    /// inline QoS, which contains the identity of the request, of samples that need more than one datagram. It sends
    /// the same datagrams to all readers.
    pub(super) fn must_send(&self, dds_topic: &str, length: usize) -> bool {
        if length + AROUND_PAYLOAD <= self.elsewhere {
            return false;
        }
        let readers = self.participant.discovered_readers();
        let mut locators = readers
            .iter()
            .filter(|reader| reader.subscription_topic_data.topic_name() == dds_topic)
            .flat_map(|reader| &reader.reader_proxy.unicast_locator_list)
            // rustdds does not support shared memory.
            .filter(|locator| locator.is_udp())
            .peekable();
        let is_near = locators.peek().is_some() && locators.all(|locator| locator.is_loopback());
        !is_near || length > LOOPBACK - AROUND_PAYLOAD
    }

    /// Sends a reply (a sample of `writer`, with the identity of the request) in fragments to the topic's readers in
    /// the client's participant.
    pub(super) fn send_reply(
        &self,
        (writer, number): (GUID, SequenceNumber),
        dds_topic: &str,
        request: SampleIdentity,
        cdr: &[u8],
    ) {
        for found in self.participant.discovered_readers() {
            let proxy = &found.reader_proxy;
            let guid = proxy.remote_reader_guid;
            if guid.prefix != request.writer_guid.prefix
                || found.subscription_topic_data.topic_name() != dds_topic
            {
                continue;
            }
            let mut addresses: Vec<_> = (proxy.unicast_locator_list.iter())
                .filter(|locator| locator.is_udp())
                .map(|locator| SocketAddr::from(*locator))
                .collect();
            // One address suffices for a reader on this computer. All are checked, since another computer may have one
            // of this computer's addresses too, such as that of a container network.
            if let Some(near) = addresses.iter().find(|a| a.ip().is_loopback()) {
                addresses = vec![*near];
            } else if addresses.iter().all(|&a| is_of_this_computer(a)) {
                addresses.truncate(1);
            }
            for to in addresses {
                self.send_fragments((guid, writer, number), request, cdr, to);
            }
        }
    }

    /// Sends a sample in fragments to one address of a reader, without overflowing its receive buffer.
    fn send_fragments(
        &self,
        endpoints_and_number: (GUID, GUID, SequenceNumber),
        request: SampleIdentity,
        cdr: &[u8],
        to: SocketAddr,
    ) {
        let published = Timestamp::now();
        let length = if is_of_this_computer(to) {
            FRAGMENT_WITHIN_COMPUTER
        } else {
            FRAGMENT
        };
        let burst = BURST / usize::from(length);
        let rounds = if cdr.len() > BURST { ROUNDS } else { 1 };
        let fragments = cdr.chunks(length.into()).enumerate();
        let all = iter::repeat_n(fragments, rounds).flatten();
        for (sent, (index, fragment)) in all.enumerate() {
            if sent > 0 && sent % burst == 0 {
                thread::sleep(PAUSE);
            }
            let message = self.fragment(
                endpoints_and_number,
                request,
                published,
                (index, length, fragment, cdr.len()),
            );
            self.send(&message, to);
        }
    }

    fn send(&self, message: &[u8], to: SocketAddr) {
        // Any datagram may be lost. The system refuses datagrams to other computers if discovery is limited to this
        // one.
        if let Err(e) = self.socket.send_to(message, to) {
            tracing::debug!("no RTPS message to {to}: {e}");
        }
    }

    /// Header of a message, addressed to the participant of `peer`.
    fn message(&self, peer: GUID) -> Vec<u8> {
        let mut message = HEADER.to_vec();
        message.extend(self.participant.guid().prefix.as_ref());
        submessage(&mut message, INFO_DESTINATION, peer.prefix.as_ref());
        message
    }

    fn acknack(
        &self,
        reader: GUID,
        writer: GUID,
        acknowledged: Acknowledged,
        count: u32,
    ) -> Vec<u8> {
        let mut body = Vec::new();
        body.extend(entity(reader));
        body.extend(entity(writer));
        // Set of missing samples: lowest number, number of bits, bits.
        match acknowledged {
            Acknowledged::FirstMissing => {
                body.extend(number_bytes(1));
                body.extend(1_u32.to_le_bytes());
                body.extend((1_u32 << 31).to_le_bytes());
            }
            Acknowledged::UpTo(number) => {
                body.extend(number_bytes(number + 1));
                body.extend(0_u32.to_le_bytes());
            }
        }
        body.extend(count.to_le_bytes());
        let mut message = self.message(writer);
        submessage(&mut message, ACKNACK, &body);
        message
    }

    fn fragment(
        &self,
        (reader, writer, number): (GUID, GUID, SequenceNumber),
        request: SampleIdentity,
        published: Timestamp,
        (index, length, fragment, sample_size): (usize, u16, &[u8], usize),
    ) -> Vec<u8> {
        let mut body = Vec::with_capacity(96 + fragment.len());
        // Extra flags, and the offset to the inline QoS.
        body.extend([0, 0, 28, 0]);
        body.extend(entity(reader));
        body.extend(entity(writer));
        body.extend(number_bytes(number.into()));
        body.extend((index as u32 + 1).to_le_bytes());
        body.extend(1_u16.to_le_bytes());
        body.extend(length.to_le_bytes());
        body.extend((sample_size as u32).to_le_bytes());
        for id in RELATED_SAMPLE_IDENTITY {
            body.extend(id.to_le_bytes());
            body.extend(24_u16.to_le_bytes());
            body.extend(request.writer_guid.to_bytes());
            body.extend(number_bytes(request.sequence_number.into()));
        }
        body.extend(END_OF_PARAMETERS.to_le_bytes());
        body.extend(0_u16.to_le_bytes());
        body.extend(fragment);
        let mut message = self.message(reader);
        let ticks = published.to_ticks();
        let (seconds, fraction) = ((ticks >> 32) as u32, ticks as u32);
        let time = [seconds.to_le_bytes(), fraction.to_le_bytes()].concat();
        submessage(&mut message, INFO_TIMESTAMP, &time);
        submessage(&mut message, DATA_FRAG, &body);
        message
    }
}

/// Whether datagrams to `address` stay within this computer: the system then chooses the same address as their source.
fn is_of_this_computer(address: SocketAddr) -> bool {
    let source = || {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        socket.connect(address)?;
        socket.local_addr()
    };
    address.ip().is_loopback() || source().is_ok_and(|source| source.ip() == address.ip())
}

fn submessage(message: &mut Vec<u8>, kind_and_flags: [u8; 2], body: &[u8]) {
    message.extend(kind_and_flags);
    message.extend((body.len() as u16).to_le_bytes());
    message.extend(body);
}

/// Entity id of an endpoint.
fn entity(endpoint: GUID) -> [u8; 4] {
    let bytes = endpoint.to_bytes();
    [bytes[12], bytes[13], bytes[14], bytes[15]]
}

/// Bytes of a sequence number, upper half first.
fn number_bytes(number: i64) -> [u8; 8] {
    let (high, low) = ((number >> 32) as i32, number as u32);
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&high.to_le_bytes());
    bytes[4..].copy_from_slice(&low.to_le_bytes());
    bytes
}
