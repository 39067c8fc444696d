//! Health of a node, published once a second on `diagnostics`.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError, atomic::Ordering::Relaxed},
    time::Instant,
};

use super::{
    NodeName, Time,
    endpoint::{Counters, EndpointSpec, Endpoints},
};
use crate::msg::{
    Byte,
    diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue},
    std_msgs::Header,
};

#[derive(Debug, Clone)]
struct Entry {
    name: String,
    level: Byte,
    message: String,
    /// Whether a report has contained the present level and message.
    reported: bool,
    /// Worst level since the last report, with its message; `None` unless it is worse than the present level.
    worst: Option<(Byte, String)>,
    values: Vec<(String, String)>,
}

/// Health of the parts of a node. Clones share the state.
#[derive(Debug, Clone, Default)]
pub struct Diagnostics {
    entries: Arc<Mutex<Vec<Entry>>>,
}

impl Diagnostics {
    /// Adds a part, which is reported as `node: name`. Its initial level is OK.
    pub fn status(&self, name: &str) -> Status {
        let mut entries = self.lock();
        let known = entries.iter().position(|e| e.name == name);
        let index = known.unwrap_or_else(|| {
            entries.push(Entry {
                name: name.to_owned(),
                level: DiagnosticStatus::OK,
                message: String::new(),
                reported: false,
                worst: None,
                values: Vec::new(),
            });
            entries.len() - 1
        });
        drop(entries);
        Status {
            diagnostics: self.clone(),
            index,
        }
    }

    /// Present value of `key` of the part `name`.
    pub fn value(&self, name: &str, key: &str) -> Option<String> {
        let entries = self.lock();
        let entry = entries.iter().find(|e| e.name == name)?;
        let (_, value) = entry.values.iter().find(|(k, _)| k == key)?;
        Some(value.clone())
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Entry>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Status of each part with its worst level since the last call.
    fn statuses(&self, node: &NodeName) -> Vec<DiagnosticStatus> {
        let to_status = |e: &mut Entry| {
            e.reported = e.worst.is_none();
            let worst = e.worst.take();
            let (level, message) = worst.unwrap_or_else(|| (e.level, e.message.clone()));
            DiagnosticStatus {
                level,
                name: format!("{}: {}", node.full().trim_start_matches('/'), e.name),
                message,
                hardware_id: String::new(),
                values: e.values.iter().map(|(k, v)| pair(k, v)).collect(),
            }
        };
        self.lock().iter_mut().map(to_status).collect()
    }
}

/// Health of one part of a node. It may change at any rate: each report contains the worst level since the previous
/// report.
#[derive(Debug, Clone)]
pub struct Status {
    diagnostics: Diagnostics,
    index: usize,
}

impl Status {
    /// Level OK.
    pub fn ok(&self, message: impl Into<String>) {
        self.report(DiagnosticStatus::OK, message.into());
    }

    /// Level WARN: the part works with restrictions.
    pub fn warn(&self, message: impl Into<String>) {
        self.report(DiagnosticStatus::WARN, message.into());
    }

    /// Level ERROR: the part does not work.
    pub fn error(&self, message: impl Into<String>) {
        self.report(DiagnosticStatus::ERROR, message.into());
    }

    /// Sets a named value, shown next to the message.
    pub fn set(&self, key: &str, value: impl ToString) {
        let mut entries = self.diagnostics.lock();
        let values = &mut entries[self.index].values;
        match values.iter_mut().find(|(k, _)| k == key) {
            Some((_, v)) => *v = value.to_string(),
            None => values.push((key.to_owned(), value.to_string())),
        }
    }

    fn report(&self, level: Byte, message: String) {
        let mut entries = self.diagnostics.lock();
        let entry = &mut entries[self.index];
        let before = std::mem::replace(&mut entry.message, message);
        let level_before = std::mem::replace(&mut entry.level, level);
        let reported = std::mem::replace(&mut entry.reported, false);
        match &entry.worst {
            Some((worst, _)) if *worst <= level => entry.worst = None,
            None if level_before > level && !reported => entry.worst = Some((level_before, before)),
            _ => {}
        }
    }
}

fn pair(key: &str, value: &str) -> KeyValue {
    KeyValue {
        key: key.to_owned(),
        value: value.to_owned(),
    }
}

/// Builds the diagnostic reports of one node, including the counters of its endpoints.
pub(super) struct Reporter {
    /// Number of messages and of losses of each endpoint at the previous report.
    before: HashMap<String, (u64, u64)>,
    at: Instant,
}

impl Reporter {
    pub(super) fn new() -> Self {
        Self {
            before: HashMap::new(),
            at: Instant::now(),
        }
    }

