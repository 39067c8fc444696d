//! Independent readers: `rosbags` and `mcap` with `mcap-ros2-support`, in Python.

use fuyu::bag::{Bag, Compression, WriterOptions};
use std::collections::BTreeMap;

use crate::{peer, python, sample};

/// Runs a script of this folder; returns what it prints.
pub fn run(script: &str, args: &[&str], input: &str) -> String {
    let path = format!("{}/tests/bags/{script}", env!("CARGO_MANIFEST_DIR"));
    let arguments = [&[path.as_str()], args].concat();
    python::run(&peer::python(), &arguments, input)
}

#[test]
fn python_decodes_every_message() {
    #[derive(serde::Deserialize)]
    struct Report {
        rosbags: BTreeMap<String, u64>,
        mcap: BTreeMap<String, u64>,
        undecoded: Vec<String>,
        last_position: Vec<f64>,
        durability: String,
        hash: String,
    }
    let dir = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let path = dir.path().join(format!("{compression:?}"));
        let options = WriterOptions {
            compression,
            chunk_size: 20_000,
            ..Default::default()
        };
        sample::write(&path, 1000, options);
        let text = run("read_bag.py", &[path.to_str().unwrap()], "");
        let report: Report = serde_json::from_str(&text).unwrap();
        let info = Bag::open(&path).unwrap().info().unwrap();
        let ours: BTreeMap<_, _> = info
            .topics
            .iter()
            .map(|t| (t.name.clone(), t.count))
            .collect();
        assert_eq!(report.rosbags, ours);
        assert_eq!(report.mcap, ours);
        assert_eq!(report.undecoded, ["/unknown"]);
        assert_eq!(report.last_position, sample::joint_state(999).position);
        assert_eq!(report.durability, "TRANSIENT_LOCAL");
        let joints = info
            .topics
            .iter()
            .find(|t| t.name == "/joint_states")
            .unwrap();
        assert_eq!(Some(report.hash), joints.type_hash);
    }
}
