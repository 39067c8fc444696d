//! Which writers of other participants are new, so that a reader may have missed their first sample while it was matched.

use rustdds::GUID;
use std::{
    collections::HashMap,
    time::{Duration, Instant},
};

/// A participant that is discovered within this time after the start of this one was there before: it answered our first
/// announcements.
const FIRST_ANSWERS: Duration = Duration::from_millis(250);
/// Writers that are discovered within this time after their participant were there before this one, if their participant was.
const FIRST_WRITERS: Duration = Duration::from_secs(1);
/// A reader that is matched with a writer at a later time after the writer's discovery is newer than the writer.
const MATCHING: Duration = Duration::from_millis(250);

/// When the writers of other participants were discovered.
pub(super) struct NewWriters {
    started: Instant,
    /// Participants that were there before this one, by GUID prefix.
    older: HashMap<[u8; 12], Instant>,
    writers: HashMap<GUID, Instant>,
}

impl NewWriters {
    /// This participant starts now.
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

    /// May be reported several times.
    pub(super) fn writer_discovered(&mut self, writer: GUID, now: Instant) {
        self.writers.entry(writer).or_insert(now);
    }

    /// Forgets writers that have ended.
    pub(super) fn writers_lost(&mut self, is_lost: impl Fn(&GUID) -> bool) {
        self.writers.retain(|writer, _| !is_lost(writer));
    }

    /// Forgets a participant that has ended.
    pub(super) fn participant_lost(&mut self, participant: [u8; 12]) {
        self.older.remove(&participant);
    }

    /// Whether a writer, which a reader is matched with now, has just been created.
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

    // Fails if all writers of a participant that was there before this one count as old, or if those that it had then count as
    // new.
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
            // A second report changes nothing.
            all.writer_discovered(guid, at(discovered + 1000));
        }
        // There before; and matched at once.
        assert!(!all.is_new(writer(1, 1), at(301)));
        assert!(all.is_new(writer(1, 2), at(5001)));
        assert!(all.is_new(writer(2, 1), at(3101)));
        // A reader that came later.
        assert!(!all.is_new(writer(1, 2), at(5500)));
        // Not discovered yet.
        assert!(all.is_new(writer(2, 2), at(6000)));
        all.participant_lost([1; 12]);
        all.writers_lost(|_| true);
        all.writer_discovered(writer(1, 1), at(7000));
        assert!(all.is_new(writer(1, 1), at(7001)));
    }
}
