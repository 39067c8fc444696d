//! Bags of several files, and recording at 20 MB/s without loss.

use std::fs;
use std::time::{Duration, Instant};

use bytes::Bytes;
use fuyu::bag::{Bag, Recorder, Topic, Writer, WriterOptions};
use fuyu::msg::sensor_msgs::JointState;
use fuyu::ros::Qos;

use crate::{lateness::repeat_if_late, measuring::worst_below, sample, scripts};

/// Writes a bag with 300 joint states over 3 s, and other messages.
fn write(folder: &std::path::Path, options: WriterOptions) -> Bag {
    sample::write(folder, 300, options);
    Bag::open(folder).unwrap()
}

fn file_names(bag: &Bag) -> Vec<String> {
    let name = |p: &std::path::PathBuf| p.file_name().unwrap().to_str().unwrap().to_owned();
    bag.files().iter().map(name).collect()
}

#[test]
fn a_bag_is_split_by_time() {
    let dir = tempfile::tempdir().unwrap();
    let options = WriterOptions {
        max_duration: Some(Duration::from_secs(1)),
        ..WriterOptions::default()
    };
    let bag = write(&dir.path().join("run"), options);
    assert_eq!(file_names(&bag), ["run_0.mcap", "run_1.mcap", "run_2.mcap"]);
    for (i, file) in (0..).zip(bag.files()) {
        let joints = Bag::open(file)
            .unwrap()
            .read::<JointState>("/joint_states")
            .unwrap();
        assert_eq!(joints.len(), 100);
        assert_eq!(joints[0].log_time, sample::time(100 * i));
    }
    let info = bag.info().unwrap();
    assert!(info.complete && info.has_metadata);
    let joints = bag.read::<JointState>("/joint_states").unwrap();
    assert_eq!(joints.len(), 300);

    // The metadata describe the whole bag and each of its files, as those of rosbag2 do.
    let text = fs::read_to_string(bag.path().join("metadata.yaml")).unwrap();
    let yaml: serde_json::Value = serde_saphyr::from_str(&text).unwrap();
    let yaml = &yaml["rosbag2_bagfile_information"];
    assert_eq!(yaml["relative_file_paths"][2], "run_2.mcap");
    assert_eq!(yaml["message_count"], info.messages);
    let counts: u64 = yaml["files"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| f["message_count"].as_u64().unwrap())
        .sum();
    assert_eq!(counts, info.messages);
    let second = &yaml["files"][1]["starting_time"]["nanoseconds_since_epoch"];
    assert_eq!(*second, sample::time(100));
}

#[test]
fn a_bag_is_split_by_size_and_others_read_all_of_it() {
    let dir = tempfile::tempdir().unwrap();
    let options = WriterOptions {
        chunk_size: 4000,
        max_size: Some(8_000),
        ..WriterOptions::default()
    };
    let bag = write(&dir.path().join("run"), options);
    assert!(bag.files().len() >= 3, "{:?}", bag.files());
    let (last, full) = bag.files().split_last().unwrap();
    for file in full {
        let size = fs::metadata(file).unwrap().len();
        // The limit does not include the last chunk, the index and the schemas.
        assert!((8_000..40_000).contains(&size), "{size} bytes");
    }
    assert!(fs::metadata(last).unwrap().len() > 0);
    let joints = bag.read::<JointState>("/joint_states").unwrap();
    assert_eq!(joints.len(), 300);
    // Read by independent libraries.
    let text = scripts::run("read_split_bag.py", &[bag.path().to_str().unwrap()], "");
    let counts: std::collections::BTreeMap<String, u64> = serde_json::from_str(&text).unwrap();
    for topic in bag.info().unwrap().topics {
        assert_eq!(
            counts.get(&topic.name),
            Some(&topic.count),
            "{}",
            topic.name
        );
    }
}

#[test]
fn nothing_is_dropped_at_20_megabytes_a_second() {
    // Images of noise, which cannot be compressed: 100 MB in 5 s, more than the queue holds.
    let mut noise = 1u64;
    let image: Vec<u8> = std::iter::repeat_with(|| {
        noise = noise
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (noise >> 56) as u8
    })
    .take(500_000)
    .collect();
    let image = Bytes::from(image);
    // Every recording must meet the limit, so the worst one is checked.
    let measure = || {
        let dir = tempfile::tempdir().unwrap();
        let writer = Writer::create(dir.path().join("run"), WriterOptions::default()).unwrap();
        let recorder = Recorder::start(writer).unwrap();
        let handle = recorder.handle();
        let topic = Topic::named("/noise", "acme_msgs/msg/Noise", Qos::SENSOR_DATA);
        let topic = handle.add_topic(topic).unwrap();
        let start = Instant::now();
        let mut deepest = 0;
        for i in 0..200u64 {
            let due = Duration::from_millis(25 * i);
            std::thread::sleep(due.saturating_sub(start.elapsed()));
            handle.write(&topic, i, i, image.clone());
            deepest = deepest.max(handle.status().queued_bytes);
        }
        let recording = recorder.finish().unwrap();
        println!("{:.1} MB waited at most", deepest as f64 * 1e-6);
        assert_eq!(recording.messages + recording.dropped, 200);
        recording.dropped as f64
    };
    repeat_if_late(|| {
        worst_below("messages dropped at 20 MB/s", 1.0, 2, measure);
    });
}