    pub(super) fn report(
        &mut self,
        node: &Arc<NodeName>,
        stamp: Time,
        diagnostics: &Diagnostics,
        endpoints: &Endpoints,
    ) -> DiagnosticArray {
        let mut status = vec![self.communication(node, endpoints)];
        status.extend(diagnostics.statuses(node));
        DiagnosticArray {
            header: Header {
                stamp: stamp.into(),
                frame_id: String::new(),
            },
            status,
        }
    }

    /// Rates, ages and losses of all endpoints since the previous report.
    fn communication(&mut self, node: &Arc<NodeName>, endpoints: &Endpoints) -> DiagnosticStatus {
        let seconds = self.at.elapsed().as_secs_f64().max(1e-3);
        self.at = Instant::now();
        let mut values = Vec::new();
        let mut losing = Vec::new();
        let writers = endpoints.writers.iter();
        let writers = writers.filter(|w| Arc::ptr_eq(&w.node, node));
        let readers = endpoints.readers.iter();
        let readers = readers.filter(|r| Arc::ptr_eq(&r.node, node));
        let all = writers
            .map(|w| ("publishes", &w.spec, &w.counters))
            .chain(readers.map(|r| ("receives", &r.spec, &r.counters)));
        for (verb, spec, counters) in all {
            if !spec.internal {
                let lost = self.endpoint(verb, spec, counters, seconds, &mut values);
                if lost > 0 {
                    losing.push(format!("{} lost {lost}", spec.name));
                }
            }
        }
        let (level, message) = match losing.is_empty() {
            true => (DiagnosticStatus::OK, "all messages go through".to_owned()),
            false => (DiagnosticStatus::WARN, losing.join(", ")),
        };
        DiagnosticStatus {
            level,
            name: format!("{}: communication", node.full().trim_start_matches('/')),
            message,
            hardware_id: String::new(),
            values,
        }
    }

    fn endpoint(
        &mut self,
        verb: &str,
        spec: &EndpointSpec,
        counters: &Counters,
        seconds: f64,
        values: &mut Vec<KeyValue>,
    ) -> u64 {
        let key = format!("{verb} {}", spec.name);
        let messages = counters.messages.load(Relaxed);
        let lost = counters.lost();
        let (messages_before, lost_before) = self
            .before
            .insert(key.clone(), (messages, lost))
            .unwrap_or((0, 0));
        let rate = messages.saturating_sub(messages_before) as f64 / seconds;
        let mut push =
            |what: &str, value: String| values.push(pair(&format!("{key}: {what}"), &value));
        push("rate [Hz]", format!("{rate:.1}"));
        push("lost", lost.to_string());
        let replaced = counters.replaced.load(Relaxed);
        if replaced > 0 {
            push("replaced unread", replaced.to_string());
        }
        push("peers", counters.matched().to_string());
        let last = counters.last.load(Relaxed);
        if last != 0 {
            let age = Time::wall().since(Time::from_nanos(last)).as_secs_f64();
            push("age [s]", format!("{age:.3}"));
        }
        lost.saturating_sub(lost_before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Would break if a report contained only the current status, or repeated an old warning.
    #[test]
    fn a_short_warning_is_reported_once() {
        let node = NodeName::new("/", "arm").unwrap();
        let diagnostics = Diagnostics::default();
        let status = diagnostics.status("tip");
        let reported = || {
            let all = diagnostics.statuses(&node);
            (all[0].level, all[0].message.clone())
        };
        let (ok, warn, error) = (
            DiagnosticStatus::OK,
            DiagnosticStatus::WARN,
            DiagnosticStatus::ERROR,
        );
        status.ok("a");
        status.warn("b");
        status.error("c");
        status.warn("d");
        status.ok("e");
        assert_eq!(reported(), (error, "c".into()));
        assert_eq!(reported(), (ok, "e".into()));
        status.warn("f");
        assert_eq!(reported(), (warn, "f".into()));
        // The warning lasted until the previous report; no new one has occurred since.
        status.ok("g");
        assert_eq!(reported(), (ok, "g".into()));
        status.error("h");
        status.ok("i");
        status.error("j");
        assert_eq!(reported(), (error, "j".into()));
    }
}
