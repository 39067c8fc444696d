//! Messages of two topics that belong together because they carry the same stamp.

use std::collections::VecDeque;

use crate::ros::Time;

/// Messages kept while their partners are on their way.
const WAITING: usize = 64;

/// Pairs messages by stamp, whichever comes first. One that finds no partner, be it lost or oddly
/// stamped, is in nobody's way: it goes when a later pair is found, or when too many wait.
#[derive(Debug)]
pub struct StampPairs<A, B> {
    first: VecDeque<(Time, A)>,
    second: VecDeque<(Time, B)>,
}

impl<A, B> Default for StampPairs<A, B> {
    fn default() -> Self {
        Self {
            first: VecDeque::new(),
            second: VecDeque::new(),
        }
    }
}

impl<A, B> StampPairs<A, B> {
    /// Takes in one of the first kind.
    pub fn push_first(&mut self, stamp: Time, message: A) {
        push(&mut self.first, stamp, message);
    }

    /// Takes in one of the second kind.
    pub fn push_second(&mut self, stamp: Time, message: B) {
        push(&mut self.second, stamp, message);
    }

    /// The oldest pair, by arrival; what came before it goes.
    pub fn pop(&mut self) -> Option<(Time, A, B)> {
        let (i, j) = self.first.iter().enumerate().find_map(|(i, (stamp, _))| {
            Some((i, self.second.iter().position(|(other, _)| other == stamp)?))
        })?;
        let (stamp, first) = self.first.drain(..=i).next_back()?;
        let (_, second) = self.second.drain(..=j).next_back()?;
        Some((stamp, first, second))
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.first.clear();
        self.second.clear();
    }
}

fn push<M>(queue: &mut VecDeque<(Time, M)>, stamp: Time, message: M) {
    if queue.len() == WAITING {
        queue.pop_front();
    }
    queue.push_back((stamp, message));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn time(seconds: f64) -> Time {
        Time::from_secs_f64(seconds)
    }

    #[test]
    fn partners_meet_in_any_order() {
        let mut pairs = StampPairs::default();
        pairs.push_first(time(1.0), 'a');
        pairs.push_first(time(2.0), 'b');
        assert_eq!(pairs.pop(), None);
        pairs.push_second(time(2.0), 'x');
        assert_eq!(pairs.pop(), Some((time(2.0), 'b', 'x')));
        assert_eq!(pairs.pop(), None);
    }

    #[test]
    fn one_odd_stamp_jams_nothing_and_time_may_begin_anew() {
        let mut pairs = StampPairs::default();
        pairs.push_first(time(1.7e9), 'o');
        for k in 0..200 {
            let stamp = time(f64::from(k % 100) * 0.01);
            pairs.push_first(stamp, 'f');
            pairs.push_second(stamp, 's');
            assert_eq!(pairs.pop(), Some((stamp, 'f', 's')), "{k}");
        }
    }

    #[test]
    fn what_finds_no_partner_does_not_pile_up() {
        let mut pairs = StampPairs::<u32, u32>::default();
        for k in 0..1000 {
            pairs.push_first(time(f64::from(k)), k);
        }
        assert_eq!(pairs.first.len(), WAITING);
    }
}
