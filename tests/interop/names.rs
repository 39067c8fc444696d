//! Two nodes of one name.

use std::process::Command;

use crate::child::{Running, executable};

fn echo(name: &str, namespace: &str) -> Running {
    let (name, namespace) = (format!("__node:={name}"), format!("__ns:={namespace}"));
    let args = ["--ros-args", "-r", &name, "-r", &namespace];
    Running::program(Command::new(executable()), "echo", 15, &args)
}

const WARNING: &str = "another node of this name is in the graph";

// Breaks when a namesake is not noticed, or when a node takes itself or a neighbour for one.
#[test]
fn a_namesake_is_warned_of() {
    let first = echo("twin", "/");
    let other = echo("twin", "/elsewhere");
    first.says("echoes");
    other.says("echoes");
    let second = echo("twin", "/");
    first.says(WARNING);
    second.says(WARNING);
    // What was heard by now of the one below another namespace has been no reason.
    assert!(!other.said().contains(WARNING), "{}", other.said());
    let said = first.interrupt();
    assert_eq!(said.matches(WARNING).count(), 1, "{said}");
    second.interrupt();
    other.interrupt();
}
