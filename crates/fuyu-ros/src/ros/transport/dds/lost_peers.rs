//! Peers that were lost without leaving and return later, after a network interruption longer than their lease.
//!
//! When such a participant is discovered again, rustdds puts its endpoints back into the discovery database, but does
//! not match them with local readers and writers (docs/upstream.md). The peer, whose lease for this participant may be
//! longer, does not announce them again. A new participant here is new to the peer as well, so both discover each other
//! completely. Announcements of Fast DDS keep their sequence number, so rustdds takes those of a returning peer for
//! duplicates and does not discover the peer at all. A scout (a further participant without endpoints) does discover
//! it.

use rustdds::{
    DomainParticipant, GUID, StatusEvented,
    dds::statusevents::DomainParticipantStatusEvent as Event,
};
use std::{
    collections::HashMap,
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// How long a lost peer is remembered.
const REMEMBERED: Duration = Duration::from_secs(86_400);

/// GUID prefix of a participant.
type Prefix = [u8; 12];

/// Participants that one DDS participant has lost.
#[derive(Default)]
pub(super) struct LostPeers {
    inner: Mutex<Inner>,
}

#[derive(Default)]
struct Inner {
    /// Time of the loss of each participant, and its nodes.
    lost: HashMap<Prefix, (Instant, String)>,
    /// Log text about the first peer that has returned.
    returned: Option<String>,
    /// Discovers returning peers; created after the last loss.
    scout: Option<DomainParticipant>,
    /// Whether a peer was lost after the scout was created: the scout may have known and lost that peer too.
    needs_scout: bool,
}

impl LostPeers {
    /// Records the end of the lease of a participant with these nodes.
    pub(super) fn lost(&self, participant: &[u8], nodes: &[String]) {
        let Ok(prefix) = Prefix::try_from(participant) else {
            return;
        };
        let names = match nodes {
            [] => "a DDS participant without nodes".to_owned(),
            nodes => nodes.join(", "),
        };
        const CAUSE: &str = "nothing has arrived for the time of the lease; the network is interrupted, or the process has died";
        // A participant without nodes may be one whose nodes have not been announced yet.
        match nodes {
            [] => tracing::info!("lost {names}: {CAUSE}"),
            _ => tracing::warn!("lost {names}: {CAUSE}"),
        }
        let mut inner = self.lock();
        // Most of those that do not return within a day have died.
        inner.lost.retain(|_, (at, _)| at.elapsed() < REMEMBERED);
        inner.lost.insert(prefix, (Instant::now(), names));
        inner.needs_scout = true;
    }

    /// Records the discovery of a participant, which may be a lost one.
    pub(super) fn discovered(&self, participant: &GUID) {
        let Ok(prefix) = Prefix::try_from(participant.prefix.as_ref()) else {
            return;
        };
        let mut inner = self.lock();
        if let Some((since, names)) = inner.lost.remove(&prefix) {
            let seconds = since.elapsed().as_secs_f64();
            let reason = format!("{names} returned {seconds:.0} s after the end of the lease");
            inner.returned.get_or_insert(reason);
        }
    }

    /// Log text about the first lost peer that has returned; reported once. Creates a scout with `create` if one is
    /// needed.
    pub(super) fn take_returned(
        &self,
        create: impl FnOnce() -> Result<DomainParticipant, String>,
    ) -> Option<String> {
        let mut inner = self.lock();
        let is_needed = std::mem::take(&mut inner.needs_scout);
        let scout = match is_needed {
            true => inner.scout.take(),
            false => inner.scout.clone(),
        };
        drop(inner);
        if let Some(scout) = scout {
            let events = scout.status_listener();
            while let Some(event) = events.try_recv_status() {
                if let Event::ParticipantDiscovered { dpd } = event {
                    self.discovered(&dpd.guid);
                }
            }
        }
        if is_needed {
            match create() {
                Ok(scout) => self.lock().scout = Some(scout),
                Err(e) => tracing::warn!("lost peers may not be noticed when they return: {e}"),
            }
        }
        self.lock().returned.take()
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if a new peer counts as returning, or if a loss is reported twice.
    #[test]
    fn only_a_lost_peer_returns_and_once_per_loss() {
        let guid = |n| GUID::from_bytes([n; 16]);
        let returned = |peers: &LostPeers| peers.take_returned(|| Err("no scout".to_owned()));
        let peers = LostPeers::default();
        peers.discovered(&guid(1));
        assert_eq!(returned(&peers), None);
        for _ in 0..2 {
            peers.lost(&[1; 12], &["/arm".to_owned()]);
            peers.discovered(&guid(2));
            assert_eq!(returned(&peers), None);
            peers.discovered(&guid(1));
            peers.discovered(&guid(1));
            let reason = returned(&peers).unwrap();
            assert!(reason.starts_with("/arm returned"), "{reason}");
            assert_eq!(returned(&peers), None);
        }
    }
}
