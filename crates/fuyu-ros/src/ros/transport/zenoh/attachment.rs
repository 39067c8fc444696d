//! Attachment of a Zenoh message: sequence number, time of publication and GID of the publisher.

use crate::ros::{Gid, Time, sample::SampleIdentity};

/// Length of an encoded attachment \[bytes\].
const LENGTH: usize = 33;
/// Length of a GID \[bytes\]; precedes the GID.
const GID_LENGTH: u8 = 16;

/// Attachment of a message, a request or a reply. A reply has the number and GID of its request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Attachment {
    /// Sequence number of the publisher, from 1.
    pub(super) sequence_number: i64,
    /// Time of publication by the wall clock of the sender.
    pub(super) source_time: Time,
    pub(super) gid: Gid,
}

impl Attachment {
    /// Identity of the message or request; for a reply, that of its request.
    pub(super) fn identity(&self) -> SampleIdentity {
        SampleIdentity {
            writer: self.gid,
            sequence_number: self.sequence_number,
        }
    }

    /// Encodes two 64-bit integers, little endian, then the length of the GID and the GID.
    pub(super) fn encode(&self) -> [u8; LENGTH] {
        let mut bytes = [0; LENGTH];
        bytes[..8].copy_from_slice(&self.sequence_number.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.source_time.as_nanos().to_le_bytes());
        bytes[16] = GID_LENGTH;
        bytes[17..].copy_from_slice(&self.gid.to_bytes16());
        bytes
    }

    /// Decodes an attachment; `None` if the bytes are not one.
    pub(super) fn decode(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; LENGTH] = bytes.try_into().ok()?;
        if bytes[16] != GID_LENGTH {
            return None;
        }
        let number = |from: usize| {
            let digits: [u8; 8] = std::array::from_fn(|i| bytes[from + i]);
            i64::from_le_bytes(digits)
        };
        let gid: [u8; 16] = std::array::from_fn(|i| bytes[17 + i]);
        Some(Self {
            sequence_number: number(0),
            source_time: Time::from_nanos(number(8)),
            gid: gid.into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // The layout in the design document of rmw_zenoh.
    #[test]
    fn number_time_and_gid_are_in_their_places() {
        let attachment = Attachment {
            sequence_number: 0x0102,
            source_time: Time::from_nanos(0x0304_0506),
            gid: [7; 16].into(),
        };
        let bytes = attachment.encode();
        assert_eq!(bytes[..8], [2, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes[8..16], [6, 5, 4, 3, 0, 0, 0, 0]);
        assert_eq!(bytes[16], 16);
        assert_eq!(bytes[17..], [7; 16]);
        assert_eq!(Attachment::decode(&bytes), Some(attachment));
        assert_eq!(Attachment::decode(&bytes[..32]), None);
        let mut other = bytes;
        other[16] = 15;
        assert_eq!(Attachment::decode(&other), None);
    }
}
