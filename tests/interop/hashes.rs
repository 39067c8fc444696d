//! Type hashes (RIHS01) of every type that fuyu knows, compared with those of rosidl: from the ROS 2 wheels on PyPI, or,
//! for packages without a wheel, built here from their definitions.

use fuyu::msg;
use serde_json::Value;
use std::{collections::BTreeMap, fs, path::Path};

use crate::python;

/// Type name to hash, of all interfaces in an environment.
fn rosidl(python: &Path) -> BTreeMap<String, String> {
    let share = python
        .ancestors()
        .nth(2)
        .expect("an environment")
        .join("share");
    let below = |folder: &Path| {
        let entries = fs::read_dir(folder).into_iter().flatten();
        entries
            .filter_map(|e| Some(e.ok()?.path()))
            .collect::<Vec<_>>()
    };
    let folders = below(&share)
        .into_iter()
        .flat_map(|package| ["msg", "srv", "action"].map(|kind| package.join(kind)));
    let files = folders.flat_map(|folder| below(&folder));
    let texts = files
        .filter(|file| file.extension().is_some_and(|e| e == "json"))
        .map(|file| fs::read_to_string(file).expect("text"));
    let mut hashes = BTreeMap::new();
    for text in texts {
        let description: Value = serde_json::from_str(&text).expect("JSON");
        for entry in description["type_hashes"].as_array().into_iter().flatten() {
            let field = |name: &str| entry[name].as_str().expect("text").to_owned();
            hashes.insert(field("type_name"), field("hash_string"));
        }
    }
    hashes
}

// Fails if a message of fuyu is added without a row in the matrix.
#[test]
fn every_message_of_fuyu_is_echoed() {
    let echoed = crate::echo::types();
    let ours = msg::definitions().filter(|d| d.package == "fuyu_msgs");
    let names: Vec<_> = ours.map(|d| d.type_name()).collect();
    assert!(names.len() >= 8, "{names:?}");
    for name in names {
        assert!(echoed.contains(&name), "{name}");
    }
}

// Fails if a hash differs from the one that other ROS nodes have for the type.
#[test]
fn hashes_are_those_of_rosidl() {
    for distribution in ["jazzy", "kilted"] {
        let theirs = rosidl(&python::environment("test-interfaces.sh", &[distribution]));
        let definitions = msg::definitions().chain(msg::service_definitions());
        let mut count = 0;
        for definition in definitions {
            let name = definition.type_name();
            assert_eq!(
                Some(&definition.type_hash()),
                theirs.get(&name),
                "{distribution} {name}"
            );
            count += 1;
        }
        println!("{count} hashes of {distribution}");
    }
}
