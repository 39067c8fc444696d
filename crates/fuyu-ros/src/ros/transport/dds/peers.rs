//! Matches of local endpoints with endpoints of other participants, and their processing.

use rustdds::{
    DomainParticipant, DomainParticipantStatusListener, GUID, QosPolicies, RTPSEntity,
    StatusEvented,
    dds::statusevents::{DomainParticipantStatusEvent as Event, LostReason},
};
use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError, atomic::Ordering::Relaxed},
    time::Instant,
};

use super::{
    discovery_settling::DiscoverySettling,
    first_samples::FirstSamples,
    lost_peers::LostPeers,
    new_writers::NewWriters,
    ros_discovery_info,
    rtps_sender::RtpsSender,
    static_peers,
    type_hash_check::{self, TypeHashCheck},
};
use crate::ros::{
    Gid, NodeName, Qos,
    discovery::not_exchanged,
    endpoint::{Counters, EndpointSpec, Endpoints},
    graph_cache::GraphCache,
    transport::RemotePublisher,
};

/// Matches of local endpoints with endpoints of other participants.
pub(super) struct Peers {
    pub(super) first_samples: FirstSamples,
    /// Matches by local endpoint.
    matches: HashMap<Gid, Matches>,
    type_hashes: TypeHashCheck,
    new_writers: NewWriters,
}

/// Remote endpoints that a local endpoint is matched with.
struct Matches {
    local: GUID,
    remotes: HashMap<Gid, Remote>,
}

/// A matched endpoint of another participant.
struct Remote {
    guid: GUID,
    /// Whether the first sample has been requested and the type checked. rustdds may report a match before it has
    /// returned the new endpoint to its creator; these steps wait until the endpoint is known.
    is_handled: bool,
}

impl Peers {
    /// None yet; `rtps` sends them what rustdds does not.
    pub(super) fn new(rtps: Option<Arc<RtpsSender>>) -> Self {
        Self {
            first_samples: FirstSamples::new(rtps),
            matches: HashMap::new(),
            type_hashes: TypeHashCheck::default(),
            new_writers: NewWriters::new(Instant::now()),
        }
    }

    fn matched(&mut self, all: &Endpoints, local: GUID, remote: GUID) {
        // Where a participant receives its own announcements; these endpoints are matched in memory.
        if local.prefix == remote.prefix {
            return;
        }
        let matches = self.matches.entry(local.into()).or_insert_with(|| Matches {
            local,
            remotes: HashMap::new(),
        });
        // Reported again after each change of the peer.
        matches.remotes.entry(remote.into()).or_insert(Remote {
            guid: remote,
            is_handled: false,
        });
        self.update(all, local.into());
        if let Some((node, _, spec)) = find(all, local.into()).next() {
            self.type_hashes.compare(node, spec, remote);
        }
    }

    /// Updates an endpoint of this participant, which may be new, after its matches have changed.
    pub(super) fn update(&mut self, all: &Endpoints, local: Gid) {
        self.count(all, local);
        let Some(matches) = self.matches.get_mut(&local) else {
            return;
        };
        let Some((node, _, spec)) = find(all, local).next() else {
            return;
        };
        let mut readers = all.readers.iter();
        let is_reliable_reader =
            readers.any(|r| r.gid() == Some(local) && r.spec.qos.is_reliable());
        for remote in matches.remotes.values_mut().filter(|r| !r.is_handled) {
            remote.is_handled = true;
            if is_reliable_reader {
                let endpoints = (matches.local, remote.guid);
                let is_new = self.new_writers.is_new(remote.guid, Instant::now());
                (self.first_samples).writer_matched(&spec.dds_topic, endpoints, is_new);
            }
            self.type_hashes.compare(node, spec, remote.guid);
        }
    }

    /// Whether an endpoint of this participant is matched with this one of another.
    pub(super) fn are_matched(&self, local: Gid, remote: Gid) -> bool {
        let matches = self.matches.get(&local);
        matches.is_some_and(|m| m.remotes.contains_key(&remote))
    }

    /// Forgets an endpoint of this participant that has been removed.
    pub(super) fn forget(&mut self, local: Gid) {
        self.matches.remove(&local);
    }

    fn lost(&mut self, all: &Endpoints, is_lost: impl Fn(&GUID) -> bool) {
        for matches in self.matches.values_mut() {
            matches.remotes.retain(|_, remote| !is_lost(&remote.guid));
        }
        self.new_writers.writers_lost(&is_lost);
        self.type_hashes.remove_endpoints(is_lost);
        for &local in self.matches.keys() {
            self.count(all, local);
        }
    }

