//! Detection of lost messages by gaps in the sequence numbers of publishers.

use std::collections::HashMap;

use crate::ros::Gid;

/// Largest number of remembered publishers; a publisher that restarts counts as another one.
const MOST_PUBLISHERS: usize = 4096;

/// Sequence number of the last sample of each publisher that a subscription has received.
#[derive(Default)]
pub(super) struct SequenceNumbers {
    last: HashMap<Gid, i64>,
}

impl SequenceNumbers {
    /// Number of samples missing between the previous sample of a publisher and this one. Samples before the first
    /// received one were not meant for this subscription.
    pub(super) fn missing_before(&mut self, publisher: Gid, number: i64) -> u64 {
        if self.last.len() >= MOST_PUBLISHERS && !self.last.contains_key(&publisher) {
            // Costs the count of at most one gap per publisher.
            self.last.clear();
        }
        let before = self.last.entry(publisher).or_insert(number);
        let gap = number.saturating_sub(*before).saturating_sub(1).max(0);
        *before = number.max(*before);
        gap as u64
    }

    /// Whether a sample of a publisher has arrived.
    pub(super) fn has_any_of(&self, publisher: Gid) -> bool {
        self.last.contains_key(&publisher)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if publishers that have left are remembered forever, or if forgetting them counts as a gap.
    #[test]
    fn publishers_are_not_remembered_without_bound() {
        let mut last = SequenceNumbers::default();
        for k in 0..3 * MOST_PUBLISHERS as u64 {
            let mut gid = [0; 16];
            gid[..8].copy_from_slice(&k.to_le_bytes());
            assert_eq!(last.missing_before(Gid::from(gid), 7), 0);
        }
        assert!(last.last.len() <= MOST_PUBLISHERS);
    }

    // Fails if a late start, a repetition or the numbers of another publisher count as gaps.
    #[test]
    fn missing_samples_are_counted_for_each_publisher() {
        let gid = |n| Gid::from([n; 16]);
        let mut last = SequenceNumbers::default();
        let numbers = [(1, 40), (1, 41), (2, 7), (1, 45), (1, 45), (2, 8), (1, 46)];
        let holes: Vec<_> = numbers
            .iter()
            .map(|&(publisher, number)| last.missing_before(gid(publisher), number))
            .collect();
        assert_eq!(holes, [0, 0, 0, 3, 0, 0, 0]);
    }
}
