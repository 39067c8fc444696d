//! The documents against the sources.

#[cfg(feature = "ros")]
use std::collections::BTreeSet;

#[cfg(feature = "ros")]
use fuyu::nodes::{
    NODES,
    topics::{self, Declaration},
};

use crate::sources::{read, root};
#[cfg(feature = "ros")]
use crate::{
    generated::{cell, check_table},
    sources::sources,
};

/// The nodes whose sources the declarations are compared with. The recorder takes any topic.
#[cfg(feature = "ros")]
const CHECKED: [&str; 9] = [
    "dynamics",
    "camera",
    "controller",
    "attitude",
    "estimator",
    "mission",
    "tracker",
    "teleop",
    "views",
];

/// `node writes topic` and `node reads topic`, as declared.
#[cfg(feature = "ros")]
fn declared() -> BTreeSet<String> {
    let mut endpoints = BTreeSet::new();
    for topic in topics::declarations() {
        for (nodes, verb) in [(topic.writers, "writes"), (topic.readers, "reads")] {
            let nodes = nodes.iter().filter(|node| CHECKED.contains(node));
            endpoints.extend(nodes.map(|node| format!("{node} {verb} {}", topic.name)));
        }
    }
    endpoints
}

/// The topics in calls of a method in `text`: `topics::NAME.method(` or `.method("name"`.
#[cfg(feature = "ros")]
fn called(text: &str, method: &str) -> Vec<String> {
    let declarations = topics::declarations();
    let name_of = |constant: &str| {
        let topic = declarations.iter().find(|t| t.constant == constant)?;
        Some(topic.name.to_owned())
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

/// `node writes topic` and `node reads topic`, from the sources of the nodes.
#[cfg(feature = "ros")]
fn implemented() -> BTreeSet<String> {
    let mut endpoints = BTreeSet::new();
    for source in sources().iter().filter(|s| s.module() == "nodes") {
        let path = source.path.to_string_lossy();
        let folder = CHECKED
            .iter()
            .filter(|node| path.contains(&format!("nodes/{node}/")));
        let nodes: Vec<_> = match path.ends_with("nodes/robot_description.rs") {
            // Shared by the nodes that subscribe to the robot's description.
            true => vec!["attitude", "camera", "controller", "mission", "teleop"],
            false => folder.copied().collect(),
        };
        for (method, verb) in [
            ("advertise", "writes"),
            // Topics of a camera are advertised by name.
            ("of_camera", "writes"),
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

// Would break if a node gained or lost a topic and `nodes/topics.rs` did not follow.
#[cfg(feature = "ros")]
#[test]
fn the_nodes_write_and_read_what_is_declared() {
    let (declared, implemented) = (declared(), implemented());
    let only = |a: &BTreeSet<String>, b: &BTreeSet<String>| -> Vec<String> {
        a.difference(b).cloned().collect()
    };
    let none: [String; 0] = [];
    assert_eq!(only(&declared, &implemented), none, "in no source");
    assert_eq!(only(&implemented, &declared), none, "not declared");
    assert!(implemented.len() >= 40, "the search finds too little");
}

/// Topic names as code, in one cell.
#[cfg(feature = "ros")]
fn names<'a>(topics: impl Iterator<Item = &'a Declaration>) -> String {
    cell(topics.map(|t| format!("`{}`", t.name)))
}

#[cfg(feature = "ros")]
#[test]
fn the_table_of_topics_is_the_declarations() {
    let row = |t: &Declaration| {
        [
            format!("`{}`", t.name),
            t.type_name.replace("/msg/", "/"),
            cell(t.writers),
            cell(t.readers),
            format!("`{}`", t.qos_name),
            t.description.trim().trim_end_matches('.').to_owned(),
        ]
    };
    let mut rows: Vec<_> = topics::declarations().iter().map(row).collect();
    // Declared in fuyu-ros: every node has it.
    rows.push(
        [
            "`diagnostics`",
            "diagnostic_msgs/DiagnosticArray",
            "every node, 1 Hz",
            "recorder",
            "`RELIABLE`",
            "Health of a node and its endpoints",
        ]
        .map(str::to_owned),
    );
    let head = [
        "topic",
        "type",
        "written by",
        "read by",
        "QoS",
        "what it contains",
    ];
    check_table("ARCHITECTURE.md", "", &head, &rows);
}

#[cfg(feature = "ros")]
#[test]
fn the_table_of_nodes_is_the_declarations() {
    let mut known: Vec<_> = NODES.iter().map(|(name, _)| *name).collect();
    known.sort_unstable();
    let mut described = [&CHECKED[..], &["recorder"]].concat();
    described.sort_unstable();
    assert_eq!(known, described);
    let topics = topics::declarations();
    let mut rows: Vec<_> = (CHECKED.iter())
        .map(|node| {
            let read = topics.iter().filter(|t| t.readers.contains(node));
            let written = topics.iter().filter(|t| t.writers.contains(node));
            [format!("[`{node}`]"), names(read), names(written)]
        })
        .collect();
    rows.push(["[`recorder`]", "any topic", "a bag"].map(str::to_owned));
    let head = ["node", "reads", "writes"];
    check_table("src/nodes/mod.rs", "//! ", &head, &rows);
}

#[cfg(feature = "ros")]
#[test]
fn the_table_of_published_results_is_that_of_the_command() {
    let results = fuyu::experiments::reproduce::ALL;
    let row = |r: &fuyu::experiments::reproduce::Reproduction| {
        [format!("`{}`", r.name), r.shows.to_owned()]
    };
    let rows: Vec<_> = results.iter().map(row).collect();
    check_table("docs/reproduced.md", "", &["name", "shows"], &rows);
}

// Fails if a topic of the graph gets another name and the rights of the roles keep the old one.
#[cfg(feature = "ros")]
#[test]
fn roles_may_publish_the_topics_of_their_nodes() {
    let rights = read("crates/fuyu-ros/src/keys/role.rs");
    let document = read("docs/security.md");
    let list = |constant: &str| -> Vec<String> {
        let (_, rest) = rights.split_once(constant).unwrap();
        let list = rest.split("];").next().unwrap();
        let names = list.split('"').skip(1).step_by(2);
        names.map(str::to_owned).collect()
    };
    let covers = |right: &String, topic: &str| match right.strip_suffix('*') {
        Some(beginning) => topic.starts_with(beginning),
        None => topic == right,
    };
    let declared = topics::declarations();
    let controllers = ["controller", "attitude", "estimator", "mission", "tracker"];
    let (control, inputs) = (list("const CONTROL"), list("const INPUTS"));
    for topic in declared
        .iter()
        .filter(|t| t.writers.iter().any(|w| controllers.contains(w)))
    {
        assert!(
            control.iter().any(|right| covers(right, topic.name)),
            "{}",
            topic.name
        );
    }
    // The drivers of sensors have the role of the robot, which may publish everything.
    let is_of_sensor = |name: &str| name.starts_with("camera/");
    let of_operators = declared.iter().filter(|t| t.writers.contains(&"you"));
    for topic in of_operators.filter(|t| !is_of_sensor(t.name)) {
        assert!(
            inputs.iter().any(|right| covers(right, topic.name)),
            "{}",
            topic.name
        );
    }
    for (role, rights) in [("controller", control), ("operator", inputs)] {
        let row = document
            .lines()
            .find(|line| line.starts_with(&format!("| `{role}`")));
        for right in rights {
            assert!(
                row.unwrap().contains(&format!("`{right}`")),
                "{role}: {right}"
            );
            let is_of_every_managed_node = right.ends_with("/transition_event");
            let is_declared = declared.iter().any(|t| covers(&right, t.name));
            assert!(
                is_declared || is_of_every_managed_node,
                "{role}: no node has {right}"
            );
        }
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
