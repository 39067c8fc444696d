//! Bags: files, folders with `metadata.yaml`, and compressed ones.

use std::fs;
use std::path::Path;

use fuyu::bag::{Bag, Compression, TableFormat, Topic, Writer, WriterOptions, convert, recover};
use fuyu::experiments::{CheckLimits, check_bag};
use fuyu::msg::{sensor_msgs::JointState, std_msgs, tf2_msgs::TFMessage};
use fuyu::ros::Qos;

use crate::run::Target;

fn sample(path: &Path, compression: Compression) -> Vec<u8> {
    let options = WriterOptions {
        compression,
        chunk_size: 1500,
        ..WriterOptions::default()
    };
    let mut writer = Writer::create(path, options).unwrap();
    let joints = writer
        .add_topic(Topic::of::<JointState>("/joint_states", Qos::RELIABLE))
        .unwrap();
    let tf = writer
        .add_topic(Topic::of::<TFMessage>("/tf", Qos::RELIABLE))
        .unwrap();
    let text = writer
        .add_topic(Topic::of::<std_msgs::String>(
            "/robot_description",
            Qos::LATCHED,
        ))
        .unwrap();
    for i in 0..12 {
        let state = JointState {
            name: vec!["a".into(), "b".into()],
            position: vec![0.1 * i as f64; 2],
            velocity: vec![1.0; 2],
            ..JointState::default()
        };
        writer.write_message(joints, i * 10, &state).unwrap();
    }
    let transforms = TFMessage {
        transforms: vec![Default::default(); 2],
    };
    writer.write_message(tf, 200, &transforms).unwrap();
    let urdf = std_msgs::String {
        data: "<robot/>".into(),
    };
    writer.write_message(text, 300, &urdf).unwrap();
    writer.finish().unwrap();
    let name = path.file_name().unwrap().display();
    fs::read(path.join(format!("{name}_0.mcap"))).unwrap()
}

/// The file without the checksums of its chunks, so that their content can be changed.
fn without_checksums(mut bytes: Vec<u8>) -> Vec<u8> {
    const CHUNK: u8 = 6;
    let mut at = mcap::MAGIC.len();
    while let Some(header) = bytes.get(at..at + 9) {
        let (opcode, length) = (header[0], header[1..].try_into().unwrap());
        if opcode == CHUNK {
            bytes[at + 9 + 24..at + 9 + 28].fill(0);
        }
        at += 9 + u64::from_le_bytes(length) as usize;
    }
    bytes
}

#[test]
fn bags() {
    // In memory: recovering a bag syncs it to the disk.
    let memory = Path::new("/dev/shm");
    let dir = match memory.is_dir() {
        true => tempfile::tempdir_in(memory),
        false => tempfile::tempdir(),
    };
    let dir = dir.unwrap();
    let [none, lz4, zstd] = [Compression::None, Compression::Lz4, Compression::Zstd]
        .map(|c| without_checksums(sample(&dir.path().join(format!("{c:?}")), c)));
    let whole = zstd::bulk::compress(&none, 3).unwrap();
    let target = Target {
        name: "bags",
        corpus: vec![none, lz4, zstd, whole],
        words: &[
            "ros2msg",
            "cdr",
            "zstd",
            "lz4",
            "float64[] x\n",
            "/joint_states",
            "MSG: ",
            "rosbag2",
        ],
        // A chunk of 64 MiB as read, decompressed and as records.
        memory: 256 << 20,
    };
    let file = dir.path().join("input.mcap");
    let compressed = dir.path().join("input.mcap.zstd");
    let folder = dir.path().join("folder");
    fs::create_dir(&folder).unwrap();
    let metadata = "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  \
                    relative_file_paths: [a.mcap]\n  compression_format: zstd\n  compression_mode: message\n";
    fs::write(folder.join("metadata.yaml"), metadata).unwrap();
    target.run(|input| {
        fs::write(&file, input).unwrap();
        fs::write(&compressed, input).unwrap();
        fs::write(folder.join("a.mcap"), input).unwrap();
        for path in [&file, &compressed, &folder] {
            let Ok(bag) = Bag::open(path) else { continue };
            bag.messages().for_each(drop);
            let _ = bag.info();
            check_bag(&bag, &CheckLimits::default());
            let (tables, again) = (dir.path().join("tables"), dir.path().join("again"));
            let _ = convert(&bag, &tables, TableFormat::Csv, |_| true);
            let _ = recover(&bag, &again, WriterOptions::default());
            let _ = fs::remove_dir_all(tables);
            let _ = fs::remove_dir_all(again);
        }
    });
}
