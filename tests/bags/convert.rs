//! `fuyu bag convert`: tables of a bag, read by independent libraries.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use fuyu::bag::WriterOptions;
use serde_json::Value;

use crate::{python, sample};

fn fuyu(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .arg("bag")
        .args(args)
        .output()
        .unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn every_topic_becomes_a_csv_table() {
    let dir = tempfile::tempdir().unwrap();
    let (bag, tables) = (dir.path().join("run"), dir.path().join("tables"));
    sample::write(&bag, 30, WriterOptions::default());
    let args = [
        "convert",
        text(&bag),
        "--to",
        "csv",
        "--json",
        "--output",
        text(&tables),
    ];
    let output = fuyu(&args);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{errors}");
    // The unknown type has no table, and the output says so.
    assert!(
        errors.contains("/unknown is omitted: the bag contains no schema"),
        "{errors}"
    );
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let rows = |topic: &str| {
        let all = report["tables"].as_array().unwrap();
        all.iter().find(|t| t["topic"] == topic).unwrap()["rows"].clone()
    };
    assert_eq!((rows("/joint_states"), rows("/tf")), (30.into(), 3.into()));

    let mut reader = csv::Reader::from_path(tables.join("joint_states.csv")).unwrap();
    let header = reader.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|h| h == name).unwrap();
    assert_eq!((&header[0], &header[1]), ("log_time", "publish_time"));
    let records: Vec<_> = reader.records().map(Result::unwrap).collect();
    assert_eq!(records.len(), 30);
    for (i, record) in (0..).zip(&records) {
        let expected = sample::joint_state(i);
        assert_eq!(record[0], sample::time(i).to_string());
        assert_eq!(&record[column("name[1]")], "joint2");
        for (name, values) in [("position", expected.position), ("effort", expected.effort)] {
            for (j, value) in values.iter().enumerate() {
                let cell = &record[column(&format!("{name}[{j}]"))];
                // Bit-identical.
                assert_eq!(cell.parse::<f64>().unwrap(), *value);
            }
        }
    }
    assert!(tables.join("controller__state.csv").exists());
    let tf = fs::read_to_string(tables.join("tf.csv")).unwrap();
    assert!(
        tf.lines()
            .next()
            .unwrap()
            .contains("transforms[1].transform.rotation.w")
    );
    let text_of_robot = fs::read_to_string(tables.join("robot_description.csv")).unwrap();
    assert!(text_of_robot.contains("浮遊"), "{text_of_robot}");

    // Existing files are not overwritten.
    let again = fuyu(&args);
    assert_eq!(again.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&again.stderr).contains("already"));
}

#[test]
fn pyarrow_reads_the_parquet_tables() {
    let dir = tempfile::tempdir().unwrap();
    let (bag, tables) = (dir.path().join("run"), dir.path().join("tables"));
    sample::write(&bag, 30, WriterOptions::default());
    let output = fuyu(&[
        "convert",
        text(&bag),
        "--to",
        "parquet",
        "--output",
        text(&tables),
    ]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let interpreter = python::environment("test-venv.sh", &["tables", "pyarrow"]);
    let script = format!("{}/tests/bags/read_parquet.py", env!("CARGO_MANIFEST_DIR"));
    let read = Command::new(interpreter)
        .args([&script, text(&tables)])
        .output()
        .unwrap();
    let report: Value = serde_json::from_slice(&read.stdout)
        .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&read.stderr)));
    let joints = &report["joint_states"];
    assert_eq!(joints["rows"], 30);
    assert_eq!(joints["types"]["log_time"], "timestamp[ns, tz=UTC]");
    assert_eq!(joints["types"]["header.stamp.nanosec"], "uint64");
    assert_eq!(joints["types"]["position[1]"], "double");
    let last = sample::joint_state(29);
    assert_eq!(joints["last"]["position[1]"], last.position[1]);
    assert_eq!(joints["last"]["name[0]"], "joint1");
    assert_eq!(joints["last"]["log_time"], sample::time(29));
    assert_eq!(
        report["controller__state"]["types"]["position_saturated"],
        "bool"
    );
    // Lists that are shorter in one message leave the cell empty.
    assert_eq!(report["robot_description"]["rows"], 1);
}
