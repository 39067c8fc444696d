//! Samples that are sent in fragments.

use rustdds::{GUID, RTPSEntity, SequenceNumber, WriteOptionsBuilder, rpc::SampleIdentity};
use std::net::UdpSocket;

use super::*;

/// Too long for one datagram of loopback.
const LONG: usize = 70_000;

#[test]
fn a_fragmented_reply_does_not_arrive() {
    let domain = 63;
    let _claim = DomainClaim::new(domain);
    let (here, there) = (participant(domain), participant(domain));
    let (writer, mut reader) = (writer(&here), reader(&there));
    connect(&writer, &mut reader);
    // What names the request that it answers, in inline QoS, is lost.
    writer.write(vec![0; LONG], None).unwrap();
    assert_eq!(length(&mut reader, PATIENCE), Some(LONG));
    let answers = SampleIdentity {
        writer_guid: GUID::GUID_UNKNOWN,
        sequence_number: SequenceNumber::from(1),
    };
    let reply = |length: usize| {
        let options = WriteOptionsBuilder::new().related_sample_identity(answers);
        writer.write_with_options(vec![0; length], options.build())
    };
    reply(60_000).unwrap();
    assert_eq!(length(&mut reader, PATIENCE), Some(60_000));
    reply(LONG).unwrap();
    assert_eq!(length(&mut reader, SILENCE), None);
}

/// The datagram with the last of four fragments of a writer's sample.
fn fragment(writer: GUID, number: u32) -> Vec<u8> {
    const SIZE: u16 = 256;
    let guid = writer.to_bytes();
    let (prefix, entity) = guid.split_at(12);
    let mut datagram = b"RTPS\x02\x03\x01\x12".to_vec();
    datagram.extend(prefix);
    // DATA_FRAG, little endian, to any reader.
    datagram.extend([0x16, 0x01]);
    datagram.extend((32 + SIZE).to_le_bytes());
    datagram.extend([0, 0, 28, 0, 0, 0, 0, 0]);
    datagram.extend(entity);
    datagram.extend([0; 4]);
    datagram.extend(number.to_le_bytes());
    datagram.extend(4_u32.to_le_bytes());
    datagram.extend(1_u16.to_le_bytes());
    datagram.extend(SIZE.to_le_bytes());
    datagram.extend((4 * u32::from(SIZE)).to_le_bytes());
    datagram.extend([0; SIZE as usize]);
    datagram
}

#[test]
fn fragments_of_what_has_arrived_hold_up_a_reliable_reader() {
    let domain = 97;
    let _claim = DomainClaim::new(domain);
    let (here, there) = (participant(domain), participant(domain));
    let (writer, mut reader) = (writer(&here), reader(&there));
    connect(&writer, &mut reader);
    // As many as it keeps incomplete, and one more.
    const SAMPLES: u32 = 129;
    let mut next = |length_of: usize| {
        writer.write(vec![0; length_of], None).unwrap();
        assert_eq!(length(&mut reader, PATIENCE), Some(length_of));
    };
    (0..SAMPLES).for_each(|_| next(10));
    next(LONG);
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    for number in 1..=SAMPLES {
        // To the participants of this domain, of which one has the reader.
        for index in 0..2 {
            let port = 7411 + 250 * domain + 2 * index;
            let address = (Ipv4Addr::LOCALHOST, port);
            socket
                .send_to(&fragment(writer.guid(), number), address)
                .unwrap();
        }
        // One that comes after it says that it has been read.
        next(10);
    }
    // Until they are thrown away, ten seconds after the last of them.
    writer.write(vec![0; LONG], None).unwrap();
    assert_eq!(length(&mut reader, SILENCE), None);
}
