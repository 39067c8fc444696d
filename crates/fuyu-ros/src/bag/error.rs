//! Errors of reading and writing bags.

use std::io;
use std::path::{Path, PathBuf};

use crate::msg::cdr::CdrError;

/// Why a bag cannot be written or read. Each message names the bag and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The folder exists. Bags are never overwritten.
    #[error("bag {}: a file or folder of this name already exists; choose another name or move it away", .0.display())]
    Exists(PathBuf),
    /// No such file or folder.
    #[error("bag {}: no such file or folder", .0.display())]
    NotFound(PathBuf),
    /// A folder or file that is not a bag.
    #[error("bag {}: {what}", path.display())]
    NotABag {
        /// Path of the bag or file.
        path: PathBuf,
        /// What was found and what was expected.
        what: String,
    },
    /// A bag in an unsupported format.
    #[error("bag {}: {what}", path.display())]
    Unsupported {
        /// Path of the bag or file.
        path: PathBuf,
        /// What is not supported, and a remedy.
        what: String,
    },
    /// A file system error.
    #[error("bag {}: {source}", path.display())]
    Io {
        /// Path of the bag or file.
        path: PathBuf,
        /// The underlying error.
        source: io::Error,
    },
    /// An error of the MCAP library.
    #[error("bag {}: {source}", path.display())]
    Mcap {
        /// Path of the bag or file.
        path: PathBuf,
        /// The underlying error.
        source: mcap::McapError,
    },
    /// A topic has a different type than requested.
    #[error("bag topic {topic}: its type is {found}, but {expected} was requested")]
    Type {
        /// Topic.
        topic: String,
        /// Its type.
        found: String,
        /// The requested type.
        expected: String,
    },
    /// A message cannot be decoded.
    #[error("bag topic {topic}, message at {log_time} ns: {source}")]
    Decode {
        /// Topic.
        topic: String,
        /// When it was recorded \[ns\].
        log_time: u64,
        /// The decoding error.
        source: CdrError,
    },
    /// A topic was declared twice, with different types.
    #[error("bag topic {topic}: declared as {first} and again as {second}")]
    TopicConflict {
        /// Topic.
        topic: String,
        /// Type of the first declaration.
        first: String,
        /// Type of the second.
        second: String,
    },
    /// The recorder waits for space on a full disk.
    #[error("bag {}: waits for space on the disk: {problem}", path.display())]
    DiskFull {
        /// Path of the bag.
        path: PathBuf,
        /// The error of the operating system.
        problem: String,
    },
    /// The recorder's thread has ended early, which only a panic in it can cause.
    #[error("bag {}: the recording thread has ended early", .0.display())]
    ThreadGone(PathBuf),
}

impl BagError {
    pub(super) fn io(path: &Path) -> impl Fn(io::Error) -> Self {
        move |source| Self::Io {
            path: path.to_owned(),
            source,
        }
    }

    pub(super) fn mcap(path: &Path) -> impl Fn(mcap::McapError) -> Self {
        move |source| match source {
            // The text of `McapError::Io` hides that of the operating system.
            mcap::McapError::Io(source) => Self::io(path)(source),
            source => Self::Mcap {
                path: path.to_owned(),
                source,
            },
        }
    }
}
