//! A run in Foxglove, received by an independent client in Python.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::child_guard::ChildGuard;
use crate::peer::DomainClaim;
use crate::python;
use crate::waiting::{PATIENCE, eventually};

#[test]
fn foxglove_gets_every_topic_and_draws_on_the_image() {
    let domain = 8;
    let _claim = DomainClaim::new(domain);
    let dir = tempfile::tempdir().unwrap();
    let root = env!("CARGO_MANIFEST_DIR");
    let launch = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(["launch", "config/servicing.yaml", "--duration", "600"])
        // Any port that is free; the log says which.
        .args(["--foxglove=127.0.0.1:0", "--bag"])
        .arg(dir.path().join("bag"))
        .current_dir(root)
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env_remove("ROS_LOCALHOST_ONLY")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut launch = ChildGuard(launch);
    let mut lines = BufReader::new(launch.stderr.take().unwrap()).lines();
    let line = lines
        .by_ref()
        .map(Result::unwrap)
        .find(|line| line.contains("ws://"))
        .expect("the log says where");
    let address = line.split("ws://").nth(1).unwrap().trim().to_owned();
    // The process must not block on a full pipe.
    let rest = std::thread::spawn(move || lines.map_while(Result::ok).collect::<Vec<_>>());

    let interpreter = python::environment(
        "test-venv.sh",
        &["foxglove", "websockets", "mcap-ros2-support", "protobuf"],
    );
    let client = Command::new(interpreter)
        .arg(format!("{root}/tests/bags/foxglove_client.py"))
        .args([
            format!("ws://{address}").as_str(),
            "/robot_description",
            "/joint_states",
            "/tf",
            "/markers",
            "/controller/state",
            "/camera/annotations/tip",
            "/camera/annotations/background",
        ])
        .output()
        .unwrap();
    let sent = Command::new("kill")
        .args(["-INT", &launch.id().to_string()])
        .status();
    assert!(sent.unwrap().success());
    let status = eventually("the launch ends", PATIENCE, || launch.try_wait().unwrap());
    let log = rest.join().unwrap();
    assert!(status.success(), "{log:#?}");
    let report: Value = serde_json::from_slice(&client.stdout).unwrap_or_else(|e| {
        let said = String::from_utf8_lossy(&client.stderr);
        panic!("{e}: {said}\nthe launch: {log:#?}")
    });

    assert_eq!(report["subprotocol"], "foxglove.sdk.v1");
    assert_eq!(report["refused"], 400, "a client of another protocol");
    let of = |topic: &str| &report["messages"][topic];
    let urdf = of("/robot_description")["data"].as_str().unwrap();
    assert!(urdf.contains("<robot"), "{urdf}");
    assert_eq!(of("/joint_states")["position"].as_array().unwrap().len(), 6);
    assert!(!of("/tf")["transforms"].as_array().unwrap().is_empty());
    let groups: Vec<_> = of("/markers")["markers"]
        .as_array()
        .unwrap()
        .iter()
        .map(|m| m["ns"].as_str().unwrap())
        .collect();
    assert!(groups.contains(&"momentum"), "{groups:?}");
    assert!(of("/controller/state")["position_error_norm"].is_number());
    let text = &of("/camera/annotations/tip")["texts"][0];
    assert_eq!(text["text"], "tip");
    assert!(text["position"]["x"].is_number());
    // Viewers draw on nothing but an image; one as large as the camera's calibration says.
    let image = of("/camera/annotations/background");
    let pixels = image["data"].as_array().unwrap();
    assert_eq!([&image["width"], &image["height"]], [1024, 1024]);
    assert_eq!(pixels.len(), 1024 * 1024);
    assert!(
        report["time"].as_u64().unwrap() > 0,
        "simulated time is sent"
    );
}
