//! `package.xml` agrees with `Cargo.toml`, and README.md and the justfile call what exists.

use roxmltree::Document;
use std::path::PathBuf;

use crate::sources::{read, sources};

/// Text of the elements called `name` directly below the root of a `package.xml`.
fn elements(xml: &str, name: &str) -> Vec<String> {
    let document = Document::parse(xml).expect("package.xml is well formed");
    let children = document.root_element().children();
    children
        .filter(|c| c.has_tag_name(name))
        .map(|c| c.text().unwrap_or_default().trim().to_owned())
        .collect()
}

#[test]
fn package_xml_says_what_cargo_toml_says() {
    let xml = read("package.xml");
    assert_eq!(elements(&xml, "name"), [env!("CARGO_PKG_NAME")]);
    assert_eq!(elements(&xml, "version"), [env!("CARGO_PKG_VERSION")]);
    assert_eq!(elements(&xml, "license"), [env!("CARGO_PKG_LICENSE")]);
    let document = Document::parse(&xml).unwrap();
    assert_eq!(document.root_element().attribute("format"), Some("3"));
    let build_type = document
        .descendants()
        .find(|n| n.has_tag_name("build_type"));
    assert_eq!(build_type.and_then(|n| n.text()), Some("ament_cargo"));
}

#[test]
fn both_packages_have_the_same_version() {
    let versions = |path| elements(&read(path), "version");
    assert_eq!(versions("msg/package.xml"), versions("package.xml"));
}

// Fails on a ROS package whose messages the nodes use without `exec_depend`, and the other way round.
#[test]
fn every_interface_package_that_the_nodes_use_is_a_dependency() {
    let mut used: Vec<String> = sources()
        .iter()
        .filter(|s| ["nodes", "ros"].contains(&s.module().as_str()))
        .flat_map(|s| interface_packages(&s.text))
        .collect();
    used.sort();
    used.dedup();
    assert_eq!(elements(&read("package.xml"), "exec_depend"), used);
}

/// Names of the modules of `fuyu::msg` that a text uses.
fn interface_packages(text: &str) -> Vec<String> {
    let modules = sources();
    let packages = modules
        .iter()
        .filter(|s| s.module() == "msg")
        // A file, or a folder, below msg.
        .filter_map(|s| s.path.iter().nth(1).map(PathBuf::from))
        .filter_map(|part| part.file_stem()?.to_str().map(str::to_owned))
        .filter(|name| name.contains('_') && name != "type_hash");
    let code: Vec<_> = text
        .lines()
        .filter(|l| !l.trim_start().starts_with("//"))
        .collect();
    let code = code.join("\n");
    packages
        .filter(|name| {
            code.contains(&format!("{name}::")) || code.contains(&format!("{name}/msg/"))
        })
        .collect()
}

#[test]
fn the_commands_of_the_readme_and_the_recipes_exist() {
    let recipes = read("justfile");
    let steps = read(".ci/run");
    for step in ["fmt", "lint", "doc", "slow", "colcon"] {
        assert!(recipes.contains(&format!("{step}: (step \"{step}\")")));
        assert!(steps.contains(&format!("\n{step}() {{")), "{step}");
    }
    assert!(recipes.contains("ci:\n    .ci/run\n"));
    let readme = read("README.md");
    for command in ["cargo run --release", "cargo test --release"] {
        assert!(readme.contains(command), "{command}");
    }
    assert!(steps.contains("  cargo test --locked --release --no-fail-fast 2>&1"));
}
