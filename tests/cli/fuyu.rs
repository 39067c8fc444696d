//! Runs the executable.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Exit code and output of one run of `fuyu`.
pub struct Run {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

/// Runs `fuyu` with `args` in the package's folder.
pub fn fuyu<S: AsRef<std::ffi::OsStr>>(args: &[S]) -> Run {
    let output = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(args)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("the executable that cargo built runs");
    Run {
        // Killed by a signal (an abort, a stack overflow) is no exit code.
        code: output.status.code().unwrap_or(-1),
        stdout: String::from_utf8(output.stdout).expect("stdout is UTF-8"),
        stderr: String::from_utf8(output.stderr).expect("stderr is UTF-8"),
    }
}

impl Run {
    /// The JSON object on stdout of a successful run.
    pub fn json(&self) -> serde_json::Value {
        assert_eq!((self.code, self.stderr.as_str()), (0, ""));
        serde_json::from_str(&self.stdout).expect("stdout is one JSON object")
    }

    /// The line on stderr of a run that refused its input.
    pub fn refusal(&self) -> &str {
        assert_eq!(
            (self.code, self.stdout.as_str()),
            (2, ""),
            "{}",
            self.stderr
        );
        let mut lines = self.stderr.lines();
        let line = lines.next().expect("a message on stderr");
        assert_eq!(lines.next(), None, "one line only: {}", self.stderr);
        line.strip_prefix("fuyu: error: ")
            .unwrap_or_else(|| panic!("no 'fuyu: error: ' before: {line}"))
    }
}

/// Writes `text` to `name` in a temporary folder that lives as long as the first result.
pub fn file(name: &str, text: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = Path::join(folder.path(), name);
    std::fs::write(&path, text).expect("a file in it");
    (folder, path)
}
