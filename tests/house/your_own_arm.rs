//! The walkthrough of `docs/robots.md` works as printed: an arm on a satellite, from its URDF to a goal.

use std::{fs, os::unix::fs::symlink, process::Command};

use serde_json::Value;

use crate::{
    first_hour::blocks,
    sources::{read, root},
};

/// The section of the document with the walkthrough.
fn walkthrough() -> String {
    let document = read("docs/robots.md");
    let (_, after) = document.split_once("\n## An arm on a satellite\n").unwrap();
    let (section, _) = after.split_once("\n## ").unwrap();
    section.to_owned()
}

// Fails when a command of the walkthrough exits with an error, a file that it promises is missing, the tip misses its goal, or
// a number that the text states is not what the program prints.
#[test]
fn every_command_of_the_walkthrough_works() {
    let text = walkthrough();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    symlink(root().join("urdf"), path("urdf")).unwrap();
    fs::create_dir(path("bags")).unwrap();
    for (language, name) in [("xml", "bags/bus.xml"), ("yaml", "bags/arm.yaml")] {
        let [only] = blocks(&text, language)[..] else {
            panic!("one block of {language}")
        };
        assert!(text.contains(&format!("`{name}`")), "{name}");
        fs::write(path(name), only).unwrap();
    }
    let commands = blocks(&text, "sh").join("\n");
    let fuyu = "cargo run --release --";
    assert!(commands.matches(fuyu).count() >= 6, "{commands}");
    let script = commands.replace(fuyu, concat!("timeout 300 ", env!("CARGO_BIN_EXE_fuyu")));
    let run = Command::new("bash")
        .args(["-eux", "-c", &script])
        .current_dir(folder.path())
        .env("ROS_DOMAIN_ID", "97")
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .output()
        .unwrap();
    let log = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{log}");
    let printed = String::from_utf8_lossy(&run.stdout);
    println!("{printed}");
    for expected in ["6 moving joints, base bus", "goal            reached with"] {
        assert!(printed.contains(expected), "no '{expected}' in: {printed}");
    }
    for picture in ["tip_error.png", "base_attitude.png", "joint_rates.png"] {
        let drawn = walk(&path("bags"), picture);
        assert!(drawn, "no {picture} of the run");
    }

    // The figures of the text.
    let config = path("bags/arm.yaml");
    let simulated = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .arg("simulate")
        .arg(config)
        .arg("--json")
        .output()
        .unwrap();
    let run: Value = serde_json::from_slice(&simulated.stdout).unwrap();
    let number = |key: &str| run[key].as_f64().unwrap_or_else(|| panic!("{key}: {run}"));
    assert!(number("tip_position_error") < 1e-3, "{run}");
    assert!(number("tip_attitude_error") < 1e-3, "{run}");
    let reached = format!("after {:.0} s", number("time_to_1cm"));
    assert!(text.contains(&reached), "the text does not say '{reached}'");
    let turn = run["base_attitude_rpy"].as_array().unwrap().iter();
    let turn = turn.map(|a| a.as_f64().unwrap().powi(2)).sum::<f64>();
    let turn = format!("{:.1}°", turn.sqrt().to_degrees());
    assert!(text.contains(&turn), "the text does not say '{turn}'");
}

/// Whether a file called `name` is in `folder` or below it.
fn walk(folder: &std::path::Path, name: &str) -> bool {
    fs::read_dir(folder).unwrap().any(|entry| {
        let path = entry.unwrap().path();
        path.ends_with(name) || (path.is_dir() && walk(&path, name))
    })
}
