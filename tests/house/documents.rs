//! What the documents say beside what the sources do.

use std::collections::BTreeSet;

use crate::sources::{read, root, sources};

/// The rows of ARCHITECTURE.md's table of topics: topic, type, writers, readers, QoS.
fn table() -> Vec<[String; 5]> {
    let text = read("ARCHITECTURE.md");
    let rows = text
        .lines()
        .skip_while(|l| !l.starts_with("| topic | type |"));
    rows.skip(2)
        .take_while(|l| l.starts_with('|'))
        .map(|row| {
            let cells = row.trim_matches('|').split('|');
            let cells: Vec<_> = cells.map(|c| c.trim().replace('`', "")).collect();
            cells.try_into().expect("five cells a row")
        })
        .collect()
}

/// `node writes topic` and `node reads topic`, for the nodes that have fixed topics.
fn documented() -> BTreeSet<String> {
    let mut endpoints = BTreeSet::new();
    for [topic, _, writers, readers, _] in table() {
        for (nodes, verb) in [(writers, "writes"), (readers, "reads")] {
            for node in nodes.split(", ") {
                let fixed =
                    ["dynamics", "camera", "controller", "estimator", "teleop"].contains(&node);
                if fixed && !topic.contains("NAME") {
                    endpoints.insert(format!("{node} {verb} {topic}"));
                }
            }
        }
    }
    endpoints
}

/// The topics that a text names in calls of a method, as `topics::NAME.method(` or `.method("name"`.
fn called(text: &str, method: &str) -> Vec<String> {
    let constants = read("src/nodes/topics.rs");
    let name_of = |constant: &str| {
        let definition = constants.split_once(&format!("pub const {constant}: Topic"))?;
        definition.1.split('"').nth(1).map(str::to_owned)
    };
    let mut topics = Vec::new();
    for (at, call) in text.match_indices(&format!(".{method}(")) {
        let word = |c: char| c.is_ascii_uppercase() || c == '_';
        let before = &text[..at];
        let constant = &before[before.trim_end_matches(word).len()..];
        let literal = text[at + call.len()..].trim_start().strip_prefix('"');
        topics.extend(name_of(constant));
        topics.extend(literal.and_then(|l| l.split('"').next().map(str::to_owned)));
    }
    topics
}

/// The same from the sources of the nodes.
fn implemented() -> BTreeSet<String> {
    let mut endpoints = BTreeSet::new();
    for source in sources().iter().filter(|s| s.module() == "nodes") {
        let path = source.path.to_string_lossy();
        let nodes: &[&str] = match path.as_ref() {
            p if p.starts_with("nodes/dynamics") => &["dynamics"],
            p if p.starts_with("nodes/camera") => &["camera"],
            p if p.starts_with("nodes/controller") => &["controller"],
            p if p.starts_with("nodes/estimator") => &["estimator"],
            p if p.starts_with("nodes/teleop") => &["teleop"],
            // Shared by those who must know the robot.
            "nodes/robot_description.rs" => &["camera", "controller", "teleop"],
            _ => continue,
        };
        for (method, verb) in [
            ("advertise", "writes"),
            ("subscribe", "reads"),
            ("subscribe_deep", "reads"),
        ] {
            for topic in called(&source.text, method) {
                endpoints.extend(nodes.iter().map(|node| format!("{node} {verb} {topic}")));
            }
        }
    }
    endpoints
}

// A topic that a node gained or lost, or that changed its name, and ARCHITECTURE.md did not follow.
#[test]
fn the_nodes_write_and_read_what_the_table_says() {
    let (documented, implemented) = (documented(), implemented());
    let only = |a: &BTreeSet<String>, b: &BTreeSet<String>| -> Vec<String> {
        a.difference(b).cloned().collect()
    };
    let none: [String; 0] = [];
    assert_eq!(only(&documented, &implemented), none, "in no source");
    assert_eq!(only(&implemented, &documented), none, "in no table");
    assert!(implemented.len() >= 20, "the search has gone blind");
}

#[cfg(feature = "ros")]
#[test]
fn types_and_qos_are_those_of_the_table() {
    use fuyu::ros::Qos;

    let rows = table();
    for topic in fuyu::nodes::topics::all() {
        let row = rows.iter().find(|row| row[0] == topic.name);
        let row = row.unwrap_or_else(|| panic!("{} is not in the table", topic.name));
        assert_eq!(row[1], topic.type_name.replace("/msg/", "/"));
        let qos = match row[4].as_str() {
            "RELIABLE" => Qos::RELIABLE,
            "SENSOR_DATA" => Qos::SENSOR_DATA,
            "LATCHED" => Qos::LATCHED,
            "TF" => Qos::TF,
            "TF_STATIC" => Qos::TF_STATIC,
            "CLOCK" => Qos::CLOCK,
            other => panic!("{}: no Qos is called {other}", topic.name),
        };
        assert_eq!(qos, topic.qos, "{}", topic.name);
    }
}

#[test]
fn every_file_that_the_documents_link_to_exists() {
    for document in ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"] {
        let text = read(document);
        for link in text.split("](").skip(1) {
            let target = link.split([')', '#', ' ']).next().unwrap_or("");
            if !target.is_empty() && !target.contains("://") {
                assert!(root().join(target).exists(), "{document} links to {target}");
            }
        }
    }
}
