//! Independent readers: `rosbags` and `mcap` with `mcap-ros2-support`, in Python.

use fuyu::bag::{Bag, Compression, WriterOptions};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use crate::sample;

/// Interpreter of the tests' virtual environment, made on first use.
fn interpreter() -> PathBuf {
    environment(&[])
}

/// Interpreter of a separate environment: its name and packages.
pub fn environment(packages: &[&str]) -> PathBuf {
    made_by("test-venv.sh", packages)
}

/// Interpreter of the environment that a script of `scripts/` makes.
fn made_by(script: &str, args: &[&str]) -> PathBuf {
    let output = Command::new(format!("{}/scripts/{script}", env!("CARGO_MANIFEST_DIR")))
        .args(args)
        .stderr(Stdio::inherit())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "scripts/{script} failed: see above"
    );
    String::from_utf8(output.stdout).unwrap().trim().into()
}

/// Builds the packages of interfaces that have no wheel into the virtual environment.
pub fn build_interfaces() {
    made_by("test-interfaces.sh", &[]);
}

/// Runs a script of this folder; returns what it prints.
pub fn run(script: &str, args: &[&str], input: &str) -> String {
    let path = format!("{}/tests/bags/{script}", env!("CARGO_MANIFEST_DIR"));
    let mut child = Command::new(interpreter())
        .arg(path)
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child
        .stdin
        .take()
        .unwrap()
        .write_all(input.as_bytes())
        .unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(
        output.status.success(),
        "{script} failed: see its words above"
    );
    String::from_utf8(output.stdout).unwrap()
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
