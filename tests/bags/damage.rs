//! Broken bags: cut anywhere, or with flipped bits.

use fuyu::bag::{Bag, Compression, WriterOptions};
use rand::{Rng, RngExt, SeedableRng};
use std::fs;
use std::path::Path;

use crate::sample;

struct Whole {
    bytes: Vec<u8>,
    /// Position of the end of each chunk in the file, and number of messages up to there.
    chunks: Vec<(u64, usize)>,
}

fn whole(dir: &Path, compression: Compression) -> Whole {
    let path = dir.join(format!("{compression:?}"));
    let options = WriterOptions {
        compression,
        chunk_size: 3000,
        ..Default::default()
    };
    sample::write(&path, 400, options);
    let file = format!("{}_0.mcap", path.file_name().unwrap().display());
    let bytes = fs::read(path.join(file)).unwrap();
    // Positions of the chunks from the mcap crate's reader.
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let mut sum = 0;
    let chunks = summary
        .chunk_indexes
        .iter()
        .map(|c| {
            sum += summary.stream_chunk(&bytes, c).unwrap().count();
            (c.chunk_start_offset + c.chunk_length, sum)
        })
        .collect();
    Whole { bytes, chunks }
}

#[test]
fn every_whole_chunk_is_read_wherever_the_file_is_cut() {
    let dir = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let whole = whole(dir.path(), compression);
        assert!(whole.chunks.len() > 5, "too few chunks");
        let size = whole.bytes.len() as u64;
        // At every byte around the ends of the chunks and of the file, and in between at steps that do not align with chunks.
        let mut cuts: Vec<u64> = (0..size)
            .step_by(61)
            .chain(0..40)
            .chain(size - 60..size)
            .collect();
        for (end, _) in &whole.chunks {
            cuts.extend(end - 12..end + 12);
        }
        let file = dir.path().join("cut.mcap");
        for cut in cuts {
            fs::write(&file, &whole.bytes[..cut as usize]).unwrap();
            let bag = Bag::open(&file).unwrap();
            let expected = whole
                .chunks
                .iter()
                .rfind(|(end, _)| *end <= cut)
                .map_or(0, |(_, count)| *count);
            let mut messages = bag.messages();
            let read = messages.by_ref().count();
            assert_eq!(read, expected, "{compression:?}, cut at {cut} of {size}");
            // Only a cut within the closing magic bytes loses nothing.
            if cut < size - 8 {
                assert!(
                    !messages.damage().is_empty(),
                    "{compression:?}, cut at {cut}"
                );
            }
            assert_eq!(
                bag.info().unwrap().messages,
                expected as u64,
                "cut at {cut}"
            );
        }
    }
}

#[test]
fn flipped_bits_neither_change_a_message_nor_lose_one_silently() {
    let dir = tempfile::tempdir().unwrap();
    let mut rng = rand::rngs::StdRng::seed_from_u64(1);
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let whole = whole(dir.path(), compression);
        let file = dir.path().join("flipped.mcap");
        fs::write(&file, &whole.bytes).unwrap();
        let original: Vec<_> = Bag::open(&file).unwrap().messages().collect();
        let data_end = whole.chunks.last().unwrap().0;
        for _ in 0..600 {
            let mut bytes = whole.bytes.clone();
            let at = rng.random_range(8..bytes.len());
            bytes[at] ^= 1 << rng.random_range(0..8);
            fs::write(&file, &bytes).unwrap();
            let bag = Bag::open(&file).unwrap();
            let mut messages = bag.messages();
            let read: Vec<_> = messages.by_ref().collect();
            // The messages are in order and unchanged, and there are no others.
            let mut rest = original.iter();
            for m in &read {
                let found = rest.any(|o| {
                    (o.log_time, &o.topic.name, &o.data) == (m.log_time, &m.topic.name, &m.data)
                });
                assert!(
                    found,
                    "{compression:?}, byte {at}: a message that was never written"
                );
            }
            if at as u64 > data_end {
                assert_eq!(
                    read.len(),
                    original.len(),
                    "byte {at} is behind all messages"
                );
            } else if read.len() < original.len() {
                assert!(
                    !messages.damage().is_empty(),
                    "{compression:?}, byte {at}: silent loss"
                );
            }
            let _ = bag.info();
        }
    }
}

#[test]
fn noise_is_not_a_bag_and_does_no_harm() {
    let dir = tempfile::tempdir().unwrap();
    let mut rng = rand::rngs::StdRng::seed_from_u64(2);
    let file = dir.path().join("noise.mcap");
    let error = |bytes: &[u8]| {
        fs::write(&file, bytes).unwrap();
        Bag::open(&file).err().map(|e| e.to_string())
    };
    assert!(error(b"PK\x03\x04").unwrap().contains("not an MCAP file"));
    assert!(error(b"SQLite format 3\0").unwrap().contains("sqlite3"));
    for _ in 0..2000 {
        // A valid start of file, then records of every kind with wrong lengths and random content.
        let mut bytes = mcap::MAGIC.to_vec();
        for _ in 0..rng.random_range(1..6) {
            let mut body = vec![0; rng.random_range(0..200)];
            rng.fill_bytes(&mut body);
            bytes.push(rng.random_range(0..0x12));
            let length = match rng.random_range(0..4) {
                0 => rng.random::<u64>(),
                1 => rng.random_range(0..300),
                _ => body.len() as u64,
            };
            bytes.extend_from_slice(&length.to_le_bytes());
            bytes.extend_from_slice(&body);
        }
        assert_eq!(error(&bytes), None);
        let bag = Bag::open(&file).unwrap();
        bag.messages().for_each(drop);
        bag.info().unwrap();
    }
}

#[test]
fn a_folder_that_is_no_bag_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let error = |path: &Path| Bag::open(path).unwrap_err().to_string();
    assert!(error(&dir.path().join("none")).contains("no such file"));
    assert!(error(dir.path()).contains("no .mcap file"));
    let metadata = |text: &str| fs::write(dir.path().join("metadata.yaml"), text).unwrap();
    metadata(
        "rosbag2_bagfile_information:\n  storage_identifier: sqlite3\n  relative_file_paths: [a.db3]\n",
    );
    assert!(error(dir.path()).contains("sqlite3"));
    metadata(
        "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths: [a.mcap]\n",
    );
    assert!(error(dir.path()).contains("a.mcap"));
    metadata("rosbag2_bagfile_information: 3\n");
    assert!(error(dir.path()).contains("metadata.yaml"));
}
