//! Python environments of the tests, and programs run in them.

use std::{
    io::Write,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
};

/// Interpreter of the environment that a script of `scripts/` makes on first use, and prints.
pub fn environment(script: &str, arguments: &[&str]) -> PathBuf {
    // A package below `crates/` uses the scripts of the repository.
    let mut folders = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    let path = folders.find_map(|folder| {
        let path = folder.join("scripts").join(script);
        path.is_file().then_some(path)
    });
    let mut command = Command::new(path.expect("the script exists"));
    let output = command.args(arguments).stderr(Stdio::inherit()).output();
    let output = output.expect("the script can be started");
    assert!(
        output.status.success(),
        "scripts/{script} failed, see above"
    );
    String::from_utf8_lossy(&output.stdout).trim().into()
}

/// Runs Python with this input; returns what it prints.
pub fn run(interpreter: &Path, arguments: &[&str], input: &str) -> String {
    let mut process = Command::new(interpreter)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("Python runs");
    let mut stdin = process.stdin.take().expect("its input is piped");
    let text = input.to_owned();
    // Python may print before it has read everything.
    let writer = thread::spawn(move || stdin.write_all(text.as_bytes()));
    let output = process.wait_with_output().expect("Python ends");
    writer
        .join()
        .expect("no panic")
        .expect("Python reads its input");
    assert!(output.status.success(), "python {arguments:?} failed");
    String::from_utf8(output.stdout).expect("Python prints UTF-8")
}
