//! What can go wrong with a bag.

use std::io;
use std::path::{Path, PathBuf};

use crate::msg::cdr::CdrError;

/// Why a bag cannot be written or read. Every variant says which bag and what would be right.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The folder is there already. Bags are never overwritten.
    #[error("bag {}: there is something of this name already; choose another name or move it away", .0.display())]
    Exists(PathBuf),
    /// Nothing there.
    #[error("bag {}: no such file or folder", .0.display())]
    NotFound(PathBuf),
    /// A folder or file that is no bag.
    #[error("bag {}: {what}", path.display())]
    NotABag {
        /// Where.
        path: PathBuf,
        /// What is there, and what should be.
        what: String,
    },
    /// A bag of a kind that fuyu does not read.
    #[error("bag {}: {what}", path.display())]
    Unsupported {
        /// Where.
        path: PathBuf,
        /// What it uses, and what to do.
        what: String,
    },
    /// The file system refused.
    #[error("bag {}: {source}", path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// What it said.
        source: io::Error,
    },
    /// The MCAP library refused.
    #[error("bag {}: {source}", path.display())]
    Mcap {
        /// Where.
        path: PathBuf,
        /// What it said.
        source: mcap::McapError,
    },
    /// A topic carries another type than the one asked for.
    #[error("bag topic {topic}: it carries {found} where {expected} is needed")]
    Type {
        /// Topic.
        topic: String,
        /// Its type.
        found: String,
        /// The type asked for.
        expected: String,
    },
    /// A message does not decode.
    #[error("bag topic {topic}, message at {log_time} ns: {source}")]
    Decode {
        /// Topic.
        topic: String,
        /// When it was recorded \[ns\].
        log_time: u64,
        /// What is wrong with it.
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
    /// The recorder's thread has gone, which only a panic in it explains.
    #[error("bag {}: the recording thread has ended before its time", .0.display())]
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
        move |source| Self::Mcap {
            path: path.to_owned(),
            source,
        }
    }
}
