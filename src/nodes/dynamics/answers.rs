//! Whether states are being answered.

use crate::ros::Time;

/// States in a row that must have been answered before one is waited for.
const TRUSTED_AFTER: u32 = 10;

/// Keeps count of the states that commands answer: a command answers the state whose stamp it carries.
///
/// A computer that is late delays commands, and a loop that is stable on time may not be stable then. So
/// simulated time can wait for an answer, but only for a commander that is known to give one: others, who
/// command when they please, must not hold time up.
#[derive(Debug, Default)]
pub struct Answers {
    /// Stamp of the state that is to be answered.
    state: Time,
    answered: bool,
    /// States before it that were answered, without one between that was not.
    in_a_row: u32,
}

impl Answers {
    /// A new state has been published.
    pub fn expect(&mut self, state: Time) {
        self.in_a_row = match self.answered {
            true => self.in_a_row.saturating_add(1),
            false => 0,
        };
        self.state = state;
        self.answered = false;
    }

    /// A command with this stamp has come; gives whether it answers the present state.
    pub fn note(&mut self, command: Time) -> bool {
        let answers = command == self.state;
        self.answered |= answers;
        answers
    }

    /// Whether the present state has no answer yet but is likely to get one.
    pub fn due(&self) -> bool {
        !self.answered && self.in_a_row >= TRUSTED_AFTER
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(i: u32) -> Time {
        Time::from_secs_f64(0.01 * f64::from(i))
    }

    #[test]
    fn an_answer_is_due_from_who_has_answered_ten_in_a_row() {
        let mut answers = Answers::default();
        for i in 1..=TRUSTED_AFTER {
            answers.expect(state(i));
            assert!(!answers.due(), "{i}");
            assert!(answers.note(state(i)));
        }
        answers.expect(state(11));
        assert!(answers.due());
        assert!(!answers.note(state(10)) && answers.due());
        assert!(answers.note(state(11)) && !answers.due());
        // One that is not answered, and the trust is gone.
        answers.expect(state(12));
        answers.expect(state(13));
        assert!(!answers.due());
    }

    #[test]
    fn nothing_is_due_from_who_commands_without_stamps() {
        let mut answers = Answers::default();
        for i in 1..100 {
            answers.expect(state(i));
            assert!(!answers.note(Time::ZERO) && !answers.due());
        }
    }
}
