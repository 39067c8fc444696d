//! Delay of new endpoints while a newly discovered peer learns the existing ones.
//!
//! A Fast DDS participant that has just discovered ours requests the endpoints that we announced before. If we announce
//! another one meanwhile, Fast DDS takes it as the first and never reads the earlier ones: it orders announcements by
//! source timestamp, and rustdds sends none (docs/upstream.md). So no endpoint is created shortly after the discovery of
//! such a peer.

use rustdds::GUID;
use std::{
    sync::{Mutex, PoisonError},
    thread,
    time::{Duration, Instant},
};

/// Time that a peer needs to learn the existing endpoints; 60 ms were measured.
const SETTLING: Duration = Duration::from_millis(150);
/// Longest delay of an endpoint, however many peers are discovered.
const PATIENCE: Duration = Duration::from_secs(2);
/// First bytes of a rustdds GUID: its vendor id. rustdds peers lose nothing.
const OUR_KIND: [u8; 2] = [0x01, 0x12];

/// Time of the last discovery of a participant that is not rustdds.
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

    /// Blocks until no participant has been discovered for [`SETTLING`], at most [`PATIENCE`].
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
    fn only_other_implementations_delay_new_endpoints() {
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
