//! Whether states are being answered.

use std::collections::VecDeque;

use crate::ros::Time;

/// States that an answer may be late by and still count as one.
const REMEMBERED: usize = 64;
/// So many states answered in a row make up for those that were not.
const FORGIVEN_AFTER: u32 = 100;

/// Keeps count of the states that commands answer: a command answers the state whose stamp it carries.
///
/// A computer that is late delays commands, and a loop that is stable on time may not be stable then. So
/// simulated time can wait for an answer, but only for a commander that answers states. Those who command when
/// they please, or answer some states only, must not hold time up: each state that was waited for in vain
/// doubles the number of answers that it takes until one is waited for again.
#[derive(Debug)]
pub struct ResponseTracker {
    /// Stamps of the last states, the newest at the end.
    states: VecDeque<Time>,
    /// Stamp of the newest state that has an answer.
    newest: Option<Time>,
    /// ResponseTracker since one was waited for in vain.
    answers: u32,
    /// ResponseTracker that it takes until one is waited for.
    needed: u32,
    /// States answered in a row.
    in_a_row: u32,
    /// The last states before time began anew.
    before: Vec<Time>,
}

impl Default for ResponseTracker {
    fn default() -> Self {
        Self {
            states: VecDeque::with_capacity(REMEMBERED),
            newest: None,
            answers: 0,
            needed: 1,
            in_a_row: 0,
            before: Vec::new(),
        }
    }
}

impl ResponseTracker {
    /// A new state is published; what was due has not come.
    pub fn expect(&mut self, state: Time) {
        if self.due() {
            self.answers = 0;
            self.needed = self.needed.saturating_mul(2);
        }
        self.in_a_row = match self.answered() {
            true => self.in_a_row + 1,
            false => 0,
        };
        if self.in_a_row == FORGIVEN_AFTER {
            (self.in_a_row, self.needed) = (0, 1);
        }
        if self.states.len() == REMEMBERED {
            self.states.pop_front();
        }
        self.states.push_back(state);
    }

    /// Time begins anew. ResponseTracker to states of the run before may still be under way.
    pub fn begin_anew(&mut self) {
        let mut before = std::mem::take(&mut self.before);
        before.extend(&self.states);
        before.drain(..before.len().saturating_sub(REMEMBERED));
        *self = Self {
            before,
            ..Self::default()
        };
    }

    /// Whether a command with this stamp, which comes at `now`, answers a state of the run before. Stamps of a
    /// commander that does not answer states hardly ever are such a state's.
    pub fn is_of_before(&self, command: Time, now: Time) -> bool {
        command > now && self.before.contains(&command)
    }

    /// A command with this stamp has come.
    pub fn note(&mut self, command: Time) {
        if self.states.contains(&command) && self.newest.is_none_or(|newest| command > newest) {
            self.newest = Some(command);
            self.answers = self.answers.saturating_add(1);
        }
    }

    /// Whether the last state has no answer yet but is likely to get one.
    pub fn due(&self) -> bool {
        !self.answered() && self.answers >= self.needed
    }

    fn answered(&self) -> bool {
        self.states.back().copied() == self.newest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(i: u32) -> Time {
        Time::from_secs_f64(0.01 * f64::from(i))
    }

    #[test]
    fn who_has_answered_is_waited_for_however_late() {
        let mut answers = ResponseTracker::default();
        for i in 0..5 {
            answers.expect(state(i));
            assert!(!answers.due(), "nobody has answered yet");
        }
        answers.note(state(1));
        assert!(answers.due());
        answers.note(state(1));
        answers.note(state(3));
        assert!(answers.due());
        answers.note(state(4));
        assert!(!answers.due());
        answers.expect(state(5));
        assert!(answers.due());
    }

    /// States of a thousand that are waited for in vain, if a commander answers one in `every`.
    fn in_vain(every: u32) -> usize {
        let mut answers = ResponseTracker::default();
        let waits = (0..1000).filter(|&i| {
            answers.expect(state(i));
            if i % every == 0 {
                answers.note(state(i));
            }
            answers.due()
        });
        waits.count()
    }

    #[test]
    fn who_leaves_states_out_soon_is_not() {
        assert_eq!(in_vain(1), 0);
        assert_eq!(in_vain(2), 8);
        assert_eq!(in_vain(10), 6);
    }

    #[test]
    fn trust_comes_back() {
        let mut answers = ResponseTracker::default();
        let mut i = 0;
        let mut answer = |answers: &mut ResponseTracker, count: u32, every: u32| {
            for _ in 0..count {
                answers.expect(state(i));
                if i % every == 0 {
                    answers.note(state(i));
                }
                i += 1;
            }
        };
        answer(&mut answers, 400, 2);
        assert!(answers.needed > 64);
        answer(&mut answers, 2 * FORGIVEN_AFTER, 1);
        assert_eq!(answers.needed, 1);
    }

    // Would break if an effort of the run before moved the arm of the next, or if one of the next were taken for it.
    #[test]
    fn answers_to_the_run_before_are_known() {
        let mut answers = ResponseTracker::default();
        for i in 0..300 {
            answers.expect(state(i));
        }
        assert!(!answers.is_of_before(state(299), state(0)));
        answers.begin_anew();
        answers.begin_anew();
        assert!(answers.is_of_before(state(299), state(0)));
        assert!(!answers.is_of_before(state(300), state(0)));
        assert!(!answers.is_of_before(state(299), state(299)));
        answers.expect(state(0));
        answers.note(state(0));
        answers.expect(state(1));
        assert!(answers.due());
    }

    #[test]
    fn stamps_that_are_no_state_s_are_no_answers() {
        let mut answers = ResponseTracker::default();
        for i in 1..100 {
            answers.expect(state(i));
            answers.note(Time::ZERO);
            assert!(!answers.due());
        }
    }
}
