//! Detection of new writers of other participants, whose first sample a local reader may have missed during matching.

use rustdds::GUID;
use std::{
    collections::HashMap,
    time::{Duration, Instant},
};

/// A participant that is discovered within this time after the start of this participant is older: it answered this
/// one's first announcements.
const FIRST_ANSWERS: Duration = Duration::from_millis(250);
/// Writers of an older participant that are discovered within this time after their participant are older than this
/// participant.
const FIRST_WRITERS: Duration = Duration::from_secs(1);
/// If a reader is matched later than this after the discovery of the writer, the reader is newer than the writer.
const MATCHING: Duration = Duration::from_millis(250);

/// Discovery times of the writers of other participants.
pub(super) struct NewWriters {
    started: Instant,
    /// Discovery times of participants older than this one, by GUID prefix.
    older: HashMap<[u8; 12], Instant>,
    writers: HashMap<GUID, Instant>,
}

impl NewWriters {
    /// For a participant that starts at `now`.
    pub(super) fn new(now: Instant) -> Self {
        Self {
            started: now,
            older: HashMap::new(),
            writers: HashMap::new(),
        }
    }

    pub(super) fn participant_discovered(&mut self, participant: GUID, now: Instant) {
        if now < self.started + FIRST_ANSWERS {
            self.older.entry(prefix(participant)).or_insert(now);
        }
    }

    /// Records the discovery of a writer; repeated reports have no effect.
    pub(super) fn writer_discovered(&mut self, writer: GUID, now: Instant) {
        self.writers.entry(writer).or_insert(now);
    }

    /// Removes writers that have ended.
    pub(super) fn writers_lost(&mut self, is_lost: impl Fn(&GUID) -> bool) {
        self.writers.retain(|writer, _| !is_lost(writer));
    }

    /// Removes a participant that has ended.
    pub(super) fn participant_lost(&mut self, participant: [u8; 12]) {
        self.older.remove(&participant);
    }

    /// Whether a writer with which a reader is matched now has just been created.
    pub(super) fn is_new(&self, writer: GUID, now: Instant) -> bool {
        let discovered = *self.writers.get(&writer).unwrap_or(&now);
        let was_there = self.older.get(&prefix(writer));
        let was_there = was_there.is_some_and(|since| discovered < *since + FIRST_WRITERS);
        now < discovered + MATCHING && !was_there
    }
}

fn prefix(guid: GUID) -> [u8; 12] {
    std::array::from_fn(|i| guid.to_bytes()[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn writer(participant: u8, entity: u8) -> GUID {
        let mut bytes = [participant; 16];
        bytes[12..].fill(entity);
        GUID::from_bytes(bytes)
    }

    // Fails if all writers of an older participant count as old, or if its earlier writers count as new.
    #[test]
    fn a_writer_is_new_if_it_is_matched_when_it_is_discovered_and_was_not_there_before() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut all = NewWriters::new(start);
        all.participant_discovered(writer(1, 0), at(100));
        all.participant_discovered(writer(2, 0), at(3000));
        for (guid, discovered) in [
            (writer(1, 1), 300),
            (writer(1, 2), 5000),
            (writer(2, 1), 3100),
        ] {
            all.writer_discovered(guid, at(discovered));
            // A repeated report has no effect.
            all.writer_discovered(guid, at(discovered + 1000));
        }
        // An older writer; then writers that are matched at once.
        assert!(!all.is_new(writer(1, 1), at(301)));
        assert!(all.is_new(writer(1, 2), at(5001)));
        assert!(all.is_new(writer(2, 1), at(3101)));
        // A reader that was created later.
        assert!(!all.is_new(writer(1, 2), at(5500)));
        // A writer that has not been discovered yet.
        assert!(all.is_new(writer(2, 2), at(6000)));
        all.participant_lost([1; 12]);
        all.writers_lost(|_| true);
        all.writer_discovered(writer(1, 1), at(7000));
        assert!(all.is_new(writer(1, 1), at(7001)));
    }
}
