//! Errors of transports.

use std::{any::Any, fmt, thread, thread::JoinHandle};

/// Why a session or an endpoint could not be created.
#[derive(Debug)]
pub(in crate::ros) enum TransportError {
    /// The session has deadlocked; a new session may work.
    Deadlocked(AbandonedSession),
    /// No file descriptors are left; the session is not affected.
    NoDescriptors(String),
    /// Any other error, as text.
    Other(String),
}

impl TransportError {
    pub(super) fn other(reason: impl fmt::Display) -> Self {
        Self::Other(reason.to_string())
    }

    /// Passes data of the session to the error, to be dropped once that cannot block.
    pub(super) fn abandoning(mut self, rest: impl Send + 'static) -> Self {
        match &mut self {
            Self::Deadlocked(stuck) => stuck.keep(rest),
            Self::Other(_) | Self::NoDescriptors(_) => drop(rest),
        }
        self
    }
}

impl fmt::Display for TransportError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Deadlocked(_) => write!(
                f,
                "the DDS participant did not respond in time: it has deadlocked"
            ),
            Self::NoDescriptors(reason) => {
                write!(f, "{reason}; raise the limit of open files (ulimit -n)")
            }
            Self::Other(reason) => f.write_str(reason),
        }
    }
}

/// A deadlocked session: the blocked thread, and objects whose drop would block too. They are dropped after the thread
/// has ended, which usually never happens.
#[derive(Debug, Default)]
pub(in crate::ros) struct AbandonedSession {
    maker: Option<JoinHandle<()>>,
    kept: Vec<Box<dyn Any + Send>>,
}

impl AbandonedSession {
    pub(super) fn blocking(maker: Option<JoinHandle<()>>) -> Self {
        Self {
            maker,
            kept: Vec::new(),
        }
    }

    pub(in crate::ros) fn keep(&mut self, rest: impl Send + 'static) {
        self.kept.push(Box::new(rest));
    }
}

impl Drop for AbandonedSession {
    fn drop(&mut self) {
        let (maker, kept) = (self.maker.take(), std::mem::take(&mut self.kept));
        if kept.is_empty() {
            return;
        }
        thread::spawn(move || {
            let _ = maker.map(JoinHandle::join);
            drop(kept);
        });
    }
}
