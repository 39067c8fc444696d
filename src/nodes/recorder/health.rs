//! Diagnostics of the recorder.

use std::sync::Arc;

use super::recording_session::RecordingSession;
use crate::ros::{Node, Status};

/// Reports the state of the recording.
pub struct Health {
    session: Arc<RecordingSession>,
    status: Status,
    /// Whether a write failure has been logged.
    failed: bool,
    /// Whether a wait for disk space has been logged.
    waiting: bool,
}

impl Health {
    /// The status `bag` of the node's diagnostics.
    pub fn new(node: &Node, session: &Arc<RecordingSession>) -> Self {
        Self {
            session: Arc::clone(session),
            status: node.diagnostics().status("bag"),
            failed: false,
            waiting: false,
        }
    }

    /// Resets for a new recording.
    pub fn begin(&mut self) {
        self.failed = false;
    }

    /// Reports the current state.
    pub fn report(&mut self) {
        let Some(handle) = self.session.handle() else {
            self.status.ok("no recording in progress");
            return;
        };
        let recorded = handle.status();
        self.status.set("bag", handle.folder().display());
        self.status.set("files", recorded.files);
        self.status.set("messages", recorded.accepted);
        self.status.set("dropped", recorded.dropped);
        self.status.set("queued [bytes]", recorded.queued_bytes);
        for (topic, dropped) in &recorded.dropped_topics {
            self.status.set(&format!("dropped {topic}"), dropped);
        }
        if let Some(problem) = recorded.failure {
            if !self.failed {
                tracing::error!("recording has stopped: {problem}");
                self.failed = true;
            }
            self.status.error(problem);
            return;
        }
        if recorded.waiting.is_some() != self.waiting {
            self.waiting = recorded.waiting.is_some();
            match &recorded.waiting {
                Some(problem) => tracing::error!(
                    "recording waits for space on the disk: {problem}; messages are kept in memory up to {} bytes",
                    recorded.queue_capacity
                ),
                None => tracing::info!("recording continues"),
            }
        }
        match recorded.waiting {
            Some(problem) => self.status.error(format!(
                "waits for space on the disk: {problem}; {} bytes are queued, {} messages were dropped",
                recorded.queued_bytes, recorded.dropped
            )),
            None if recorded.dropped > 0 => {
                self.status.warn(format!(
                    "{} messages were dropped: the disk is too slow",
                    recorded.dropped
                ));
            }
            None if self.session.is_paused() => self.status.ok("paused"),
            None => self.status.ok("recording"),
        }
    }
}
