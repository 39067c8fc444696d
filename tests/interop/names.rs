//! Two nodes with the same name.

use std::process::Command;

use crate::child::{Running, executable};

fn echo(name: &str, namespace: &str) -> Running {
    let (name, namespace) = (format!("__node:={name}"), format!("__ns:={namespace}"));
    let args = ["--ros-args", "-r", &name, "-r", &namespace];
    Running::program(Command::new(executable()), "echo", 15, &args)
}

const WARNING: &str = "another node of this name is in the graph";

// Fails when a node of the same name is not detected, or when a node counts itself or another one as such.
#[test]
fn a_node_of_the_same_name_causes_a_warning() {
    let first = echo("twin", "/");
    let other = echo("twin", "/elsewhere");
    first.says("echoes");
    other.says("echoes");
    let second = echo("twin", "/");
    first.says(WARNING);
    second.says(WARNING);
    // The node of the same name in another namespace has caused no warning.
    assert!(!other.said().contains(WARNING), "{}", other.said());
    let said = first.interrupt();
    assert_eq!(said.matches(WARNING).count(), 1, "{said}");
    second.interrupt();
    other.interrupt();
}
