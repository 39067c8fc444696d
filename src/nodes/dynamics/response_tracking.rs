//! Response tracking: which published states have been answered by a command, and whether to wait for an answer.

use std::{collections::VecDeque, time::Duration};

use crate::ros::Time;

/// Largest lateness of a response, in states; a later command does not count as a response.
const MAX_LATENESS: usize = 64;
/// Number of consecutive states answered in time after which earlier unanswered states no longer count.
const RESET_AFTER_IN_TIME: u32 = 100;
/// Number of consecutive states answered late after which earlier unanswered states no longer count. A commander that
/// skips states does not answer so many in succession.
const RESET_AFTER_LATE: u32 = 10;

/// Counts answered states. A command answers the state whose stamp it carries.
///
/// A slow computer delays commands, and the delay may destabilise a control loop. Therefore simulated time can wait for
/// a response, but only to a commander that answers states. A commander that sends at its own rate, or answers only
/// some states, must not stall the simulation: each state that was waited for in vain doubles the number of responses
/// that are required before the next wait.
#[derive(Debug)]
pub struct ResponseTracker {
    /// Stamps of the last states, the newest last.
    states: VecDeque<Time>,
    /// Stamp of the newest answered state.
    newest: Option<Time>,
    /// Delay of the last response after its state.
    delay: Duration,
    /// Whether the last command carries the stamp of the current state.
    is_answered: bool,
    /// Responses since the last wait in vain.
    responses: u32,
    /// Number of responses required before the next wait.
    needed: u32,
    /// Whether it is only assumed that the commander answers states, because a command before the first state carried
    /// the stamp of the start.
    is_guess: bool,
    /// Number of responses to consecutive states, including late ones.
    consecutive_responses: u32,
    /// Number of consecutive states answered before the next one.
    consecutive_in_time: u32,
    /// Number of states that were followed by the next one although their response was due.
    unanswered: u64,
    /// Stamps of the last states of the previous run, before time was reset.
    previous_run: Vec<Time>,
}

impl Default for ResponseTracker {
    fn default() -> Self {
        Self {
            states: VecDeque::with_capacity(MAX_LATENESS),
            newest: None,
            delay: Duration::ZERO,
            is_answered: false,
            responses: 0,
            needed: 1,
            is_guess: false,
            consecutive_responses: 0,
            consecutive_in_time: 0,
            unanswered: 0,
            previous_run: Vec::new(),
        }
    }
}

impl ResponseTracker {
    /// Records that a new state was published. If the response to the previous one is still due, it counts as missing.
    pub fn state_published(&mut self, stamp: Time) {
        if self.is_awaiting_response() {
            self.responses = 0;
            if !std::mem::take(&mut self.is_guess) {
                self.needed = self.needed.saturating_mul(2);
                self.unanswered += 1;
            }
        }
        self.consecutive_in_time = match self.newest_has_response() {
            true => self.consecutive_in_time + 1,
            false => 0,
        };
        if self.consecutive_in_time == RESET_AFTER_IN_TIME {
            (self.consecutive_in_time, self.needed) = (0, 1);
        }
        if self.states.len() == MAX_LATENESS {
            self.states.pop_front();
        }
        self.states.push_back(stamp);
        self.is_answered = false;
    }

    /// The current state was changed: an earlier response to it no longer counts.
    pub fn state_changed(&mut self) {
        self.is_answered = false;
    }

    /// Resets for a new run. Responses to states of the previous run may still arrive.
    pub fn restart(&mut self) {
        let mut previous_run = std::mem::take(&mut self.previous_run);
        previous_run.extend(&self.states);
        previous_run.drain(..previous_run.len().saturating_sub(MAX_LATENESS));
        *self = Self {
            previous_run,
            ..Self::default()
        };
    }

    /// Whether a command with this stamp, received at `now`, answers a state of the previous run. Stamps of a commander
    /// that does not answer states rarely coincide with stamps of states.
    pub fn is_of_previous_run(&self, command_stamp: Time, now: Time) -> bool {
        command_stamp > now && self.previous_run.contains(&command_stamp)
    }

