//! Discovery: announces the endpoints of this node to peers, and follows theirs.

use ros2_client::{
    NodeName as WireNodeName,
    entities_info::{NodeEntitiesInfo, ParticipantEntitiesInfo},
};
use rustdds::{
    DomainParticipant, DomainParticipantStatusListener, GUID, QosPolicies, RTPSEntity,
    StatusEvented, TopicKind, dds::statusevents::DomainParticipantStatusEvent as Event,
    no_key::DataWriterCdr,
};
use std::{
    collections::{BTreeSet, HashMap, HashSet},
    sync::{Arc, Mutex, PoisonError, atomic::Ordering::Relaxed},
};

use super::{
    Gid, NodeName, Qos,
    discovery_settling::DiscoverySettling,
    endpoint::{Counters, EndpointSpec, Endpoints},
    first_samples::FirstSamples,
    graph_cache::GraphCache,
    participant_watchdog::{self, EntityError},
    rtps_sender::RtpsSender,
    type_hash_check::{self, TypeHashCheck},
};

/// Publishes `ros_discovery_info`: a participant, its node, and what belongs to it.
pub(super) struct Announcer {
    writer: DataWriterCdr<ParticipantEntitiesInfo>,
    participant: Gid,
    node: WireNodeName,
    writers: BTreeSet<Gid>,
    readers: BTreeSet<Gid>,
}

impl Announcer {
    pub(super) fn new(
        participant: &DomainParticipant,
        publisher: &rustdds::Publisher,
        node: &NodeName,
    ) -> Result<Self, EntityError> {
        let qos = QosPolicies::from(&Qos::LATCHED);
        let publisher = publisher.clone();
        let writer = participant_watchdog::create(participant, move |participant| {
            let topic = participant.create_topic(
                "ros_discovery_info".to_owned(),
                "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_".to_owned(),
                &qos,
                TopicKind::NoKey,
            )?;
            publisher.create_datawriter_no_key_cdr(&topic, Some(qos))
        })?;
        let node = WireNodeName::new(node.namespace(), node.name()).map_err(EntityError::dds)?;
        Ok(Self {
            writers: BTreeSet::from([Gid::from(writer.guid())]),
            readers: BTreeSet::new(),
            writer,
            participant: participant.guid().into(),
            node,
        })
    }

    pub(super) fn add_writer(&mut self, gid: Gid) {
        self.writers.insert(gid);
    }

    pub(super) fn add_reader(&mut self, gid: Gid) {
        self.readers.insert(gid);
    }

    pub(super) fn forget(&mut self, gid: Gid) {
        self.writers.remove(&gid);
        self.readers.remove(&gid);
    }

    /// Publishes the present endpoints of the node.
    pub(super) fn announce(&self) {
        let mut node = NodeEntitiesInfo::new(self.node.clone());
        self.writers.iter().for_each(|&gid| node.add_writer(gid));
        self.readers.iter().for_each(|&gid| node.add_reader(gid));
        self.publish(vec![node]);
    }

    /// Publishes that the participant has no nodes any more.
    pub(super) fn leave(&self) {
        self.publish(Vec::new());
    }

    fn publish(&self, nodes: Vec<NodeEntitiesInfo>) {
        let info = ParticipantEntitiesInfo::new(self.participant, nodes);
        // A participant whose threads have ended takes nothing more; it is about to be replaced.
        if let Err(e) = self.writer.write(info, Some(rustdds::Timestamp::now())) {
            tracing::debug!("ros_discovery_info of {:?}: {e}", self.node);
        }
    }
}

/// The endpoints of other participants.
pub(super) struct Peers {
    pub(super) first_samples: FirstSamples,
    /// Those that each of this node's is matched with.
    matches: HashMap<Gid, HashSet<GUID>>,
    type_hashes: TypeHashCheck,
}

impl Peers {
    /// None yet; `rtps` sends them what rustdds does not.
    pub(super) fn new(rtps: Option<Arc<RtpsSender>>) -> Self {
        Self {
            first_samples: FirstSamples::new(rtps),
            matches: HashMap::new(),
            type_hashes: TypeHashCheck::default(),
        }
    }

