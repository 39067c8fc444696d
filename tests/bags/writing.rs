//! Writing a bag and reading it back.

use fuyu::bag::{Bag, BagError, Compression, Durability, Recorder, Topic, Writer, WriterOptions};
use fuyu::msg::geometry_msgs::PoseStamped;
use fuyu::msg::sensor_msgs::JointState;
use fuyu::msg::std_msgs::String as Text;
use fuyu::ros::Qos;
use std::fs;

use crate::sample;

#[test]
fn what_is_written_is_read_back() {
    let dir = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let path = dir.path().join(format!("{compression:?}"));
        let options = WriterOptions {
            compression,
            chunk_size: 10_000,
            ..Default::default()
        };
        let recording = sample::write(&path, 500, options);
        let bag = Bag::open(&path).unwrap();
        let joints = bag.read::<JointState>("/joint_states").unwrap();
        assert_eq!(joints.len(), 500);
        for (i, m) in (0..).zip(&joints) {
            assert_eq!(m.log_time, sample::time(i));
            assert_eq!(m.message, sample::joint_state(i));
        }
        // Raw bytes of a known type decode as that type, with the time of sending kept.
        assert_eq!(bag.read::<PoseStamped>("/raw_pose").unwrap().len(), 50);
        let raw = bag
            .messages()
            .find(|m| m.topic.name == "/raw_pose")
            .unwrap();
        assert_eq!(raw.publish_time, sample::time(0) - 5);
        // An unknown type is there, byte for byte.
        let unknown: Vec<_> = bag
            .messages()
            .filter(|m| m.topic.name == "/unknown")
            .collect();
        assert_eq!(unknown.len(), 50);
        assert_eq!(unknown[3].data, [0, 1, 0, 0, 30]);
        assert_eq!(unknown[3].topic.type_name, "acme_msgs/msg/Gripper");

        let info = bag.info().unwrap();
        assert!(info.complete && info.has_metadata);
        assert_eq!(info.messages, recording.messages);
        assert_eq!(info.messages, bag.messages().count() as u64);
        assert_eq!(info.duration_ns(), 499 * 10_000_000);
        assert_eq!(info.compression, format!("{compression:?}").to_lowercase());
        assert_eq!(
            info.size + fs::metadata(path.join("metadata.yaml")).unwrap().len(),
            recording.size
        );
        let latched = info.topics.iter().find(|t| t.name == "/robot_description");
        assert_eq!(
            latched.unwrap().qos[0].durability,
            Durability::TransientLocal
        );
        let mut counts = recording.topics.clone();
        counts.sort();
        let found: Vec<_> = info
            .topics
            .iter()
            .map(|t| (t.name.clone(), t.count))
            .collect();
        assert_eq!(found, counts);
    }
}

#[test]
fn the_same_calls_give_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let files = ["a", "b"].map(|name| {
        // The bag's own name stands in its files: same name, other parent.
        let path = dir.path().join(name).join("run");
        sample::write(&path, 3000, WriterOptions::default());
        ["run_0.mcap", "metadata.yaml"].map(|f| fs::read(path.join(f)).unwrap())
    });
    assert!(
        files[0] == files[1],
        "two writers of the same messages differ"
    );
}

#[test]
fn a_name_that_is_taken_is_refused_and_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run");
    sample::write(&path, 10, WriterOptions::default());
    let before = fs::read(path.join("run_0.mcap")).unwrap();
    let error = Writer::create(&path, WriterOptions::default())
        .err()
        .unwrap();
    assert!(matches!(error, BagError::Exists(_)), "{error}");
    assert!(error.to_string().contains("choose another name"), "{error}");
    assert_eq!(fs::read(path.join("run_0.mcap")).unwrap(), before);
    // Neither an existing file nor an existing empty folder is used.
    for (name, make) in [
        (
            "file",
            (|p| fs::write(p, "mine")) as fn(&std::path::Path) -> _,
        ),
        ("empty", |p| fs::create_dir(p)),
    ] {
        let taken = dir.path().join(name);
        make(&taken).unwrap();
        assert!(matches!(
            Writer::create(&taken, WriterOptions::default()),
            Err(BagError::Exists(_))
        ));
    }
}

#[test]
fn a_topic_has_one_type() {
    let dir = tempfile::tempdir().unwrap();
    let mut w = Writer::create(dir.path().join("run"), WriterOptions::default()).unwrap();
    let first = w.add_topic(Topic::of::<Text>("/t", Qos::RELIABLE)).unwrap();
    assert_eq!(
        first,
        w.add_topic(Topic::of::<Text>("/t", Qos::LATCHED)).unwrap()
    );
    let error = w
        .add_topic(Topic::of::<JointState>("/t", Qos::RELIABLE))
        .unwrap_err();
    assert!(error.to_string().contains("std_msgs/msg/String"), "{error}");
    w.write_message(first, 0, &Text::default()).unwrap();
    w.finish().unwrap();
    let bag = Bag::open(dir.path().join("run")).unwrap();
    let error = bag.read::<JointState>("/t").unwrap_err();
    assert!(matches!(error, BagError::Type { .. }), "{error}");
}

#[test]
fn an_empty_bag_is_a_bag() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run");
    Writer::create(&path, WriterOptions::default())
        .unwrap()
        .finish()
        .unwrap();
    let info = Bag::open(&path).unwrap().info().unwrap();
    assert!(info.complete);
    assert_eq!((info.messages, info.start_ns), (0, None));
}

#[test]
fn four_threads_record_without_loss() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run");
    let recorder =
        Recorder::start(Writer::create(&path, WriterOptions::default()).unwrap()).unwrap();
    const N: u64 = 20_000;
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let handle = recorder.handle();
            scope.spawn(move || {
                let topic = handle
                    .add_topic(Topic::of::<Text>(format!("/t{thread}"), Qos::RELIABLE))
                    .unwrap();
                let message = Text {
                    data: format!("message of thread {thread}"),
                };
                let bytes = fuyu::msg::cdr::encode(&message);
                for i in 0..N {
                    assert!(handle.write(&topic, i, i, bytes.clone()));
                }
            });
        }
    });
    let status = recorder.handle().status();
    assert_eq!((status.accepted, status.dropped), (4 * N, 0));
    let recording = recorder.finish().unwrap();
    assert_eq!((recording.messages, recording.dropped), (4 * N, 0));
    let info = Bag::open(&path).unwrap().info().unwrap();
    for topic in info.topics {
        assert_eq!(topic.count, N, "{}", topic.name);
    }
}

#[test]
fn what_does_not_fit_is_dropped_and_counted() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run");
    let writer = Writer::create(&path, WriterOptions::default()).unwrap();
    // Room for two of these at most.
    let recorder = Recorder::with_queue(writer, 2_000_000).unwrap();
    let handle = recorder.handle();
    let topic = handle
        .add_topic(Topic::of::<Text>("/t", Qos::RELIABLE))
        .unwrap();
    let big = bytes::Bytes::from(fuyu::msg::cdr::encode(&Text {
        data: "x".repeat(900_000),
    }));
    let sent = (0..200)
        .filter(|&i| handle.write(&topic, i, i, big.clone()))
        .count() as u64;
    assert!(sent < 200, "the writer cannot be as fast as this");
    let recording = recorder.finish().unwrap();
    assert_eq!(recording.messages, sent);
    assert_eq!(recording.dropped, 200 - sent);
    // And the handle that outlives the recorder says so, too.
    assert!(!handle.write(&topic, 0, 0, big));
    assert!(handle.flush().is_err());
}