    /// Records that an effort command with this stamp is applied at `now`. Returns its delay after the answered state,
    /// if it is the first response to that state and not older than earlier responses.
    pub fn command_acts(&mut self, command_stamp: Time, now: Time) -> Option<Duration> {
        let mut delay = None;
        if self.states.is_empty() && command_stamp == now {
            // Over a slow network many states would pass before the first answer to one of them arrives.
            self.responses = self.needed;
            self.is_guess = true;
        } else if self.states.contains(&command_stamp)
            && self.newest.is_none_or(|newest| command_stamp > newest)
        {
            self.is_guess = false;
            let follows =
                |pair: (&Time, &Time)| Some(*pair.0) == self.newest && *pair.1 == command_stamp;
            let mut pairs = self.states.iter().zip(self.states.iter().skip(1));
            self.consecutive_responses = match pairs.any(follows) {
                true => self.consecutive_responses + 1,
                false => 0,
            };
            if self.consecutive_responses == RESET_AFTER_LATE {
                (self.consecutive_responses, self.needed) = (0, 1);
            }
            self.newest = Some(command_stamp);
            self.delay = now.since(command_stamp);
            delay = Some(self.delay);
            self.responses = self.responses.saturating_add(1);
        }
        self.is_answered = command_stamp == now;
        delay
    }

    /// Records that a velocity command with this stamp is applied at `now`. No response is due afterwards: the servo in
    /// the drives, not the commander, keeps the motion stable, and an operator sends commands at any rate.
    pub fn velocity_command_acts(&mut self, command_stamp: Time, now: Time) {
        self.responses = 0;
        self.is_answered = command_stamp == now;
    }

    /// Delay of the last response after its state, in simulated time.
    pub fn delay(&self) -> Duration {
        self.delay
    }

    /// Number of states whose response was due but did not arrive before the next state.
    pub fn unanswered(&self) -> u64 {
        self.unanswered
    }

    /// Whether the last command carries the stamp of the current state (lockstep).
    pub fn is_answered(&self) -> bool {
        self.is_answered
    }

    /// Whether the current state has no response yet but is likely to get one.
    pub fn is_awaiting_response(&self) -> bool {
        !self.newest_has_response() && self.responses >= self.needed
    }

