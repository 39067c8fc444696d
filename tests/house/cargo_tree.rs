//! What packages depend on, as cargo resolves it.

use std::process::Command;

/// Lines of `cargo tree` with these arguments, one per package.
pub fn cargo_tree(args: &[&str]) -> Vec<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--locked", "--offline", "--prefix", "none"])
        .args(args)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo can be started");
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo tree: {log}");
    let tree = String::from_utf8(output.stdout).expect("cargo tree prints text");
    tree.lines().map(str::to_owned).collect()
}
