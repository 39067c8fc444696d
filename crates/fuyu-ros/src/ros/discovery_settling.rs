//! Letting peers that have just come learn what there is before more is added.
//!
//! A participant of Fast DDS that has just matched ours asks for the endpoints that we announced before it
//! came. If we announce one more while it waits for those, it takes that one, which it has first, and passes over
//! all before it for ever: it orders them by source timestamps, which rustdds does not give them
//! (docs/upstream.md). So no endpoint is made shortly after such a peer has come.

use rustdds::GUID;
use std::{
    sync::{Mutex, PoisonError},
    thread,
    time::{Duration, Instant},
};

/// Time that a peer needs to learn what there is; 60 ms were seen.
const SETTLING: Duration = Duration::from_millis(150);
/// Longest time that an endpoint is kept waiting, however many peers come.
const PATIENCE: Duration = Duration::from_secs(2);
/// How GUIDs of rustdds begin: its vendor number. Between its own kind nothing is lost.
const OUR_KIND: [u8; 2] = [0x01, 0x12];

/// When the last stranger came.
#[derive(Debug, Default)]
pub(super) struct DiscoverySettling {
    last: Mutex<Option<Instant>>,
}

impl DiscoverySettling {
    /// A participant with this GUID has been discovered.
    pub(super) fn participant_discovered(&self, participant: &GUID) {
        if participant.prefix.as_ref()[..2] != OUR_KIND {
            *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        }
    }

    /// Returns when nobody has come for a while.
    pub(super) fn wait(&self) {
        let patience = Instant::now() + PATIENCE;
        loop {
            let last = *self.last.lock().unwrap_or_else(PoisonError::into_inner);
            let Some(settled) = last.map(|last| (last + SETTLING).min(patience)) else {
                return;
            };
            let left = settled.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return;
            }
            thread::sleep(left);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guid(vendor: [u8; 2]) -> GUID {
        let mut bytes = [7; 16];
        bytes[..2].copy_from_slice(&vendor);
        GUID::from_bytes(bytes)
    }

    #[test]
    fn only_strangers_are_given_time() {
        let settling = DiscoverySettling::default();
        settling.participant_discovered(&guid(OUR_KIND));
        let start = Instant::now();
        settling.wait();
        assert!(start.elapsed() < SETTLING);
        settling.participant_discovered(&guid([0x01, 0x0f]));
        settling.wait();
        assert!(start.elapsed() >= SETTLING);
    }
}
