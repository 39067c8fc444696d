//! Pairing of samples from two sources by equal stamps.

use std::collections::VecDeque;

/// Largest number of samples of each source that wait for a partner.
const CAPACITY: usize = 64;

/// Pairs samples of two sources with equal stamps, in any order of arrival. A sample without a partner (lost, or with
/// another stamp) delays nothing: it is dropped when a later pair is found, or when 64 newer samples of its source have
/// arrived. Memory is allocated once, by [`StampPairs::default`].
///
/// `S` is the type of the stamps: [`Stamp`](super::Stamp), or a message's own.
#[derive(Debug)]
pub struct StampPairs<S, A, B> {
    first: VecDeque<(S, A)>,
    second: VecDeque<(S, B)>,
}

impl<S, A, B> Default for StampPairs<S, A, B> {
    fn default() -> Self {
        Self {
            first: VecDeque::with_capacity(CAPACITY),
            second: VecDeque::with_capacity(CAPACITY),
        }
    }
}

impl<S: Copy + PartialEq, A, B> StampPairs<S, A, B> {
    /// Adds a sample of the first source.
    pub fn push_first(&mut self, stamp: S, sample: A) {
        push(&mut self.first, stamp, sample);
    }

    /// Adds a sample of the second source.
    pub fn push_second(&mut self, stamp: S, sample: B) {
        push(&mut self.second, stamp, sample);
    }

    /// Removes the pair whose first sample arrived earliest, and drops all samples that arrived before either sample of
    /// the pair.
    pub fn pop(&mut self) -> Option<(S, A, B)> {
        let (i, j) = self.first.iter().enumerate().find_map(|(i, (stamp, _))| {
            Some((i, self.second.iter().position(|(other, _)| other == stamp)?))
        })?;
        let (stamp, first) = self.first.drain(..=i).next_back()?;
        let (_, second) = self.second.drain(..=j).next_back()?;
        Some((stamp, first, second))
    }

    /// Drops all samples.
    pub fn clear(&mut self) {
        self.first.clear();
        self.second.clear();
    }
}

fn push<S, T>(queue: &mut VecDeque<(S, T)>, stamp: S, sample: T) {
    if queue.len() == CAPACITY {
        queue.pop_front();
    }
    queue.push_back((stamp, sample));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_paired_in_either_order_of_arrival() {
        let mut pairs = StampPairs::default();
        pairs.push_first(1, 'a');
        pairs.push_first(2, 'b');
        assert_eq!(pairs.pop(), None);
        pairs.push_second(2, 'x');
        assert_eq!(pairs.pop(), Some((2, 'b', 'x')));
        assert_eq!(pairs.pop(), None);
    }

    #[test]
    fn a_wrong_stamp_blocks_no_later_pair_and_time_may_restart() {
        let mut pairs = StampPairs::default();
        pairs.push_first(1_700_000_000, 'o');
        for k in 0..200 {
            let stamp = k % 100;
            pairs.push_first(stamp, 'f');
            pairs.push_second(stamp, 's');
            assert_eq!(pairs.pop(), Some((stamp, 'f', 's')), "{k}");
        }
    }

    #[test]
    fn samples_without_partners_do_not_accumulate() {
        let mut pairs = StampPairs::<u32, u32, u32>::default();
        let capacity = pairs.first.capacity();
        for k in 0..1000 {
            pairs.push_first(k, k);
        }
        assert_eq!(pairs.first.len(), CAPACITY);
        assert_eq!(pairs.first.capacity(), capacity);
    }
}
