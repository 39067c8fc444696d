//! A wall clock that a test can set for one process, with a library between the process and the C library.

use std::{
    fs::{File, OpenOptions},
    os::unix::fs::FileExt,
    path::PathBuf,
    process::Command,
};
use tempfile::TempDir;

/// Sets the wall clock of processes.
pub struct WallClock {
    folder: TempDir,
    shift: File,
}

/// Environment variable with the path of the file with the shift.
pub const SHIFT: &str = "WALL_CLOCK_SHIFT";

impl WallClock {
    /// Compiles the library.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/support/wall_clock.c");
        let compiled = Command::new("cc")
            .args(["-shared", "-fPIC", "-O2", "-o"])
            .arg(folder.path().join("wall_clock.so"))
            .arg(source)
            .status();
        assert!(compiled.expect("a C compiler").success(), "{source}");
        let shift = File::create(folder.path().join("shift")).expect("a file");
        let clock = Self { folder, shift };
        clock.shift(0);
        clock
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Lets a command have this clock.
    pub fn set_for(&self, command: &mut Command) {
        command
            .env("LD_PRELOAD", self.path("wall_clock.so"))
            .env(SHIFT, self.path("shift"));
    }

    /// Sets it to the computer's plus `seconds`.
    pub fn shift(&self, seconds: i64) {
        let written = self.shift.write_all_at(&seconds.to_ne_bytes(), 0);
        written.expect("the shift can be written");
    }
}

/// Sets the wall clock of this process, which was started with one.
pub fn shift_own(seconds: i64) {
    let path = std::env::var_os(SHIFT).expect("started with a clock");
    let file = OpenOptions::new().write(true).open(path).expect("a file");
    let written = file.write_all_at(&seconds.to_ne_bytes(), 0);
    written.expect("the shift can be written");
}
