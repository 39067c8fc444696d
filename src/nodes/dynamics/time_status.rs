//! Diagnostics of simulated time: whether and how fast it advances, and why it waits.

use super::{clock::Phase, params::DynamicsParams, step_status::StepStatus};
use crate::ros::{Node, Time};

/// An achieved real time factor below this fraction of the requested one is reported as slow.
const SLOW: f64 = 0.95;

/// Duration of a wait at which it is first logged \[s\]; logged again each time the duration has doubled.
const FIRST_LOG: u64 = 5;

/// The status `time` in the diagnostics.
pub struct TimeStatus {
    status: StepStatus,
    /// Requested real time factor; `None` in lockstep, or if the simulation runs as fast as possible.
    wanted_factor: Option<f64>,
    /// Number of states for which simulated time has waited for a response.
    late_responses: u64,
    /// Counts as last reported: states that waited for a response, and states without one.
    reported: (u64, u64),
    /// Duration of the current wait at which it is logged next \[s\].
    log_at: u64,
}

impl TimeStatus {
    /// The status, before any report.
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

    /// Reports that time stands still in this phase.
    pub fn stands_still(&mut self, phase: Phase) {
        self.status.ok(match phase {
            Phase::Stopped => "stopped",
            Phase::Paused | Phase::Playing => "paused",
        });
    }

    /// Reports that the simulated time has reached `duration` \[s\].
    pub fn is_over(&mut self, duration: f64) {
        self.status.ok(format!(
            "the duration of {duration} s is over; time stands still"
        ));
    }

    /// Begins a wait for a command or for other robots.
    pub fn begin_wait(&mut self) {
        self.log_at = FIRST_LOG;
    }

    /// Reports that time has waited for the first command for `seconds`, and the likely `reason`.
    pub fn is_held(&mut self, seconds: u64, reason: &str) {
        self.waits(
            seconds,
            format!("time is held until the first command: {reason}"),
        );
    }

    /// Reports a wait, and logs it at increasing intervals.
    fn waits(&mut self, seconds: u64, text: String) {
        if seconds >= self.log_at {
            self.log_at = 2 * seconds;
            tracing::warn!("{text}");
        }
        self.status.warn(text);
    }

    /// Reports that the node is inactive.
    pub fn is_inactive(&mut self) {
        self.status.warn("the node is not active");
    }

    /// Reports that time advances in lockstep.
    pub fn in_lockstep(&mut self) {
        self.status.ok("lockstep");
    }

    /// Reports that lockstep has waited for `seconds` for the response to the state of `stamp`, and the likely
    /// `reason`.
    pub fn waits_for_response(&mut self, seconds: u64, stamp: Time, reason: &str) {
        self.waits(
            seconds,
            format!(
                "lockstep: waiting for {seconds} s for the command that answers the state of {stamp} s: {reason}"
            ),
        );
    }

    /// Reports that time has waited for `seconds` for other robots, described by `what`.
    pub fn waits_for_robots(&mut self, seconds: u64, what: &str) {
        self.waits(seconds, format!("waiting for {seconds} s for {what}"));
    }

    /// Reports that the robot `leader`, which owns the time, has stopped time at `time` \[s\].
    pub fn is_stopped_by(&mut self, leader: &str, time: f64) {
        self.status.ok(format!(
            "time stands still at {time:.2} s; {leader} owns it"
        ));
    }

    /// Reports that this robot is behind the time of the robot `leader` by `lag` \[s\].
    pub fn catches_up(&mut self, leader: &str, lag: f64) {
        self.status
            .warn(format!("{lag:.1} s behind the time of {leader}"));
    }

    /// Counts a state that was late because time waited for a response.
    pub fn count_late_response(&mut self) {
        self.late_responses += 1;
    }

    /// Reports the number of states without an answer. Not delayed, since a run may end at any state.
    pub fn count_unanswered(&mut self, unanswered: u64) {
        let counts = (self.late_responses, unanswered);
        if counts != self.reported {
            self.reported = counts;
            self.status
                .set("states that waited for their answer", counts.0);
            self.status.set("states without an answer", counts.1);
        }
    }

    /// Reports the real time factor achieved up to `time` \[s\].
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
