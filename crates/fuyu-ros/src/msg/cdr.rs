//! Serialization as in ROS 2 and in bags: a four-byte encapsulation header, then plain CDR (XCDR1).

use byteorder::{BigEndian, LittleEndian};
use serde::de::DeserializeOwned;

use super::Interface;

/// Encapsulation header of little-endian plain CDR.
pub const LITTLE_ENDIAN: [u8; 4] = [0, 1, 0, 0];

/// Bytes that are not a message of the expected type.
#[derive(Debug, thiserror::Error)]
pub enum CdrError {
    /// Too short for a header, or a representation other than plain CDR.
    #[error("not plain CDR: it starts with {0:02x?}, expected 00 00 or 00 01")]
    Encapsulation(Vec<u8>),
    /// The bytes after the header do not decode as the type.
    #[error("not a {type_name}: {source}")]
    Body {
        /// ROS type that was expected.
        type_name: String,
        /// Error of the decoder.
        source: cdr_encoding::Error,
    },
}

/// A message as little-endian CDR with its header.
pub fn encode<M: Interface>(message: &M) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(2 * size_of::<M>() + LITTLE_ENDIAN.len());
    encode_into(message, &mut bytes);
    bytes
}

/// As [`encode`], into a buffer that is emptied first.
pub fn encode_into<M: Interface>(message: &M, bytes: &mut Vec<u8>) {
    bytes.clear();
    bytes.extend_from_slice(&LITTLE_ENDIAN);
    // Writing to memory cannot fail, and the field types of `Interface` are all that CDR can hold.
    cdr_encoding::to_writer::<_, LittleEndian, _>(&mut *bytes, message)
        .expect("every message has a CDR form");
}

/// The message in `bytes`, of either byte order.
///
/// # Errors
/// [`CdrError`] if the header is not that of plain CDR, the bytes end early, or a value is invalid for its type.
pub fn decode<M: Interface>(bytes: &[u8]) -> Result<M, CdrError> {
    decode_as(bytes, &M::DEFINITION.type_name())
}

/// As [`decode`], for a type that is not declared as a message; `type_name` is the name for errors.
pub(crate) fn decode_as<T: DeserializeOwned>(bytes: &[u8], type_name: &str) -> Result<T, CdrError> {
    let decoded = match bytes {
        [0, 0, _, _, body @ ..] => cdr_encoding::from_bytes::<T, BigEndian>(body),
        [0, 1, _, _, body @ ..] => cdr_encoding::from_bytes::<T, LittleEndian>(body),
        _ => {
            return Err(CdrError::Encapsulation(
                bytes.iter().take(4).copied().collect(),
            ));
        }
    };
    match decoded {
        Ok((message, _)) => Ok(message),
        Err(source) => Err(CdrError::Body {
            type_name: type_name.to_owned(),
            source,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{geometry_msgs::PoseWithCovariance, std_msgs::Header};

    #[test]
    fn bytes_are_those_of_the_specification() {
        let header = Header {
            stamp: crate::msg::builtin_interfaces::Time { sec: 1, nanosec: 2 },
            frame_id: "ab".into(),
        };
        let bytes = encode(&header);
        let expected = b"\0\x01\0\0\x01\0\0\0\x02\0\0\0\x03\0\0\0ab\0";
        assert_eq!(bytes, expected);
        assert_eq!(decode::<Header>(&bytes).unwrap(), header);
        let big = b"\0\0\0\0\0\0\0\x01\0\0\0\x02\0\0\0\x03ab\0";
        assert_eq!(decode::<Header>(big).unwrap(), header);
    }

    #[test]
    fn nested_arrays_are_flat_and_without_a_length() {
        let mut m = PoseWithCovariance::default();
        m.covariance[5][5] = 7.0;
        let bytes = encode(&m);
        assert_eq!(bytes.len(), 4 + 8 * (7 + 36));
        assert_eq!(bytes[bytes.len() - 8..], 7f64.to_le_bytes());
    }

    #[test]
    fn damaged_bytes_are_an_error() {
        let bytes = encode(&Header::default());
        for cut in 0..bytes.len() {
            assert!(decode::<Header>(&bytes[..cut]).is_err(), "{cut}");
        }
        let mut wrong = bytes.clone();
        wrong[1] = 7;
        assert!(matches!(
            decode::<Header>(&wrong),
            Err(CdrError::Encapsulation(_))
        ));
    }
}
