//! Reading files that a user or a peer names: regular files only, and no more than a given size.
//!
//! A named pipe would block the reader until somebody writes to it, and a device such as `/dev/zero` never ends.
//! Files are opened without blocking, and the size is limited while reading, because files below `/proc` and files that
//! grow are longer than their metadata say.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Take};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use nix::fcntl::OFlag;

/// Largest robot description \[bytes\].
pub const LARGEST_URDF: u64 = 16 << 20;
/// Largest parameter file or `metadata.yaml` \[bytes\].
pub const LARGEST_YAML: u64 = 16 << 20;
/// Largest table of observations \[bytes\].
pub const LARGEST_CSV: u64 = 256 << 20;

/// Why a file cannot be used as input. The message names the file.
#[derive(Debug, thiserror::Error)]
#[error("{}: {}", .path.display(), self.problem())]
pub struct InputFileError {
    path: PathBuf,
    kind: Problem,
}

#[derive(Debug)]
enum Problem {
    Io(io::Error),
    /// Not a regular file, but this: a folder, a named pipe or a device.
    Kind(&'static str),
    /// Larger than this \[bytes\].
    Size(u64),
    /// Offset of the first byte that is not UTF-8.
    Text(usize),
}

impl InputFileError {
    /// The message without the file's name.
    pub fn problem(&self) -> String {
        match &self.kind {
            Problem::Io(e) => format!("cannot be read: {e}"),
            Problem::Kind(kind) => format!("is {kind}; give a regular file"),
            Problem::Size(limit) => {
                format!(
                    "is larger than {}, the limit for such files",
                    in_words(*limit)
                )
            }
            Problem::Text(at) => format!("byte {at} is not UTF-8; a text file is needed"),
        }
    }

    /// Whether there is no such file.
    pub fn is_missing(&self) -> bool {
        matches!(&self.kind, Problem::Io(e) if e.kind() == io::ErrorKind::NotFound)
    }
}

fn in_words(bytes: u64) -> String {
    match bytes {
        b if b >= 1 << 20 => format!("{} MiB", b >> 20),
        b => format!("{b} bytes"),
    }
}

/// Opens the regular file `path` of at most `limit` bytes; reading ends one byte after the limit at the latest.
///
/// # Errors
/// [`InputFileError`] if it is missing, not a regular file, or larger.
pub fn open(path: &Path, limit: u64) -> Result<Take<File>, InputFileError> {
    open_regular(path, limit).map_err(|kind| named(path, kind))
}

/// The content of the regular file `path` of at most `limit` bytes.
///
/// # Errors
/// As [`open`].
pub fn read(path: &Path, limit: u64) -> Result<Vec<u8>, InputFileError> {
    let mut bytes = Vec::new();
    let mut file = open(path, limit)?;
    file.read_to_end(&mut bytes)
        .map_err(|e| named(path, Problem::Io(e)))?;
    match bytes.len() as u64 > limit {
        true => Err(named(path, Problem::Size(limit))),
        false => Ok(bytes),
    }
}

/// The text of the regular file `path` of at most `limit` bytes.
///
/// # Errors
/// As [`open`], and if it is not UTF-8.
pub fn read_text(path: &Path, limit: u64) -> Result<String, InputFileError> {
    String::from_utf8(read(path, limit)?)
        .map_err(|e| named(path, Problem::Text(e.utf8_error().valid_up_to())))
}

fn named(path: &Path, kind: Problem) -> InputFileError {
    InputFileError {
        path: path.to_owned(),
        kind,
    }
}

fn open_regular(path: &Path, limit: u64) -> Result<Take<File>, Problem> {
    // Without O_NONBLOCK, opening a named pipe waits for a writer.
    let flags = OFlag::O_NONBLOCK | OFlag::O_NOCTTY;
    let opened = OpenOptions::new()
        .read(true)
        .custom_flags(flags.bits())
        .open(path);
    let file = opened.map_err(Problem::Io)?;
    let metadata = file.metadata().map_err(Problem::Io)?;
    let kind = metadata.file_type();
    if !kind.is_file() {
        return Err(Problem::Kind(match kind {
            k if k.is_dir() => "a folder",
            k if k.is_fifo() => "a named pipe",
            k if k.is_socket() => "a socket",
            _ => "a device",
        }));
    }
    match metadata.len() > limit {
        true => Err(Problem::Size(limit)),
        false => Ok(file.take(limit.saturating_add(1))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(path: &Path, limit: u64) -> String {
        read_text(path, limit).unwrap_err().to_string()
    }

    #[test]
    fn devices_pipes_and_folders_are_refused_at_once() {
        let dir = tempfile::tempdir().unwrap();
        assert!(error(Path::new("/dev/zero"), 1 << 20).contains("is a device"));
        assert!(error(dir.path(), 100).contains("is a folder"));
        let pipe = dir.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        let start = std::time::Instant::now();
        assert!(error(&pipe, 100).contains("is a named pipe"));
        assert!(start.elapsed() < std::time::Duration::from_secs(1));
        assert!(error(&dir.path().join("none"), 100).contains("No such file"));
    }

    #[test]
    fn the_limit_is_inclusive_and_holds_where_the_size_is_not_known() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        std::fs::write(&file, "0123456789").unwrap();
        assert_eq!(read_text(&file, 10).unwrap(), "0123456789");
        assert!(error(&file, 9).contains("larger than 9 bytes"));
        // The metadata of this file give a size of zero bytes.
        assert!(error(Path::new("/proc/self/maps"), 20).contains("larger than 20 bytes"));
        std::fs::write(&file, b"abc\xff").unwrap();
        assert!(error(&file, 10).contains("byte 3"));
    }
}