    /// Stores the peers of an endpoint of this participant in its counters, and releases what a writer holds for them.
    fn count(&self, all: &Endpoints, local: Gid) {
        let Some(matches) = self.matches.get(&local) else {
            return;
        };
        let peers: Vec<Gid> = matches.remotes.keys().copied().collect();
        for (_, counters, _) in find(all, local) {
            counters.remote.store(peers.len(), Relaxed);
            let mut stored = counters
                .peers
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            stored.clone_from(&peers);
        }
        for writer in all.writers.iter().filter(|w| w.gid() == Some(local)) {
            writer.held.release(&peers);
        }
    }
}

/// How many status events rustdds keeps until they are processed.
const EVENTS_KEPT: usize = 2048;

/// Processes the status events of the participant.
pub(super) fn report_status(
    listener: &DomainParticipantStatusListener,
    endpoints: &Mutex<Endpoints>,
    peers: &mut Peers,
    (graph, settling, lost_peers): (&GraphCache, &DiscoverySettling, &LostPeers),
) {
    let mut count = 0;
    while let Some(event) = listener.try_recv_status() {
        let all = endpoints.lock().unwrap_or_else(PoisonError::into_inner);
        count += 1;
        if count == EVENTS_KEPT {
            // rustdds may have discarded some.
            for writer in &all.writers {
                writer.count_is_unsure.store(true, Relaxed);
            }
        }
        match event {
            Event::ParticipantDiscovered { dpd }
                if static_peers::is_placeholder(dpd.guid.prefix.as_ref()) => {}
            Event::ParticipantDiscovered { dpd } => {
                lost_peers.discovered(&dpd.guid);
                settling.participant_discovered(&dpd.guid);
                (peers.new_writers).participant_discovered(dpd.guid, Instant::now());
            }
            Event::ReaderDetected { reader: found } => {
                (peers.type_hashes).endpoint_discovered(found.guid, &found.user_data);
            }
            Event::WriterDetected { writer: found } => {
                (peers.new_writers).writer_discovered(found.guid, Instant::now());
                (peers.type_hashes).endpoint_discovered(found.guid, &found.user_data);
            }
            Event::RemoteReaderMatched {
                local_writer,
                remote_reader,
            } => peers.matched(&all, local_writer, remote_reader),
            Event::RemoteWriterMatched {
                local_reader,
                remote_writer,
            } => peers.matched(&all, local_reader, remote_writer),
            Event::ReaderLost { guid, .. } | Event::WriterLost { guid, .. } => {
                peers.lost(&all, |g| *g == guid);
            }
            Event::ParticipantLost { id, reason } => {
                if let LostReason::Timeout { .. } = reason {
                    lost_peers.lost(id.as_ref(), &graph.nodes_of(id.as_ref()));
                }
                settling.participant_lost(id.as_ref());
                peers.lost(&all, |g| g.prefix == id);
                (peers.new_writers).participant_lost(std::array::from_fn(|i| id.as_ref()[i]));
                ros_discovery_info::remove_participants(graph, |g| g.prefix == id);
            }
            Event::RemoteReaderQosIncompatible {
                local_writer,
                requested_qos,
                offered_qos,
                ..
            } => warn_incompatible(&all, local_writer.into(), &offered_qos, &requested_qos),
            Event::RemoteWriterQosIncompatible {
                local_reader,
                requested_qos,
                offered_qos,
                ..
            } => warn_incompatible(&all, local_reader.into(), &offered_qos, &requested_qos),
            _ => {}
        }
    }
}

/// The endpoints with a GID: several nodes may share one.
fn find(all: &Endpoints, gid: Gid) -> impl Iterator<Item = (&NodeName, &Counters, &EndpointSpec)> {
    let writers = all.writers.iter().filter(move |w| w.gid() == Some(gid));
    let readers = all.readers.iter().filter(move |r| r.gid() == Some(gid));
    writers
        .map(|w| (&*w.node, &w.counters, &w.spec))
        .chain(readers.map(|r| (&*r.node, &r.counters, &r.spec)))
}

fn warn_incompatible(all: &Endpoints, local: Gid, offered: &QosPolicies, requested: &QosPolicies) {
    if let Some((node, _, spec)) = find(all, local).next() {
        let (offered, requested) = (Qos::from(offered), Qos::from(requested));
        tracing::warn!(
            "node {node}: {}",
            not_exchanged(&spec.name, &offered, &requested)
        );
    }
}

/// The publishers of other participants.
pub(super) fn publishers(participant: &DomainParticipant) -> Vec<RemotePublisher> {
    let own = participant.guid().prefix;
    let writers = participant.discovered_writers();
    // Where a participant receives its own announcements.
    let others = (writers.iter()).filter(|w| w.publication_topic_data.key.prefix != own);
    let describe = |writer: &rustdds::discovery::DiscoveredWriterData| {
        let data = &writer.publication_topic_data;
        RemotePublisher {
            dds_topic: data.topic_name.clone(),
            dds_type: data.type_name.clone(),
            qos: Qos::from(&data.qos()),
            type_hash: type_hash_check::hash_in_user_data(&writer.user_data),
            gid: data.key.into(),
        }
    };
    others.map(describe).collect()
}
