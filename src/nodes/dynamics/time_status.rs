//! Diagnostics of simulated time: whether it advances, how fast, and the cause of a wait.

use super::{clock::Phase, params::DynamicsParams, step_status::StepStatus};
use crate::ros::{Node, Time};

/// An achieved real time factor below this fraction of the requested one is reported as slow.
const SLOW: f64 = 0.95;

/// Duration of a wait at which it is logged for the first time \[s\]; each next time after twice as long.
const FIRST_LOG: u64 = 5;

/// The status `time`.
pub struct TimeStatus {
    status: StepStatus,
    /// Requested real time factor; `None` without pacing: in lockstep, or as fast as possible.
    wanted_factor: Option<f64>,
    /// Number of states for which simulated time has waited for a response.
    late_responses: u64,
    /// What was reported last: states that waited for a response, and those without one.
    reported: (u64, u64),
    /// Duration of the present wait at which it is logged next \[s\].
    log_at: u64,
}

impl TimeStatus {
    /// The status, not reported yet.
    pub fn new(node: &Node, params: &DynamicsParams) -> Self {
        let factor = params.real_time_factor;
        Self {
            status: StepStatus::new(node.diagnostics().status("time")),
            wanted_factor: (!params.lockstep && factor != 0.0).then_some(factor),
            late_responses: 0,
            reported: (0, 0),
            log_at: FIRST_LOG,
        }
    }

    /// The simulation stands still in this phase.
    pub fn stands_still(&mut self, phase: Phase) {
        self.status.ok(match phase {
            Phase::Stopped => "stopped",
            Phase::Paused | Phase::Playing => "paused",
        });
    }

    /// The time to simulate \[s\] is over.
    pub fn is_over(&mut self, duration: f64) {
        self.status.ok(format!(
            "the duration of {duration} s is over; time stands still"
        ));
    }

    /// Time begins to wait for a command.
    pub fn begin_wait(&mut self) {
        self.log_at = FIRST_LOG;
    }

    /// Time has waited for the first command for `seconds`; `reason` says what is known about it.
    pub fn is_held(&mut self, seconds: u64, reason: &str) {
        self.waits(
            seconds,
            format!("time is held until the first command: {reason}"),
        );
    }

    /// Reports a wait, and logs it from time to time.
    fn waits(&mut self, seconds: u64, text: String) {
        if seconds >= self.log_at {
            self.log_at = 2 * seconds;
            tracing::warn!("{text}");
        }
        self.status.warn(text);
    }

    /// The node is not active.
    pub fn is_inactive(&mut self) {
        self.status.warn("the node is not active");
    }

    /// Time advances in lockstep.
    pub fn in_lockstep(&mut self) {
        self.status.ok("lockstep");
    }

    /// Lockstep has waited for `seconds` for the response to the state of `stamp`; `reason` says what is known about it.
    pub fn waits_for_response(&mut self, seconds: u64, stamp: Time, reason: &str) {
        self.waits(
            seconds,
            format!(
                "lockstep: waiting for {seconds} s for the command that answers the state of {stamp} s: {reason}"
            ),
        );
    }

    /// Time has waited for other robots for `seconds`; `what` says for which.
    pub fn waits_for_robots(&mut self, seconds: u64, what: &str) {
        self.waits(seconds, format!("waiting for {seconds} s for {what}"));
    }

    /// The robot `leader`, which owns the time, lets it stand still at `time` \[s\].
    pub fn is_stopped_by(&mut self, leader: &str, time: f64) {
        self.status.ok(format!(
            "time stands still at {time:.2} s; {leader} owns it"
        ));
    }

    /// The robot `leader`, which owns the time, is ahead by `lag` \[s\].
    pub fn catches_up(&mut self, leader: &str, lag: f64) {
        self.status
            .warn(format!("{lag:.1} s behind the time of {leader}"));
    }

    /// A state was late because time waited for a response.
    pub fn count_late_response(&mut self) {
        self.late_responses += 1;
    }

    /// The number of states without an answer so far. Reported at once: a run may end at any state.
    pub fn count_unanswered(&mut self, unanswered: u64) {
        let counts = (self.late_responses, unanswered);
        if counts != self.reported {
            self.reported = counts;
            self.status
                .set("states that waited for their answer", counts.0);
            self.status.set("states without an answer", counts.1);
        }
    }

    /// The real time factor achieved up to `time` \[s\].
    pub fn achieved(&mut self, time: f64, factor: f64) {
        self.status.set("simulated time [s]", format!("{time:.2}"));
        self.status.set("real time factor", format!("{factor:.3}"));
        match self.wanted_factor {
            None => {}
            Some(wanted) if factor < SLOW * wanted => {
                (self.status).warn(format!("slower than the real_time_factor of {wanted}"));
            }
            Some(_) => self.status.ok("in time"),
        }
    }
}
