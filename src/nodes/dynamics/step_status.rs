//! A diagnostics status that is reported at every step.

use std::borrow::Cow;

use crate::ros::Status;

/// A [`Status`] that passes "ok" on only when its message changes or after a problem: reporting it at every step costs
/// one comparison and allocates nothing.
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

    /// All is well.
    pub fn ok(&mut self, message: impl Into<Cow<'static, str>>) {
        let message = message.into();
        if self.ok.as_ref() != Some(&message) {
            self.status.ok(message.clone());
            self.ok = Some(message);
        }
    }

    /// It works, but not as it should.
    pub fn warn(&mut self, message: impl Into<String>) {
        self.ok = None;
        self.status.warn(message);
    }

    /// It does not work.
    pub fn error(&mut self, message: impl Into<String>) {
        self.ok = None;
        self.status.error(message);
    }

    /// Sets a named value next to the message.
    pub fn set(&self, key: &str, value: impl ToString) {
        self.status.set(key, value);
    }
}
