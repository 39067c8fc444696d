//! A diagnostics status that is reported at every step.

use std::borrow::Cow;

use crate::ros::Status;

/// A [`Status`] for reports at every step: "ok" is passed on only if its message has changed, or after a problem. An
/// unchanged report costs one comparison and no allocation.
pub struct StepStatus {
    status: Status,
    /// Message of the last "ok", unless a problem was reported after it.
    ok: Option<Cow<'static, str>>,
}

impl StepStatus {
    /// Wraps a status that has not reported yet.
    pub fn new(status: Status) -> Self {
        Self { status, ok: None }
    }

    /// Reports that all is well.
    pub fn ok(&mut self, message: impl Into<Cow<'static, str>>) {
        let message = message.into();
        if self.ok.as_ref() != Some(&message) {
            self.status.ok(message.clone());
            self.ok = Some(message);
        }
    }

    /// Reports a problem that does not prevent operation.
    pub fn warn(&mut self, message: impl Into<String>) {
        self.ok = None;
        self.status.warn(message);
    }

    /// Reports a failure.
    pub fn error(&mut self, message: impl Into<String>) {
        self.ok = None;
        self.status.error(message);
    }

    /// Sets a named value next to the message.
    pub fn set(&self, key: &str, value: impl ToString) {
        self.status.set(key, value);
    }
}
