//! Reports of refused messages.

use std::time::{Duration, Instant};

use crate::nodes::dynamics::step_status::StepStatus;

/// Shortest time between two log messages on refusals of one topic.
const LOG_PERIOD: Duration = Duration::from_secs(1);

/// How long diagnostics keep reporting a refusal although valid messages follow.
const SHOWN: Duration = Duration::from_secs(5);

/// Counts and reports refused messages.
#[derive(Debug, Default)]
pub struct Refusals {
    count: u64,
    /// Topics with the time of their last log message.
    logged: Vec<(String, Instant)>,
    last: Option<Instant>,
}

impl Refusals {
    /// Reports that a message on `topic` was refused.
    pub fn report(&mut self, status: &mut StepStatus, topic: &str, problem: &str) {
        let line = format!("{topic}: refused, {problem}");
        let now = Instant::now();
        self.count += 1;
        self.last = Some(now);
        let before = self.logged.iter_mut().find(|(logged, _)| logged == topic);
        let is_due = match before {
            Some((_, at)) if at.elapsed() < LOG_PERIOD => false,
            Some((_, at)) => {
                *at = now;
                true
            }
            None => {
                self.logged.push((topic.to_owned(), now));
                true
            }
        };
        if is_due {
            tracing::warn!("{line}");
        }
        status.warn(line);
        status.set("refused", self.count);
    }

    /// Whether diagnostics still have to report the last refusal.
    pub fn is_shown(&self) -> bool {
        self.last.is_some_and(|at| at.elapsed() < SHOWN)
    }
}
