//! DDS endpoints that carry serialized messages as bytes.

use rustdds::{
    RepresentationIdentifier, SequenceNumber,
    bytes::{BufMut, Bytes, BytesMut},
    no_key::{
        Decode, DefaultDecoder, DeserializedCacheChange, DeserializerAdapter, SerializerAdapter,
    },
    rpc,
};
use std::convert::Infallible;

use crate::ros::{
    Gid, RawSample, Time,
    held_replies::ReplyReader,
    sample::{ReplyPath, SampleIdentity},
};

/// Length of the encapsulation header before every CDR payload.
const HEADER: usize = 4;

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

impl From<rpc::SampleIdentity> for SampleIdentity {
    fn from(identity: rpc::SampleIdentity) -> Self {
        Self {
            writer: identity.writer_guid.into(),
            sequence_number: identity.sequence_number.into(),
        }
    }
}

impl From<SampleIdentity> for rpc::SampleIdentity {
    fn from(identity: SampleIdentity) -> Self {
        Self {
            writer_guid: identity.writer.into(),
            sequence_number: SequenceNumber::from(identity.sequence_number),
        }
    }
}

impl From<DeserializedCacheChange<Bytes>> for RawSample {
    fn from(change: DeserializedCacheChange<Bytes>) -> Self {
        let related = change.related_sample_identity().map(SampleIdentity::from);
        let publisher = Gid::from(change.writer_guid());
        let client = ReplyReader::new(related.map(|stated| stated.writer), publisher);
        Self {
            source_time: change.source_timestamp().and_then(to_time),
            received_time: to_time(change.receive_instant).unwrap_or_else(Time::wall),
            publisher,
            sequence_number: i64::from(change.sequence_number),
            related,
            identity: SampleIdentity {
                writer: publisher,
                sequence_number: change.sequence_number.into(),
            },
            reply_path: ReplyPath::Matched(client),
            cdr: change.into_value(),
        }
    }
}

/// Converts to the nearest RTPS timestamp: seconds as a 32.32 fixed-point number.
pub(super) fn to_timestamp(time: Time) -> rustdds::Timestamp {
    let nanos = time.as_nanos().max(0) as u64;
    let (seconds, rest) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
    let fraction = ((rest << 32) + 500_000_000) / 1_000_000_000;
    rustdds::Timestamp::from_ticks((seconds << 32) + fraction)
}

/// Converts an RTPS timestamp, seconds as a 32.32 fixed-point number; all ones mean "no time".
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

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if a request without a number is given one, or if times change.
    #[test]
    fn numbers_and_times_survive_rtps() {
        let unknown = i64::from(SequenceNumber::UNKNOWN);
        assert_eq!(unknown, SampleIdentity::UNKNOWN_NUMBER);
        for nanos in [1, 999_999_999, 1_700_000_000_123_456_789] {
            let time = Time::from_nanos(nanos);
            assert_eq!(to_time(to_timestamp(time)), Some(time));
        }
    }
}
