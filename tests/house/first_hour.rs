//! The tutorial `docs/first-hour.md` works as printed: its programs are saved and its commands are run, in order.

use std::{fs, os::unix::fs::symlink, process::Command};

use crate::{
    readme::python,
    sources::{read, root},
};

/// The code blocks of a language in a Markdown text, in order.
pub fn blocks<'a>(text: &'a str, language: &str) -> Vec<&'a str> {
    let fence = format!("```{language}\n");
    let after = text.split(fence.as_str()).skip(1);
    after
        .map(|rest| rest.split("\n```").next().unwrap())
        .collect()
}

// Fails when a command of the tutorial exits with an error, a file that it promises is missing, or an
// option or topic that it uses has been renamed.
#[test]
fn every_command_of_the_tutorial_works() {
    let tutorial = read("docs/first-hour.md");
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for shared in ["config", "urdf", "views"] {
        symlink(root().join(shared), path(shared)).unwrap();
    }
    fs::create_dir(path("bags")).unwrap();
    let programs = blocks(&tutorial, "python");
    for (name, program) in ["steer.py", "controller.py"].iter().zip(&programs) {
        assert!(tutorial.contains(&format!("`{name}`")), "{name}");
        fs::write(path(name), program).unwrap();
    }
    assert_eq!(programs.len(), 2, "a program has no name here");

    // The same shell for all, as for a reader: `python3` and cargo's runner are those of this test.
    let commands = blocks(&tutorial, "sh").join("\n");
    let fuyu = "cargo run --release --";
    let count = commands.matches(fuyu).count();
    assert!(count >= 10, "only {count} commands found");
    let script = commands
        .replace(fuyu, concat!("timeout 300 ", env!("CARGO_BIN_EXE_fuyu")))
        .replace("python3 ", &format!("timeout 300 {} ", python()));
    let run = Command::new("bash")
        .args(["-euxm", "-c", &script])
        .current_dir(folder.path())
        .env("ROS_DOMAIN_ID", "98")
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .output()
        .unwrap();
    let log = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{log}");

    for bag in ["first", "viewed", "steered", "mine"] {
        let metadata = path("bags").join(bag).join("metadata.yaml");
        assert!(metadata.exists(), "bags/{bag} was not written: {log}");
    }
    let printed = String::from_utf8_lossy(&run.stdout);
    for expected in ["tip position error", "/joint_commands", "momentum"] {
        assert!(printed.contains(expected), "no '{expected}' in: {printed}");
    }
}
