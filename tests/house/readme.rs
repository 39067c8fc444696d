//! The controller in README.md works as printed there.

use std::{fs, process::Command};

use serde_json::Value;

use crate::{
    python,
    sources::{read, root},
};

/// The Python of the tests' environment, which is made on first use.
pub fn python() -> String {
    let interpreter = python::environment("test-venv.sh", &[]);
    interpreter.into_os_string().into_string().unwrap()
}

/// A scenario without its node `controller`.
fn without_controller(scenario: &str) -> String {
    let mut kept = true;
    let lines = scenario.lines().filter(|line| {
        if !line.starts_with([' ', '#']) {
            kept = *line != "controller:";
        }
        kept
    });
    lines.map(|line| format!("{line}\n")).collect()
}

#[test]
fn the_controller_of_the_readme_drives_the_robot() {
    let folder = tempfile::tempdir().unwrap();
    let readme = read("README.md");
    let example = readme.split_once("```python\n").expect("an example").1;
    let example = example.split("```").next().unwrap();
    let script = folder.path().join("controller.py");
    fs::write(&script, example).unwrap();
    let scenario = folder.path().join("mine.yaml");
    fs::write(
        &scenario,
        without_controller(&read("config/positioning.yaml")),
    )
    .unwrap();
    let bag = folder.path().join("bag");

    let mut controller = Command::new(python())
        .arg(&script)
        .env("ROS_DOMAIN_ID", "100")
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .spawn()
        .unwrap();
    // Time stands still until the first command, so this ends only if one comes.
    let launched = Command::new("timeout")
        .args(["-k", "5", "300", env!("CARGO_BIN_EXE_fuyu"), "launch"])
        .arg(&scenario)
        .args(["--duration", "4", "--bag"])
        .arg(&bag)
        .env("ROS_DOMAIN_ID", "100")
        .env_remove("ROS_AUTOMATIC_DISCOVERY_RANGE")
        .current_dir(root())
        .output();
    controller.kill().unwrap();
    controller.wait().unwrap();
    let launched = launched.unwrap();
    let log = String::from_utf8_lossy(&launched.stderr);
    assert!(launched.status.success(), "{log}");

    let info = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(["bag", "info", "--json"])
        .arg(&bag)
        .output()
        .unwrap();
    let info: Value = serde_json::from_slice(&info.stdout).unwrap();
    let count = |name: &str| {
        let topics = info["topics"].as_array().expect("topics");
        let topic = topics.iter().find(|t| t["name"] == name);
        topic.map_or(0, |t| t["count"].as_u64().unwrap())
    };
    // 4 s at 100 Hz, and the states before the first command; a busy machine may lose a few answers.
    assert!(count("/joint_states") >= 400, "{info}");
    assert!(count("/joint_commands") >= 100, "{info}");
    assert_eq!(count("/controller/state"), 0, "fuyu's own controller ran");
}
