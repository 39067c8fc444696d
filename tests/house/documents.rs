//! What ARCHITECTURE.md says of the graph beside what the nodes do.

use std::collections::BTreeSet;

use crate::sources::{read, sources};

/// One endpoint: topic, node, whether it writes, name of the `Qos`.
type Endpoint = (String, String, bool, String);

/// The rows of the table of topics: topic, type, writers, readers, QoS.
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

/// The endpoints that the table gives to the nodes that have fixed ones.
fn documented() -> BTreeSet<Endpoint> {
    let mut endpoints = BTreeSet::new();
    for [topic, _, writers, readers, qos] in table() {
        for (nodes, writes) in [(writers, true), (readers, false)] {
            for node in nodes.split(", ") {
                let fixed = ["dynamics", "camera", "controller"].contains(&node);
                if fixed && !topic.contains("NAME") {
                    endpoints.insert((topic.clone(), node.to_owned(), writes, qos.clone()));
                }
            }
        }
    }
    endpoints
}

/// The calls `CALL("topic", Qos::NAME` in a text; a call without its own `Qos` has `default`.
fn calls(text: &str, call: &str, default: Option<&str>) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for (at, _) in text.match_indices(call) {
        let rest = &text[at + call.len()..];
        // Past a turbofish.
        let rest = match rest.strip_prefix("::<") {
            Some(generic) => &generic[generic.find('(').unwrap_or(0)..],
            None => rest,
        };
        let argument = rest.strip_prefix('(').unwrap_or("").trim_start();
        let Some((topic, rest)) = argument
            .strip_prefix('"')
            .and_then(|literal| literal.split_once('"'))
        else {
            continue;
        };
        let end = rest.find(')').unwrap_or(rest.len());
        let qos = rest[..end].split("Qos::").nth(1).map(|q| {
            let end = q.find(|c: char| !c.is_ascii_uppercase() && c != '_');
            &q[..end.unwrap_or(q.len())]
        });
        let qos = qos.or(default).expect("a call names its Qos");
        found.push((topic.to_owned(), qos.to_owned()));
    }
    found
}

/// The endpoints that the sources of the nodes make.
fn implemented() -> BTreeSet<Endpoint> {
    let mut endpoints = BTreeSet::new();
    for source in sources().iter().filter(|s| s.module() == "nodes") {
        let path = source.path.to_string_lossy();
        let nodes: &[&str] = match path.as_ref() {
            p if p.starts_with("nodes/dynamics/") => &["dynamics"],
            "nodes/camera.rs" => &["camera"],
            "nodes/controller.rs" => &["controller"],
            // Shared by those who must know the robot.
            "nodes/robot_description.rs" => &["camera", "controller"],
            _ => continue,
        };
        let written = calls(&source.text, ".advertise", None)
            .into_iter()
            .chain(calls(&source.text, "truth", Some("RELIABLE")))
            .map(|call| (call, true));
        let read = calls(&source.text, ".subscribe", None);
        for ((topic, qos), writes) in written.chain(read.into_iter().map(|call| (call, false))) {
            for node in nodes {
                endpoints.insert((topic.clone(), (*node).to_owned(), writes, qos.clone()));
            }
        }
    }
    endpoints
}

#[test]
fn the_table_of_topics_is_that_of_the_nodes() {
    let (documented, implemented) = (documented(), implemented());
    let only = |a: &BTreeSet<Endpoint>, b: &BTreeSet<Endpoint>| -> Vec<Endpoint> {
        a.difference(b).cloned().collect()
    };
    assert_eq!(
        only(&documented, &implemented),
        [],
        "only in ARCHITECTURE.md"
    );
    assert_eq!(only(&implemented, &documented), [], "only in src/nodes");
    assert!(implemented.len() >= 20, "the search has gone blind");
}

#[test]
fn the_recorder_knows_the_types_and_qos_of_the_table() {
    let recorder = read("src/nodes/recorder.rs");
    let known = recorder.split_once("const KNOWN").expect("KNOWN").1;
    let known = &known[..known.find("];").expect("its end")];
    let rows = table();
    let mut entries = 0;
    for entry in known
        .split('(')
        .skip(1)
        .filter(|e| e.trim_start().starts_with('"'))
    {
        let mut literals = entry.split('"').skip(1).step_by(2);
        let (topic, type_name) = (literals.next().unwrap(), literals.next().unwrap());
        let row = rows.iter().find(|row| row[0] == topic);
        let row = row.unwrap_or_else(|| panic!("{topic} is not in ARCHITECTURE.md"));
        assert_eq!(type_name.replace("/msg/", "/"), row[1], "{topic}");
        assert!(
            entry.contains(&format!("Qos::{}", row[4])),
            "{topic}: ARCHITECTURE.md says {}, the recorder {entry}",
            row[4]
        );
        entries += 1;
    }
    assert!(entries >= 10, "the search has gone blind");
}

#[test]
fn every_file_that_the_documents_link_to_exists() {
    for document in ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"] {
        let text = read(document);
        for link in text.split("](").skip(1) {
            let target = link.split([')', '#', ' ']).next().unwrap_or("");
            if !target.is_empty() && !target.contains("://") {
                let path = crate::sources::root().join(target);
                assert!(path.exists(), "{document} links to {target}");
            }
        }
    }
}