    fn newest_has_response(&self) -> bool {
        self.states.back().copied() == self.newest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(i: u32) -> Time {
        Time::from_secs_f64(0.01 * f64::from(i))
    }

    fn record(tracker: &mut ResponseTracker, i: u32) {
        tracker.command_acts(state(i), state(i));
    }

    #[test]
    fn a_commander_that_has_answered_is_waited_for_even_if_late() {
        let mut tracker = ResponseTracker::default();
        for i in 0..5 {
            tracker.state_published(state(i));
            assert!(!tracker.is_awaiting_response(), "there was no response yet");
        }
        record(&mut tracker, 1);
        assert!(tracker.is_awaiting_response());
        record(&mut tracker, 1);
        record(&mut tracker, 3);
        assert!(tracker.is_awaiting_response());
        record(&mut tracker, 4);
        assert!(!tracker.is_awaiting_response());
        tracker.state_published(state(5));
        assert!(tracker.is_awaiting_response());
        tracker.state_published(state(6));
        assert_eq!(tracker.unanswered(), 1);
    }

    /// Number of states, out of a thousand, waited for in vain if the commander answers one in `every`.
    fn waits_in_vain(every: u32) -> usize {
        let mut tracker = ResponseTracker::default();
        let waits = (0..1000).filter(|&i| {
            tracker.state_published(state(i));
            if i % every == 0 {
                record(&mut tracker, i);
            }
            tracker.is_awaiting_response()
        });
        waits.count()
    }

    #[test]
    fn a_commander_that_skips_states_is_soon_not_waited_for() {
        assert_eq!(waits_in_vain(1), 0);
        assert_eq!(waits_in_vain(2), 8);
        assert_eq!(waits_in_vain(10), 6);
    }

    // Would break if time waited for an operator, whose commands carry the stamps of some states.
    #[test]
    fn velocity_commands_are_not_waited_for() {
        for every in [1, 2, 3, 5, 10] {
            let mut tracker = ResponseTracker::default();
            tracker.state_published(state(0));
            record(&mut tracker, 0);
            tracker.velocity_command_acts(state(0), state(0));
            for i in 1..1000 {
                tracker.state_published(state(i));
                if i % every == 0 {
                    tracker.velocity_command_acts(state(i), state(i));
                }
                assert!(!tracker.is_awaiting_response());
            }
            assert_eq!(tracker.unanswered(), 0);
        }
    }

    #[test]
    fn skipped_states_are_forgotten_after_many_responses() {
        let mut tracker = ResponseTracker::default();
        let mut i = 0;
        let mut answer = |tracker: &mut ResponseTracker, count: u32, every: u32| {
            for _ in 0..count {
                tracker.state_published(state(i));
                if i % every == 0 {
                    record(tracker, i);
                }
                i += 1;
            }
        };
        answer(&mut tracker, 400, 2);
        assert!(tracker.needed > 64);
        answer(&mut tracker, 2 * RESET_AFTER_IN_TIME, 1);
        assert_eq!(tracker.needed, 1);
    }

    // Would break if an effort of the previous run moved the arm, or if one of the present run were taken for it.
    #[test]
    fn responses_to_the_previous_run_are_recognised() {
        let mut tracker = ResponseTracker::default();
        for i in 0..300 {
            tracker.state_published(state(i));
        }
        assert!(!tracker.is_of_previous_run(state(299), state(0)));
        tracker.restart();
        tracker.restart();
        assert!(tracker.is_of_previous_run(state(299), state(0)));
        assert!(!tracker.is_of_previous_run(state(300), state(0)));
        assert!(!tracker.is_of_previous_run(state(299), state(299)));
        tracker.state_published(state(0));
        record(&mut tracker, 0);
        tracker.state_published(state(1));
        assert!(tracker.is_awaiting_response());
    }

    // Would break if the first states were simulated before the first answer over a slow network can arrive, or if a commander
    // that does not answer states (its stamps are zero, as that of the start) were waited for again.
    #[test]
    fn the_state_after_the_start_is_waited_for() {
        let mut tracker = ResponseTracker::default();
        record(&mut tracker, 0);
        tracker.state_published(state(1));
        assert!(tracker.is_awaiting_response());
        record(&mut tracker, 1);
        tracker.state_published(state(2));
        assert!(tracker.is_awaiting_response());

        let mut tracker = ResponseTracker::default();
        record(&mut tracker, 0);
        for i in 1..100 {
            tracker.state_published(state(i));
            assert_eq!(tracker.is_awaiting_response(), i == 1);
            tracker.command_acts(state(0), state(i));
        }
        assert_eq!(tracker.unanswered(), 0);
    }

    // Would break if a commander on a network that loses some answers, and delays the others, were waited for no longer.
    #[test]
    fn late_answers_to_consecutive_states_are_waited_for_again() {
        let mut tracker = ResponseTracker::default();
        for i in 0..4 {
            tracker.state_published(state(i));
            record(&mut tracker, i);
        }
        for i in 4..10 {
            tracker.state_published(state(i));
        }
        assert!(tracker.unanswered() > 0 && tracker.needed > 1);
        for i in 10..21 {
            tracker.state_published(state(i));
            tracker.command_acts(state(i - 5), state(i));
        }
        assert_eq!(tracker.needed, 1);
        assert!(tracker.is_awaiting_response());
    }

    #[test]
    fn the_delay_is_that_of_the_last_response() {
        let mut tracker = ResponseTracker::default();
        assert_eq!(tracker.delay(), Duration::ZERO);
        for i in 0..5 {
            tracker.state_published(state(i));
        }
        let delay = tracker.command_acts(state(1), state(4));
        assert_eq!(delay, Some(Duration::from_millis(30)));
        assert_eq!(tracker.command_acts(state(1), state(4)), None);
        assert_eq!(tracker.delay(), Duration::from_millis(30));
        record(&mut tracker, 4);
        assert_eq!(tracker.delay(), Duration::ZERO);
    }

    #[test]
    fn a_stamp_of_no_state_is_no_response() {
        let mut tracker = ResponseTracker::default();
        for i in 1..100 {
            tracker.state_published(state(i));
            tracker.command_acts(Time::ZERO, state(i));
            assert!(!tracker.is_awaiting_response() && !tracker.is_answered());
        }
    }

    // Would break if lockstep went on with the command that answered a state before it was moved by a service call.
    #[test]
    fn a_changed_state_needs_a_response_again() {
        let mut tracker = ResponseTracker::default();
        // The state at the start is not expected, and may be answered.
        record(&mut tracker, 0);
        assert!(tracker.is_answered());
        tracker.state_changed();
        assert!(!tracker.is_answered());
        record(&mut tracker, 0);
        assert!(tracker.is_answered());
        tracker.state_published(state(1));
        assert!(!tracker.is_answered());
        tracker.command_acts(state(0), state(1));
        assert!(!tracker.is_answered());
    }
}
