//! Selection of one `/clock` publisher if there are several, so that simulated time does not jump between two
//! simulations.

use std::time::{Duration, Instant};

use super::Gid;

/// If the followed publisher is silent for this long, another publisher is its successor (a restarted simulation).
const SUCCESSION: Duration = Duration::from_millis(300);
/// As [`SUCCESSION`], after two publishers have been active at the same time.
const ABSENCE: Duration = Duration::from_secs(3);

/// Effect of a `/clock` message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// The message sets the time.
    Follow,
    /// The message sets the time, and its publisher replaces the followed one, which is still active.
    FollowInstead,
    /// The message is ignored, since another publisher is followed.
    Ignore,
}

/// The followed publisher, and whether there are others.
#[derive(Debug, Default)]
pub(super) struct ClockSource {
    followed: Option<(Gid, Instant)>,
    /// Another active publisher, with the time of its last message.
    other: Option<(Gid, Instant)>,
    /// Whether two publishers have been active at the same time.
    are_several: bool,
}

impl ClockSource {
    /// Processes a message that `publisher` sent and that arrived at `now`. `is_own` returns whether a publisher
    /// belongs to the node's own robot.
    pub(super) fn receive(
        &mut self,
        publisher: Gid,
        now: Instant,
        is_own: impl Fn(Gid) -> bool,
    ) -> Verdict {
        let Some((followed, last)) = self.followed else {
            self.followed = Some((publisher, now));
            return Verdict::Follow;
        };
        if publisher == followed {
            self.followed = Some((followed, now));
            self.are_several |= self.other.is_some_and(|(_, at)| now - at < ABSENCE);
            return Verdict::Follow;
        }
        let patience = match self.are_several {
            true => ABSENCE,
            false => SUCCESSION,
        };
        if now - last > patience {
            *self = Self {
                followed: Some((publisher, now)),
                ..Self::default()
            };
            return Verdict::Follow;
        }
        self.other = Some((publisher, now));
        if self.are_several && is_own(publisher) && !is_own(followed) {
            self.followed = Some((publisher, now));
            self.other = Some((followed, last));
            return Verdict::FollowInstead;
        }
        Verdict::Ignore
    }

    /// The followed publisher and another one, if both are active at the same time.
    pub(super) fn several(&self) -> Option<[Gid; 2]> {
        let ((followed, _), (other, _)) = self.followed.zip(self.other)?;
        self.are_several.then_some([followed, other])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gid(n: u8) -> Gid {
        Gid::from([n; 16])
    }

    /// Verdicts on messages, given as (publisher, time \[ms\]), for a node whose own robot has the publisher `own`.
    fn verdicts(messages: &[(u8, u64)], own: u8) -> (Vec<Verdict>, Option<[Gid; 2]>) {
        let mut source = ClockSource::default();
        let start = Instant::now();
        let verdicts = messages.iter().map(|&(publisher, at)| {
            let at = start + Duration::from_millis(at);
            source.receive(gid(publisher), at, |p| p == gid(own))
        });
        (verdicts.collect(), source.several())
    }

    // Fails if time jumps from one publisher to the other and back.
    #[test]
    fn one_of_two_publishers_is_followed() {
        let messages: Vec<_> = (0..100).map(|i| (1 + (i % 2) as u8, 5 * i)).collect();
        let (all, several) = verdicts(&messages, 1);
        assert_eq!(several, Some([gid(1), gid(2)]));
        for (i, verdict) in all.into_iter().enumerate() {
            let expected = match i % 2 {
                0 => Verdict::Follow,
                _ => Verdict::Ignore,
            };
            assert_eq!(verdict, expected, "message {i}");
        }
    }

    #[test]
    fn that_of_the_own_robot_is_preferred() {
        let (all, several) = verdicts(&[(1, 0), (2, 5), (1, 10), (2, 15), (1, 20), (2, 25)], 2);
        let expected = [
            Verdict::Follow,
            Verdict::Ignore,
            Verdict::Follow,
            Verdict::FollowInstead,
            Verdict::Ignore,
            Verdict::Follow,
        ];
        assert_eq!(all, expected);
        assert_eq!(several, Some([gid(2), gid(1)]));
    }

    // Fails if a node keeps the time of a simulation that has ended, or warns of its successor.
    #[test]
    fn a_restarted_simulation_is_followed() {
        let (all, several) = verdicts(&[(1, 0), (1, 10), (2, 20), (2, 400), (2, 410)], 0);
        assert_eq!(all[2], Verdict::Ignore);
        assert_eq!(all[3..], [Verdict::Follow; 2]);
        assert_eq!(several, None);
    }
}
