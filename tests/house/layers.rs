//! Imports run downward only. An import against the order of ARCHITECTURE.md fails here.

use crate::sources::sources;

const PHYSICS: [&str; 6] = [
    "spatial",
    "model",
    "dynamics",
    "control",
    "vision",
    "estimation",
];
const ROS: [&str; 3] = ["msg", "ros", "bag"];

/// What each module may use, the lowest first; itself is understood.
const LAYERS: [(&str, &[&[&str]]); 12] = [
    ("spatial", &[]),
    ("model", &[&["spatial"]]),
    ("dynamics", &[&["spatial", "model"]]),
    ("control", &[&["spatial", "model", "dynamics"]]),
    ("vision", &[&["spatial", "model", "dynamics"]]),
    (
        "estimation",
        &[&["spatial", "model", "dynamics", "control", "vision"]],
    ),
    ("msg", &[]),
    ("bag", &[&["msg", "ros"]]),
    ("ros", &[&["msg"]]),
    ("nodes", &[&PHYSICS, &ROS]),
    ("experiments", &[&PHYSICS, &ROS, &["nodes"]]),
    ("cli", &[&PHYSICS, &ROS, &["nodes", "experiments"]]),
];

const MODULES: usize = LAYERS.len();

#[test]
fn imports_run_downward_only() {
    let mut wrong = Vec::new();
    let mut seen = std::collections::BTreeSet::new();
    for source in sources() {
        let module = source.module();
        if ["lib", "main", "bin"].contains(&module.as_str()) {
            continue;
        }
        let Some((_, below)) = LAYERS.iter().find(|(name, _)| *name == module) else {
            wrong.push(format!("src/{} is in no layer", source.path.display()));
            continue;
        };
        for name in source.names_below("crate") {
            let is_module = LAYERS.iter().any(|(m, _)| *m == name);
            if is_module && name != module && !below.concat().contains(&name.as_str()) {
                wrong.push(format!("src/{} uses crate::{name}", source.path.display()));
            }
        }
        seen.insert(module);
    }
    assert_eq!(wrong, [""; 0]);
    assert_eq!(seen.len(), MODULES, "a layer has no source: {seen:?}");
}

#[test]
fn physics_knows_neither_ros_nor_files_nor_the_environment() {
    let mut wrong = Vec::new();
    for source in sources() {
        if !PHYSICS.contains(&source.module().as_str()) {
            continue;
        }
        let above = ["ros", "msg", "bag", "nodes", "experiments", "cli"];
        let outside = ["fs", "env", "net", "process"];
        for (root, forbidden) in [("crate", &above[..]), ("std", &outside[..])] {
            for name in source.names_below(root) {
                if forbidden.contains(&name.as_str()) {
                    wrong.push(format!("src/{} uses {root}::{name}", source.path.display()));
                }
            }
        }
    }
    assert_eq!(wrong, [""; 0]);
}

#[test]
fn messages_graph_and_bags_know_no_physics() {
    let mut wrong = Vec::new();
    for source in sources() {
        if !ROS.contains(&source.module().as_str()) {
            continue;
        }
        for name in source.names_below("crate") {
            if PHYSICS.contains(&name.as_str()) {
                wrong.push(format!("src/{} uses crate::{name}", source.path.display()));
            }
        }
        if source.text.contains("nalgebra") {
            wrong.push(format!("src/{} names nalgebra", source.path.display()));
        }
    }
    assert_eq!(wrong, [""; 0]);
}

#[test]
fn no_file_is_longer_than_600_lines() {
    let long: Vec<_> = sources()
        .iter()
        .map(|s| (s.text.lines().count(), s.path.display().to_string()))
        .filter(|(lines, _)| *lines > 600)
        .collect();
    assert_eq!(long, []);
}
