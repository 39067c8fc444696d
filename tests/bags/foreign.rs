//! Bags written by another program: by `rosbags` in Python, in every variant that rosbag2 has.

use std::fs;
use std::process::Command;

use fuyu::bag::{Bag, BagError};

use crate::scripts;

#[test]
fn bags_of_others_are_read() {
    let dir = tempfile::tempdir().unwrap();
    scripts::run("write_bags.py", &[dir.path().to_str().unwrap()], "");
    for name in ["plain", "by_file", "by_message"] {
        let bag = Bag::open(dir.path().join(name)).unwrap();
        let info = bag.info().unwrap();
        assert!(info.damage.is_empty(), "{name}: {:?}", info.damage);
        assert_eq!(info.messages, 40, "{name}");
        let mut messages = bag.messages();
        for (i, m) in (0..).zip(messages.by_ref().filter(|m| m.topic.name == "/point")) {
            // CDR of geometry_msgs/Point: a header and three doubles.
            let x = f64::from_le_bytes(m.data[4..12].try_into().unwrap());
            assert_eq!(
                (x, m.log_time),
                (f64::from(i), 1_000_000 * (i as u64 + 1)),
                "{name}"
            );
        }
        assert_eq!(messages.damage(), [], "{name}");
    }
    // A type that fuyu does not know, from the schema in the bag.
    let tables = dir.path().join("tables");
    let output = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(["bag", "convert", "--to", "csv", "--output"])
        .args([&tables, &dir.path().join("by_file")])
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let table = fs::read_to_string(tables.join("gripper.csv")).unwrap();
    let mut lines = table.lines();
    assert_eq!(
        lines.next().unwrap(),
        "log_time,publish_time,name,open,fingers[0].force,fingers[1].force,fingers[2].force,code"
    );
    assert_eq!(
        lines.nth(3).unwrap(),
        "4000000,4000000,hand 3,true,0.0,1.5,3.0,0003ff"
    );

    // Without metadata.yaml.
    fs::remove_file(dir.path().join("plain/metadata.yaml")).unwrap();
    let info = Bag::open(dir.path().join("plain")).unwrap().info().unwrap();
    assert_eq!((info.messages, info.has_metadata), (40, false));

    // sqlite3 is not supported, and the error says so.
    let error = Bag::open(dir.path().join("sqlite")).unwrap_err();
    assert!(matches!(error, BagError::Unsupported { .. }), "{error}");
    assert!(error.to_string().contains("ros2 bag convert"), "{error}");
    fs::remove_file(dir.path().join("sqlite/metadata.yaml")).unwrap();
    let error = Bag::open(dir.path().join("sqlite")).unwrap_err();
    assert!(error.to_string().contains("sqlite3"), "{error}");
    let error = Bag::open(dir.path().join("sqlite/sqlite.db3")).unwrap_err();
    assert!(error.to_string().contains("sqlite3"), "{error}");
}
