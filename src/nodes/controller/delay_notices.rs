//! Delay notices: log messages on the measured delay of the controller's efforts.

use crate::{
    control::{DelayStatus, LoopReport, Stamp},
    ros::{Node, NodeName},
};

/// Simulated time without measured delays after which a warning is logged \[s\].
const PATIENCE: f64 = 3.0;

/// Logs once each time that delay compensation begins or is refused.
#[derive(Debug)]
pub(super) struct DelayNotices {
    node: NodeName,
    is_compensated: bool,
    is_refused: bool,
    has_warned: bool,
    /// Stamp of the first state since which no delay has been measured.
    waits_since: Option<Stamp>,
}

impl DelayNotices {
    pub(super) fn new(node: &Node) -> Self {
        Self {
            node: node.name().clone(),
            is_compensated: false,
            is_refused: false,
            has_warned: false,
            waits_since: None,
        }
    }

    /// Processes the report of a control step. Returns a problem with the delays, which are measured on `topic`.
    pub(super) fn follow(&mut self, report: &LoopReport, topic: &str) -> Option<String> {
        let node = &self.node;
        if report.delay != DelayStatus::Measuring {
            self.waits_since = None;
        }
        match report.delay {
            DelayStatus::NotCompensated => None,
            DelayStatus::Measuring => {
                let since = *self.waits_since.get_or_insert(report.stamp);
                if report.stamp.seconds_since(since) < PATIENCE {
                    return Some(format!(
                        "the delay of commands is being measured ({topic}): efforts are zero"
                    ));
                }
                let problem = format!(
                    "no delays have arrived on {topic}: efforts are zero. The dynamics node publishes them if its \
                     answer_timeout is 0, and of answers that are at most 64 states late; where time waits for answers, \
                     delay_compensation is to be false"
                );
                if !std::mem::replace(&mut self.has_warned, true) {
                    tracing::warn!("node {node}: {problem}");
                }
                Some(problem)
            }
            DelayStatus::Compensated { delay } => {
                let has_changed = self.is_refused || !self.is_compensated;
                (self.is_compensated, self.is_refused) = (true, false);
                if has_changed {
                    let delay = 1e3 * delay;
                    tracing::info!(
                        "node {node}: efforts act {delay:.0} ms after their states, which is compensated"
                    );
                }
                None
            }
            DelayStatus::Refused(error) => {
                let problem = format!("{error}: efforts are zero");
                if !std::mem::replace(&mut self.is_refused, true) {
                    tracing::error!("node {node}: {problem}");
                }
                Some(problem)
            }
        }
    }
}
