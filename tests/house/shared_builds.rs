//! `cargo run`, `cargo test` and the wheel of the Python package share what is compiled: they select the same features of
//! every dependency.

use std::collections::{BTreeMap, BTreeSet};

use crate::cargo_tree::cargo_tree;

/// Dependencies with their features. One may be there twice: for the program, and for macros.
fn features(args: &[&str]) -> BTreeMap<String, BTreeSet<String>> {
    let mut found = BTreeMap::<String, BTreeSet<String>>::new();
    for line in cargo_tree(&[&["--no-dedupe", "--format", "{p}|{f}"], args].concat()) {
        let (package, features) = line.split_once('|').unwrap_or((&line, ""));
        // `name v1.2.3`, without where a path dependency is.
        let name = package.split(' ').take(2).collect::<Vec<_>>().join(" ");
        let entry = found.entry(name).or_default();
        entry.insert(features.to_owned());
    }
    found
}

// Would break if a dependency of the tests or of the Python package turned on a feature of what every build compiles: then
// `cargo test` after `cargo run`, or the wheel after both, would compile it and all that uses it again, which takes
// minutes. Add the feature in Cargo.toml, where others are.
#[test]
fn run_test_and_wheel_select_the_same_features() {
    let run = features(&["--edges", "normal,build"]);
    for (what, edges, more) in [
        ("cargo test", "normal,build,dev", &[][..]),
        (
            "the wheel",
            "normal,build",
            &["--package", "fuyu-python"][..],
        ),
    ] {
        let other = features(&[&["--edges", edges], more].concat());
        assert!(other.len() > 100, "{what}: {} packages", other.len());
        for (package, selected) in &run {
            let Some(others) = other.get(package) else {
                continue;
            };
            assert_eq!(selected, others, "{package} in {what}");
        }
    }
}