    fn matched(&mut self, node: &NodeName, all: &Endpoints, local: GUID, remote: GUID) {
        let (guid, local) = (local, Gid::from(local));
        // Reported again after each change of the peer.
        let is_new = self.matches.entry(local).or_default().insert(remote);
        self.count(all, local);
        let reader = all.readers.iter().find(|r| r.gid() == Some(local));
        let reader = reader.filter(|reader| is_new && reader.spec.qos.is_reliable());
        if let Some(reader) = reader {
            (self.first_samples).writer_matched(&reader.spec.dds_topic, guid, remote);
        }
        if let Some((_, spec)) = find(all, local) {
            self.type_hashes.compare(node, spec, remote);
        }
    }

    fn lost(&mut self, all: &Endpoints, is_lost: impl Fn(&GUID) -> bool) {
        let matches = &mut self.matches;
        matches.values_mut().for_each(|r| r.retain(|g| !is_lost(g)));
        self.type_hashes.remove_endpoints(is_lost);
        self.matches
            .keys()
            .for_each(|&local| self.count(all, local));
    }

    fn count(&self, all: &Endpoints, local: Gid) {
        if let Some((counters, _)) = find(all, local) {
            let peers = &self.matches[&local];
            counters.matched.store(peers.len(), Relaxed);
            *counters
                .peers
                .lock()
                .unwrap_or_else(PoisonError::into_inner) =
                peers.iter().map(|&guid| guid.into()).collect();
        }
        if let Some(writer) = all.writers.iter().find(|w| w.gid() == Some(local)) {
            let peers: Vec<_> = self.matches[&local].iter().map(|&g| g.into()).collect();
            writer.held.release(&peers);
        }
    }
}

/// Processes the status events of the participant.
pub(super) fn report_status(
    listener: &DomainParticipantStatusListener,
    node: &NodeName,
    endpoints: &Mutex<Endpoints>,
    peers: &mut Peers,
    (graph, settling): (&GraphCache, &DiscoverySettling),
) {
    while let Some(event) = listener.try_recv_status() {
        let all = endpoints.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            Event::ParticipantDiscovered { dpd } => settling.participant_discovered(&dpd.guid),
            Event::ReaderDetected { reader: found } | Event::WriterDetected { writer: found } => {
                peers
                    .type_hashes
                    .endpoint_discovered(found.guid, &found.user_data);
            }
            Event::RemoteReaderMatched {
                local_writer,
                remote_reader,
            } => peers.matched(node, &all, local_writer, remote_reader),
            Event::RemoteWriterMatched {
                local_reader,
                remote_writer,
            } => peers.matched(node, &all, local_reader, remote_writer),
            Event::ReaderLost { guid, .. } | Event::WriterLost { guid, .. } => {
                peers.lost(&all, |g| *g == guid);
            }
            Event::ParticipantLost { id, .. } => {
                peers.lost(&all, |g| g.prefix == id);
                graph.remove_participants(|g| g.prefix == id);
            }
            Event::RemoteReaderQosIncompatible {
                local_writer,
                requested_qos,
                offered_qos,
                ..
            } => warn_incompatible(
                node,
                &all,
                local_writer.into(),
                &offered_qos,
                &requested_qos,
            ),
            Event::RemoteWriterQosIncompatible {
                local_reader,
                requested_qos,
                offered_qos,
                ..
            } => warn_incompatible(
                node,
                &all,
                local_reader.into(),
                &offered_qos,
                &requested_qos,
            ),
            _ => {}
        }
    }
}

fn find(all: &Endpoints, gid: Gid) -> Option<(&Counters, &EndpointSpec)> {
    let writer = all.writers.iter().find(|w| w.gid() == Some(gid));
    if let Some(writer) = writer {
        return Some((&writer.counters, &writer.spec));
    }
    let reader = all.readers.iter().find(|r| r.gid() == Some(gid))?;
    Some((&reader.counters, &reader.spec))
}

