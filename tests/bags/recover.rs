//! `fuyu bag recover`: a complete bag of a broken one.

use std::fs::{self, OpenOptions};
use std::path::Path;
use std::process::{Command, Output};
use std::time::Duration;

use fuyu::bag::{Bag, WriterOptions};
use fuyu::msg::sensor_msgs::JointState;
use serde_json::Value;

use crate::{sample, scripts};

fn recover(bag: &Path, output: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(["bag", "recover", "--json"])
        .arg(bag)
        .arg("--output")
        .arg(output)
        .output()
        .unwrap()
}

#[test]
fn a_truncated_bag_of_two_files_is_recovered() {
    let dir = tempfile::tempdir().unwrap();
    let (broken, whole) = (dir.path().join("broken"), dir.path().join("whole"));
    let options = WriterOptions {
        chunk_size: 20_000,
        max_duration: Some(Duration::from_secs(5)),
        ..WriterOptions::default()
    };
    sample::write(&broken, 1000, options);
    // As a killed recorder leaves it, with an outdated list of files.
    let last = broken.join("broken_1.mcap");
    let size = fs::metadata(&last).unwrap().len();
    let file = OpenOptions::new().write(true).open(&last).unwrap();
    file.set_len(size / 2).unwrap();
    fs::write(
        broken.join("metadata.yaml"),
        "rosbag2_bagfile_information: [",
    )
    .unwrap();
    let before = fs::read(&last).unwrap();

    let output = recover(&broken, &whole);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["damage"].as_array().unwrap().len(), 1, "{report}");
    let what = report["damage"][0]["what"].as_str().unwrap();
    assert!(what.contains("ends inside a record"), "{what}");
    assert_eq!(
        fs::read(&last).unwrap(),
        before,
        "the broken bag has changed"
    );

    let bag = Bag::open(&whole).unwrap();
    let info = bag.info().unwrap();
    assert!(info.complete && info.has_metadata);
    assert_eq!(report["messages"], info.messages);
    let joints = bag.read::<JointState>("/joint_states").unwrap();
    assert!((500..1000).contains(&joints.len()), "{}", joints.len());
    for (i, m) in (0..).zip(&joints) {
        assert_eq!(
            (m.log_time, &m.message),
            (sample::time(i), &sample::joint_state(i))
        );
    }
    let original = Bag::open_files(&broken).unwrap().info().unwrap();
    assert_eq!(
        info.topics, original.topics,
        "types, hashes, QoS and counts"
    );
    // Independent readers read it.
    let text = scripts::run("read_split_bag.py", &[whole.to_str().unwrap()], "");
    let counts: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(counts["/joint_states"], joints.len());
}

#[test]
fn a_whole_bag_is_copied_and_nothing_is_lost() {
    let dir = tempfile::tempdir().unwrap();
    let (bag, copy) = (dir.path().join("bag"), dir.path().join("copy"));
    sample::write(&bag, 50, WriterOptions::default());
    let output = recover(&bag, &copy);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["damage"], Value::Array(Vec::new()));
    let all = |path: &Path| {
        let messages = Bag::open(path).unwrap().messages();
        messages
            .map(|m| (m.topic.name.clone(), m.log_time, m.publish_time, m.data))
            .collect::<Vec<_>>()
    };
    assert!(all(&bag) == all(&copy));
    // Existing files are not overwritten.
    let again = recover(&bag, &copy);
    assert_eq!(again.status.code(), Some(2));
}
