//! Samples: serialized messages, as a transport carries them, with their identity.

use bytes::Bytes;

use super::{Time, held_replies::ReplyReader};

/// Identity of a publisher or subscription on the wire.
pub use ros2_client::Gid;

/// Identity of a sample: GID of its publisher (or of the reader that expects the reply) and sequence number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct SampleIdentity {
    pub(super) writer: Gid,
    /// From 1; [`Self::UNKNOWN_NUMBER`] stands for the number of the sample that carries this identity.
    pub(super) sequence_number: i64,
}

impl SampleIdentity {
    /// `SEQUENCENUMBER_UNKNOWN` of RTPS.
    pub(super) const UNKNOWN_NUMBER: i64 = -(1 << 32);
}

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
    /// For services: identity of the related request.
    pub(super) related: Option<SampleIdentity>,
    /// Identity of this sample.
    pub(super) identity: SampleIdentity,
    /// For requests: how the reply reaches the client.
    pub(super) reply_path: ReplyPath,
}

/// How the reply to a request reaches its client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ReplyPath {
    /// In memory: the client belongs to the same participant.
    Local,
    /// Through the transport, at any time.
    #[cfg_attr(
        not(any(feature = "zenoh", test)),
        expect(dead_code, reason = "DDS has to match the client first")
    )]
    Wire,
    /// Through the transport, once this reader has been matched.
    Matched(ReplyReader),
}

#[cfg(test)]
impl RawSample {
    pub(super) fn for_test(cdr: Bytes) -> Self {
        let publisher = Gid::from([0; 16]);
        let identity = SampleIdentity {
            writer: publisher,
            sequence_number: 1,
        };
        Self {
            cdr,
            source_time: None,
            received_time: Time::ZERO,
            publisher,
            sequence_number: 1,
            related: None,
            identity,
            reply_path: ReplyPath::Wire,
        }
    }
}