fn warn_incompatible(
    node: &NodeName,
    all: &Endpoints,
    local: Gid,
    offered: &QosPolicies,
    requested: &QosPolicies,
) {
    let Some((_, spec)) = find(all, local) else {
        return;
    };
    let (offered, requested) = (Qos::from(offered), Qos::from(requested));
    tracing::warn!(
        "node {node}: topic {} is not exchanged with a peer: {:?} and {:?} are offered, {:?} and {:?} \
         are requested",
        spec.name,
        offered.reliability,
        offered.durability,
        requested.reliability,
        requested.durability
    );
}

/// A publisher of another participant.
#[derive(Debug, Clone, PartialEq)]
pub struct DiscoveredPublisher {
    /// Full topic name.
    pub topic: String,
    /// ROS type, `pkg/msg/Name`.
    pub type_name: String,
    /// Offered QoS.
    pub qos: Qos,
    /// Hash of its definition of the type, if it states one.
    pub type_hash: Option<String>,
    /// Identity of the publisher.
    pub gid: Gid,
}

/// Every ROS topic publisher of other participants but those of hidden topics (a part of the name begins with
/// `_`, as those of actions do). What has the prefix of ROS but not its form is left out; `strange` remembers
/// what was warned of.
pub(super) fn publishers(
    participant: &DomainParticipant,
    node: &NodeName,
    warned_topics: &mut BTreeSet<(String, String)>,
) -> Vec<DiscoveredPublisher> {
    let mut publishers = Vec::new();
    for writer in participant.discovered_writers() {
        let data = &writer.publication_topic_data;
        let Some(topic) = ros_topic(&data.topic_name).filter(|topic| !topic.contains("/_")) else {
            continue;
        };
        let type_name = ros_type(&data.type_name).filter(|_| node.expand(topic).is_ok());
        if let Some(type_name) = type_name {
            publishers.push(DiscoveredPublisher {
                topic: topic.to_owned(),
                type_name,
                qos: Qos::from(&data.qos()),
                type_hash: type_hash_check::hash_in_user_data(&writer.user_data),
                gid: data.key.into(),
            });
        } else if warned_topics.insert((data.topic_name.clone(), data.type_name.clone())) {
            tracing::warn!(
                "node {node}: topic {topic} of type {}, published by a peer, is ignored: name or type \
                 is not valid in ROS",
                data.type_name
            );
        }
    }
    publishers
}

/// `rt/name` to `/name`; `None` for DDS topics that are not ROS topics.
fn ros_topic(dds: &str) -> Option<&str> {
    dds.strip_prefix("rt").filter(|name| name.starts_with('/'))
}

/// `pkg::msg::dds_::Name_` to `pkg/msg/Name`.
pub(super) fn ros_type(dds: &str) -> Option<String> {
    let (path, name) = dds.rsplit_once("::dds_::")?;
    let (package, kind) = path.split_once("::")?;
    let name = name.strip_suffix('_')?;
    let is_word = |s: &str| {
        let ok = |c: char| c.is_ascii_alphanumeric() || c == '_';
        s.starts_with(|c: char| c.is_ascii_alphabetic()) && s.chars().all(ok)
    };
    [package, kind, name]
        .into_iter()
        .all(is_word)
        .then(|| format!("{package}/{kind}/{name}"))
}

/// `pkg/msg/Name` to `pkg::msg::dds_::Name_`.
pub(super) fn dds_type(ros: &str) -> Option<String> {
    let mut parts = ros.split('/');
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(package), Some(kind), Some(name), None) => {
            Some(format!("{package}::{kind}::dds_::{name}_"))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn type_names_cross_over_and_back() {
        let dds = "sensor_msgs::msg::dds_::JointState_";
        assert_eq!(ros_type(dds).unwrap(), "sensor_msgs/msg/JointState");
        assert_eq!(dds_type("sensor_msgs/msg/JointState").unwrap(), dds);
        assert_eq!(dds_type("JointState"), None);
        for strange in [
            "a::b::msg::dds_::C_",
            "msg::dds_::C_",
            "a::msg::dds_::C",
            "a::msg::C",
        ] {
            assert_eq!(ros_type(strange), None);
        }
        // A name of plain DDS that only begins like one of ROS.
        assert_eq!(ros_topic("rtk_fix"), None);
        assert_eq!(ros_topic("rt/fix"), Some("/fix"));
    }
}
