//! Bags made to harm: small files that claim to be large, names and types without end.

use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use allocation_counter::measure;
use fuyu::bag::{Bag, MOST_COLUMNS, RecordedTopic, TableFormat, Writer, WriterOptions, convert};
use mcap::Compression;

/// Memory that a small file may take \[bytes\]: a chunk of 64 MiB as it is decompressed and as records.
const MEMORY: u64 = 256 << 20;

/// One topic with messages in a file without fuyu's limits.
fn mcap_file(
    topic: &str,
    schema: &str,
    messages: &[Vec<u8>],
    compression: Option<Compression>,
) -> Vec<u8> {
    let mut writer = mcap::WriteOptions::new()
        .compression(compression)
        .chunk_size(None)
        .use_chunks(compression.is_some())
        .create(Cursor::new(Vec::new()))
        .unwrap();
    let schema = writer
        .add_schema("a/msg/B", "ros2msg", schema.as_bytes())
        .unwrap();
    let id = writer
        .add_channel(schema, topic, "cdr", &BTreeMap::new())
        .unwrap();
    for (i, data) in messages.iter().enumerate() {
        let header = mcap::records::MessageHeader {
            channel_id: id,
            sequence: i as u32,
            log_time: i as u64,
            publish_time: i as u64,
        };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// Reads everything; the damage and the memory that it took.
fn read(path: &Path) -> (usize, Vec<String>, u64) {
    let mut found = (0, Vec::new());
    let memory = measure(|| {
        let bag = Bag::open(path).unwrap();
        let mut messages = bag.messages();
        let count = messages.by_ref().count();
        found = (
            count,
            messages.damage().iter().map(ToString::to_string).collect(),
        );
        let _ = bag.info();
    });
    (found.0, found.1, memory.bytes_max)
}

fn fuyu(args: &[&str], path: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fuyu"));
    command.arg("bag").args(args).arg(path).output().unwrap()
}

fn file(dir: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = dir.join(name);
    fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn small_files_do_not_become_gigabytes() {
    let dir = tempfile::tempdir().unwrap();
    let zeros = vec![vec![0; 300 << 20]];
    // A chunk, a file that is compressed as a whole, and a message that is compressed individually.
    let chunk = mcap_file("/a", "uint8[] x\n", &zeros, Some(Compression::Zstd));
    let plain = mcap_file("/a", "uint8[] x\n", &zeros, None);
    let whole = zstd::bulk::compress(&plain, 3).unwrap();
    let packed = zstd::bulk::compress(&zeros[0], 3).unwrap();
    drop((zeros, plain));
    let packed = mcap_file("/a", "uint8[] x\n", &[packed], Some(Compression::Zstd));
    let folder = dir.path().join("folder");
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("a.mcap"), &packed).unwrap();
    let metadata = "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths: [a.mcap]\n  \
                    compression_format: zstd\n  compression_mode: message\n";
    fs::write(folder.join("metadata.yaml"), metadata).unwrap();
    for (path, size) in [
        (file(dir.path(), "chunk.mcap", &chunk), chunk.len()),
        (file(dir.path(), "whole.mcap.zstd", &whole), whole.len()),
        (folder, packed.len()),
    ] {
        assert!(size < 100_000, "{}: {size} bytes", path.display());
        let (count, damage, memory) = read(&path);
        assert_eq!(count, 0, "{}", path.display());
        assert!(memory < MEMORY, "{}: {memory} bytes", path.display());
        // File and offset are named.
        assert!(
            damage[0].contains(", byte ") && damage[0].contains("at most")
                || damage[0].contains("more than"),
            "{damage:?}"
        );
    }
}

#[test]
fn a_text_of_four_gigabytes_is_not_allocated() {
    let dir = tempfile::tempdir().unwrap();
    let mut bytes = mcap_file("/a", "uint8 x\n", &[vec![0, 1, 0, 0, 7]], None);
    let name = bytes.windows(7).position(|w| w == b"a/msg/B").unwrap();
    bytes[name - 4..name].copy_from_slice(&u32::MAX.to_le_bytes());
    let path = file(dir.path(), "text.mcap", &bytes);
    let (_, damage, memory) = read(&path);
    assert!(memory < 1 << 20, "{memory} bytes");
    assert!(damage[0].contains("longer than the record"), "{damage:?}");
}

#[test]
fn names_of_any_length_are_printed_in_a_line() {
    let dir = tempfile::tempdir().unwrap();
    let long = format!("/{}", "x".repeat(65_536));
    let bytes = mcap_file(
        &long,
        "uint8 x\n",
        &[vec![0, 1, 0, 0, 7]],
        Some(Compression::Lz4),
    );
    let path = file(dir.path(), "long.mcap", &bytes);
    for command in ["info", "check"] {
        let output = fuyu(&[command], &path);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(
            matches!(output.status.code(), Some(0 | 1)),
            "{command}: {errors}"
        );
        assert!(!errors.contains("panicked"), "{errors}");
        let longest = output.stdout.split(|b| *b == b'\n').map(<[u8]>::len).max();
        assert!(command == "check" || longest.unwrap() < 1000, "{longest:?}");
    }
}

#[test]
fn nested_types_do_not_overflow_the_stack() {
    let dir = tempfile::tempdir().unwrap();
    let mut schema = "T0 a\n".to_owned();
    for i in 0..60_000 {
        schema += &format!("===\nMSG: a/T{i}\nT{} a\n", i + 1);
    }
    schema += "===\nMSG: a/T60000\nuint8 a\n";
    let bytes = mcap_file(
        "/a",
        &schema,
        &[vec![0, 1, 0, 0, 7]],
        Some(Compression::Zstd),
    );
    let path = file(dir.path(), "nested.mcap", &bytes);
    let output = fuyu(&["convert", "--to", "csv"], &path);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{errors}");
    assert!(errors.contains("nested more than 32 deep"), "{errors}");
}

#[test]
fn three_million_columns_become_ten_thousand() {
    let dir = tempfile::tempdir().unwrap();
    let schema = "Row[] rows\n===\nMSG: a/Row\nuint8 first\nint8[] cells\n";
    // 1000 rows of 3000 cells.
    let mut message = vec![0, 1, 0, 0];
    let mut body: Vec<u8> = 1000u32.to_le_bytes().to_vec();
    for _ in 0..1000 {
        body.push(1);
        body.resize(body.len().next_multiple_of(4), 0);
        body.extend(3000u32.to_le_bytes());
        body.resize(body.len() + 3000, 2);
    }
    message.extend(body);
    let bytes = mcap_file("/a", schema, &[message], Some(Compression::Zstd));
    let bag = Bag::open(file(dir.path(), "wide.mcap", &bytes)).unwrap();
    for format in [TableFormat::Csv, TableFormat::Parquet] {
        let mut made = None;
        let memory = measure(|| {
            made = Some(
                convert(
                    &bag,
                    &dir.path().join(format!("{format:?}")),
                    format,
                    |_| true,
                )
                .unwrap(),
            );
        });
        let table = &made.unwrap().tables[0];
        assert_eq!((table.rows, table.cut), (1, 1));
        assert!(
            (1000..=MOST_COLUMNS + 2).contains(&table.columns),
            "{}",
            table.columns
        );
        assert!(memory.bytes_max < 2 * MEMORY, "{} bytes", memory.bytes_max);
    }
}

#[test]
fn topics_whose_files_would_be_the_same_or_invalid_are_all_converted() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bag");
    let mut writer = Writer::create(&path, WriterOptions::default()).unwrap();
    let long = format!("/{}", "y".repeat(5000));
    let names = ["/a/b", "/a__b", "/..", "/a\0b", "/%2F", long.as_str()];
    for name in names {
        let topic = RecordedTopic {
            name: name.into(),
            type_name: "a/msg/B".into(),
            encoding: "cdr".into(),
            schema_encoding: "ros2msg".into(),
            schema: b"uint8 x\n".to_vec(),
            type_hash: None,
            qos: Vec::new(),
        };
        let id = writer.add_described(topic).unwrap();
        writer.write_cdr(id, 1, 1, &[0, 1, 0, 0, 7]).unwrap();
    }
    writer.finish().unwrap();
    let bag = Bag::open(&path).unwrap();
    let tables = dir.path().join("tables");
    let made = convert(&bag, &tables, TableFormat::Csv, |_| true).unwrap();
    assert_eq!(made.tables.len(), names.len(), "{:?}", made.left_out);
    assert_eq!(fs::read_dir(&tables).unwrap().count(), names.len());
    assert!(made.tables.iter().all(|t| t.rows == 1));
}
