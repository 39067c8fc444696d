//! Delay of new endpoints while peers that have just been discovered learn the existing ones.
//!
//! A Fast DDS participant that has just discovered fuyu's participant requests the endpoints that were announced before. If
//! fuyu announces another endpoint meanwhile, Fast DDS takes it as the first and never reads the earlier announcements: it
//! orders announcements by source timestamp, and rustdds sends none (docs/upstream.md). So no endpoint is created shortly
//! after the discovery of such a peer, nor shortly after fuyu has created a participant, which peers are about to discover.

use rustdds::GUID;
use std::{
    collections::HashSet,
    sync::{Mutex, MutexGuard, PoisonError},
    thread,
    time::{Duration, Instant},
};

/// GUID prefix of a participant.
type Prefix = [u8; 12];

/// Time that a peer needs to learn the existing endpoints; 60 ms were measured.
const SETTLING: Duration = Duration::from_millis(150);
/// How long a new participant waits for peers that an earlier one knew.
const REDISCOVERY_OF_PEERS: Duration = Duration::from_secs(1);
/// Longest delay of an endpoint, however many peers are discovered.
const PATIENCE: Duration = Duration::from_secs(2);
/// First bytes of a rustdds GUID: its vendor id. rustdds peers lose nothing.
const OUR_KIND: [u8; 2] = [0x01, 0x12];

/// Peers that are not rustdds, and when the last one was discovered.
#[derive(Debug, Default)]
pub(super) struct DiscoverySettling {
    inner: Mutex<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    /// When our participant was created or discovered such a peer, whichever was later.
    last: Option<Instant>,
    known: HashSet<Prefix>,
    /// Known to the previous participant of ours, not yet to this one; and until when they are waited for.
    missing: HashSet<Prefix>,
    missing_until: Option<Instant>,
}

impl DiscoverySettling {
    /// Our participant is new: it has to be discovered by all, again.
    pub(super) fn participant_created(&self) {
        let mut inner = self.lock();
        let now = Instant::now();
        inner.last = Some(now);
        inner.missing = std::mem::take(&mut inner.known);
        inner.missing_until = Some(now + REDISCOVERY_OF_PEERS);
    }

    /// A participant with this GUID has been discovered.
    pub(super) fn participant_discovered(&self, participant: &GUID) {
        if let Some(prefix) = prefix_of_other(participant.prefix.as_ref()) {
            let mut inner = self.lock();
            inner.last = Some(Instant::now());
            inner.missing.remove(&prefix);
            inner.known.insert(prefix);
        }
    }

    /// A participant with this GUID prefix has left or was lost.
    pub(super) fn participant_lost(&self, prefix: &[u8]) {
        if let Some(prefix) = prefix_of_other(prefix) {
            let mut inner = self.lock();
            inner.missing.remove(&prefix);
            inner.known.remove(&prefix);
        }
    }

    /// Blocks until peers that an earlier participant of ours knew are discovered again, at most [`REDISCOVERY_OF_PEERS`] after the
    /// new one, and until none has been discovered for [`SETTLING`]; at most [`PATIENCE`].
    pub(super) fn wait(&self) {
        let patience = Instant::now() + PATIENCE;
        loop {
            let inner = self.lock();
            let settled = inner.last.map(|last| last + SETTLING);
            let rediscovered = inner.missing_until.filter(|_| !inner.missing.is_empty());
            drop(inner);
            let now = Instant::now();
            let settled = settled.into_iter().chain(rediscovered).max();
            let left = settled.map(|t| t.min(patience).saturating_duration_since(now));
            match left {
                // The last missing one may be discovered meanwhile.
                Some(left) if !left.is_zero() => thread::sleep(left.min(SETTLING)),
                _ => return,
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The GUID prefix, if it is not one of rustdds.
fn prefix_of_other(prefix: &[u8]) -> Option<Prefix> {
    let prefix = Prefix::try_from(prefix).ok()?;
    (prefix[..2] != OUR_KIND).then_some(prefix)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guid(vendor: [u8; 2]) -> GUID {
        let mut bytes = [7; 16];
        bytes[..2].copy_from_slice(&vendor);
        GUID::from_bytes(bytes)
    }

    const OTHER: [u8; 2] = [0x01, 0x0f];

    #[test]
    fn only_other_implementations_delay_new_endpoints() {
        let settling = DiscoverySettling::default();
        settling.participant_discovered(&guid(OUR_KIND));
        let start = Instant::now();
        settling.wait();
        assert!(start.elapsed() < SETTLING);
        settling.participant_discovered(&guid(OTHER));
        settling.wait();
        assert!(start.elapsed() >= SETTLING);
    }

    // Fails if a new participant created its endpoints while the peers of the earlier one are learning those that exist.
    #[test]
    fn a_new_participant_waits_for_the_peers_of_the_earlier_one() {
        let waited = |settling: &DiscoverySettling| {
            let start = Instant::now();
            settling.participant_created();
            settling.wait();
            start.elapsed()
        };
        let settling = DiscoverySettling::default();
        let first = waited(&settling);
        assert!(
            first >= SETTLING && first < REDISCOVERY_OF_PEERS,
            "{first:?}"
        );
        settling.participant_discovered(&guid(OTHER));
        assert!(waited(&settling) >= REDISCOVERY_OF_PEERS);
        // Not discovered by the second one, so the third one does not wait for it.
        assert!(waited(&settling) < REDISCOVERY_OF_PEERS);
        settling.participant_discovered(&guid(OTHER));
        settling.participant_lost(guid(OTHER).prefix.as_ref());
        assert!(waited(&settling) < REDISCOVERY_OF_PEERS);
        settling.participant_discovered(&guid(OTHER));
        thread::scope(|scope| {
            scope.spawn(|| {
                thread::sleep(2 * SETTLING);
                settling.participant_discovered(&guid(OTHER));
            });
            let waited = waited(&settling);
            assert!(
                (3 * SETTLING..REDISCOVERY_OF_PEERS).contains(&waited),
                "{waited:?}"
            );
        });
    }
}
