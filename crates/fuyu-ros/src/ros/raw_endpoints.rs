//! DDS endpoints that carry serialized messages as bytes.

use rustdds::{
    RepresentationIdentifier,
    bytes::{BufMut, Bytes, BytesMut},
    no_key::{
        Decode, DefaultDecoder, DeserializedCacheChange, DeserializerAdapter, SerializerAdapter,
    },
    rpc::SampleIdentity,
};
use std::convert::Infallible;

use super::Time;

/// Identity of a publisher or subscription on the wire.
pub use ros2_client::Gid;

/// Length of the encapsulation header before every CDR payload.
const HEADER: usize = 4;

/// A received message in serialized form.
#[derive(Debug, Clone)]
pub struct RawSample {
    /// Encapsulation header and CDR, as a bag stores them.
    pub cdr: Bytes,
    /// Time of publication by the wall clock of the publisher, if it states one.
    pub source_time: Option<Time>,
    /// Time of arrival (wall clock).
    pub received_time: Time,
    /// The publisher.
    pub publisher: Gid,
    /// Sequence number of the publisher.
    pub sequence_number: i64,
    /// Identity of the related request, of services.
    pub(super) related: Option<SampleIdentity>,
    /// Identity of this sample.
    pub(super) identity: SampleIdentity,
}

#[cfg(test)]
impl RawSample {
    pub(super) fn for_test(cdr: Bytes) -> Self {
        let publisher = Gid::from([0; 16]);
        let identity = SampleIdentity {
            writer_guid: publisher.into(),
            sequence_number: rustdds::SequenceNumber::from(1),
        };
        Self {
            cdr,
            source_time: None,
            received_time: Time::ZERO,
            publisher,
            sequence_number: 1,
            related: None,
            identity,
        }
    }
}

/// Passes bytes to and from rustdds unchanged.
#[derive(Debug, Clone, Copy)]
pub(super) struct CdrPassthrough;

pub(super) type RawWriter = rustdds::no_key::DataWriter<Bytes, CdrPassthrough>;
pub(super) type RawReader = rustdds::no_key::SimpleDataReader<Bytes, CdrPassthrough>;

impl SerializerAdapter<Bytes> for CdrPassthrough {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(value: &Bytes) -> Result<Bytes, Infallible> {
        Ok(value.slice(HEADER.min(value.len())..))
    }
}

impl DeserializerAdapter<Bytes> for CdrPassthrough {
    type Error = Infallible;
    type Decoded = Bytes;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[
            RepresentationIdentifier::CDR_LE,
            RepresentationIdentifier::CDR_BE,
        ]
    }

    fn transform_decoded(decoded: Bytes) -> Bytes {
        decoded
    }
}

impl DefaultDecoder<Bytes> for CdrPassthrough {
    type Decoder = Self;
    const DECODER: Self = Self;
}

impl Decode<'_, Bytes> for CdrPassthrough {
    type Error = Infallible;

    fn decode_bytes(
        self,
        input: &[u8],
        encoding: RepresentationIdentifier,
    ) -> Result<Bytes, Infallible> {
        let mut bytes = BytesMut::with_capacity(HEADER + input.len());
        bytes.put_slice(&encoding.to_bytes());
        bytes.put_slice(&[0, 0]);
        bytes.put_slice(input);
        Ok(bytes.freeze())
    }
}

impl From<DeserializedCacheChange<Bytes>> for RawSample {
    fn from(change: DeserializedCacheChange<Bytes>) -> Self {
        Self {
            source_time: change.source_timestamp().and_then(to_time),
            received_time: to_time(change.receive_instant).unwrap_or_else(Time::wall),
            publisher: change.writer_guid().into(),
            sequence_number: i64::from(change.sequence_number),
            related: change.related_sample_identity(),
            identity: SampleIdentity {
                writer_guid: change.writer_guid(),
                sequence_number: change.sequence_number,
            },
            cdr: change.into_value(),
        }
    }
}

/// RTPS timestamps are 32.32 fixed point seconds; all ones mean "none".
fn to_time(t: rustdds::Timestamp) -> Option<Time> {
    if t == rustdds::Timestamp::INVALID || t == rustdds::Timestamp::INFINITE {
        return None;
    }
    let ticks = t.to_ticks();
    let nanos = ((ticks & 0xffff_ffff) * 1_000_000_000 + (1 << 31)) >> 32;
    Some(Time::from_nanos(
        (ticks >> 32) as i64 * 1_000_000_000 + nanos as i64,
    ))
}
