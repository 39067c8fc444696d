//! Limits of the memory that a reader allocates for a bag.
//!
//! Sizes that a file states are not trusted. Lengths within a record must fit into it. Compressed data may expand to 64
//! MiB, or to 1000 times their size if that is more, but never beyond 1 GiB. Recordings of states expand two- to
//! tenfold; a chunk of one-coloured images expands more than a thousandfold, but is smaller than 64 MiB.

use std::io::Read;

use mcap::records::op;

/// Largest expansion ratio (size of the data to that of the compressed data) beyond [`ALWAYS`].
const EXPANSION: u64 = 1000;
/// Compressed data of any size may expand to this \[bytes\].
const ALWAYS: u64 = 64 << 20;
/// Largest chunk or message \[bytes\]. rosbag2's chunks are 768 kB, those of its largest preset 4 MB.
pub(super) const LARGEST: u64 = 1 << 30;

/// The size to which `compressed` bytes may expand.
pub(super) fn expanded(compressed: u64) -> u64 {
    EXPANSION.saturating_mul(compressed).clamp(ALWAYS, LARGEST)
}

/// Decompresses a message that rosbag2 compressed individually.
pub(super) fn decompress(data: &[u8]) -> Result<Vec<u8>, String> {
    let limit = expanded(data.len() as u64);
    let mut bytes = Vec::new();
    zstd::Decoder::new(data)
        .and_then(|decoder| decoder.take(limit + 1).read_to_end(&mut bytes))
        .map_err(|e| e.to_string())?;
    match bytes.len() as u64 > limit {
        true => Err(format!(
            "its {} bytes expand to more than {limit}",
            data.len()
        )),
        false => Ok(bytes),
    }
}

/// One part of a record's body.
enum Part {
    /// This many bytes.
    Fixed(usize),
    /// A length of four bytes, then that many bytes.
    Counted,
    /// A length of four bytes, then pairs of texts in that many bytes.
    TextPairs,
}

/// Whether the lengths in a record's body fit into it. The mcap crate reserves memory for a text before it reads it.
pub(super) fn lengths_fit(opcode: u8, body: &[u8]) -> bool {
    use Part::{Counted, Fixed, TextPairs};
    let parts: &[Part] = match opcode {
        op::HEADER => &[Counted, Counted],
        op::SCHEMA => &[Fixed(2), Counted, Counted, Counted],
        op::CHANNEL => &[Fixed(4), Counted, Counted, TextPairs],
        op::CHUNK => &[Fixed(28), Counted, Fixed(8)],
        op::CHUNK_INDEX => &[Fixed(32), Counted, Fixed(8), Counted, Fixed(16)],
        op::ATTACHMENT_INDEX => &[Fixed(40), Counted, Counted],
        op::METADATA_INDEX => &[Fixed(16), Counted],
        op::STATISTICS => &[Fixed(42), Counted],
        _ => &[],
    };
    let mut rest = body;
    parts.iter().all(|part| {
        let taken = match part {
            Fixed(n) => take(&mut rest, *n),
            Counted => take_counted(&mut rest),
            TextPairs => take_counted(&mut rest).filter(|pairs| {
                let mut pairs = *pairs;
                while !pairs.is_empty() {
                    if take_counted(&mut pairs).is_none() {
                        return false;
                    }
                }
                true
            }),
        };
        taken.is_some()
    })
}

fn take<'a>(rest: &mut &'a [u8], n: usize) -> Option<&'a [u8]> {
    let (taken, left) = rest.split_at_checked(n)?;
    *rest = left;
    Some(taken)
}

fn take_counted<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let length = take(rest, 4)?.try_into().ok()?;
    take(rest, u32::from_le_bytes(length) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_may_not_expand_without_bound() {
        let bomb = |size: usize| zstd::bulk::compress(&vec![0; size], 19).unwrap();
        let blank_image = bomb(24 << 20);
        assert_eq!(decompress(&blank_image).unwrap().len(), 24 << 20);
        let bomb = bomb((64 << 20) + 1);
        assert!(bomb.len() < 10_000);
        assert!(decompress(&bomb).unwrap_err().contains("expand to more"));
        assert_eq!(expanded(1 << 20), 1000 << 20);
        assert_eq!(expanded(1 << 40), LARGEST);
    }

    #[test]
    fn lengths_beyond_the_record_are_found() {
        let mut schema = vec![1, 0];
        for text in ["a/msg/B", "ros2msg", "float64 x"] {
            schema.extend((text.len() as u32).to_le_bytes());
            schema.extend(text.bytes());
        }
        assert!(lengths_fit(op::SCHEMA, &schema));
        for at in [2, 13, 24] {
            let mut wrong = schema.clone();
            wrong[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
            assert!(!lengths_fit(op::SCHEMA, &wrong), "{at}");
        }
        let mut channel = vec![0; 12];
        channel.extend(12u32.to_le_bytes());
        channel.extend([3, 0, 0, 0, b'k', b'e', b'y', 0xff, 0xff, 0xff, 0xff, b'v']);
        assert!(!lengths_fit(op::CHANNEL, &channel));
    }
}
