//! Delays new endpoints while newly discovered peers are learning the existing ones.
//!
//! A Fast DDS participant that has just discovered fuyu's participant requests the earlier announcements of endpoints.
//! If fuyu announces another endpoint in the meantime, Fast DDS takes that as the first announcement and never reads
//! the earlier ones: it orders announcements by source timestamp, and rustdds sends none (docs/upstream.md). So no
//! endpoint is created shortly after the discovery of such a peer, nor shortly after fuyu has created a participant,
//! which peers are about to discover.

use rustdds::GUID;
use std::{
    collections::HashSet,
    sync::{Mutex, MutexGuard, PoisonError},
    thread,
    time::{Duration, Instant},
};

/// GUID prefix of a participant.
type Prefix = [u8; 12];

/// Time in which a peer learns the existing endpoints; 60 ms were measured.
const SETTLING: Duration = Duration::from_millis(150);
/// How long a new participant waits for the peers that its predecessor knew.
const REDISCOVERY_OF_PEERS: Duration = Duration::from_secs(1);
/// Longest delay of an endpoint, regardless of the number of discovered peers.
const PATIENCE: Duration = Duration::from_secs(2);
/// First bytes of a rustdds GUID, its vendor id. rustdds peers are not affected.
const RUSTDDS_VENDOR: [u8; 2] = [0x01, 0x12];

/// Peers other than rustdds, with the time of the last discovery.
#[derive(Debug, Default)]
pub(super) struct DiscoverySettling {
    inner: Mutex<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    /// Time at which this process created its participant or last discovered such a peer, whichever is later.
    last: Option<Instant>,
    known: HashSet<Prefix>,
    /// Peers that the previous participant of this process knew and the present one has not discovered yet. They are
    /// waited for until `missing_until`.
    missing: HashSet<Prefix>,
    missing_until: Option<Instant>,
}

impl DiscoverySettling {
    /// Records that this process has a new participant, which all peers have to discover.
    pub(super) fn participant_created(&self) {
        let mut inner = self.lock();
        let now = Instant::now();
        inner.last = Some(now);
        inner.missing = std::mem::take(&mut inner.known);
        inner.missing_until = Some(now + REDISCOVERY_OF_PEERS);
    }

    /// Records the discovery of the participant with this GUID.
    pub(super) fn participant_discovered(&self, participant: &GUID) {
        if let Some(prefix) = prefix_of_other(participant.prefix.as_ref()) {
            let mut inner = self.lock();
            inner.last = Some(Instant::now());
            inner.missing.remove(&prefix);
            inner.known.insert(prefix);
        }
    }

    /// Records that the participant with this GUID prefix has left or was lost.
    pub(super) fn participant_lost(&self, prefix: &[u8]) {
        if let Some(prefix) = prefix_of_other(prefix) {
            let mut inner = self.lock();
            inner.missing.remove(&prefix);
            inner.known.remove(&prefix);
        }
    }

    /// Blocks until all peers of the previous participant have been discovered again (at most [`REDISCOVERY_OF_PEERS`]
    /// after the creation of the new one) and no peer has been discovered for [`SETTLING`]; at most [`PATIENCE`].
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
                // The last missing peer may be discovered in the meantime.
                Some(left) if !left.is_zero() => thread::sleep(left.min(SETTLING)),
                _ => return,
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The GUID prefix, unless it belongs to rustdds.
fn prefix_of_other(prefix: &[u8]) -> Option<Prefix> {
    let prefix = Prefix::try_from(prefix).ok()?;
    (prefix[..2] != RUSTDDS_VENDOR).then_some(prefix)
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
        settling.participant_discovered(&guid(RUSTDDS_VENDOR));
        let start = Instant::now();
        settling.wait();
        assert!(start.elapsed() < SETTLING);
        settling.participant_discovered(&guid(OTHER));
        settling.wait();
        assert!(start.elapsed() >= SETTLING);
    }

    // Fails if a new participant creates its endpoints while the peers of the previous one are learning the existing
    // endpoints.
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
        // The second participant did not discover the peer, so the third does not wait for it.
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
