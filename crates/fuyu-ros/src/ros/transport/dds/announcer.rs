//! Publisher of `ros_discovery_info`: the nodes of a participant, and the endpoints of each.

use ros2_client::{
    NodeName as WireNodeName,
    entities_info::{NodeEntitiesInfo, ParticipantEntitiesInfo},
};
use rustdds::{DomainParticipant, QosPolicies, RTPSEntity, TopicKind, no_key::DataWriterCdr};
use std::sync::Arc;

use super::participant_watchdog;
use crate::ros::{
    Gid, Qos,
    endpoint::{Endpoints, Member},
    transport::TransportError,
};

/// Name and type of the DDS topic.
pub(super) const TOPIC: (&str, &str) = (
    "ros_discovery_info",
    "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_",
);

/// Publisher of a participant on `ros_discovery_info`.
pub(super) struct Announcer {
    writer: DataWriterCdr<ParticipantEntitiesInfo>,
    participant: Gid,
}

impl Announcer {
    pub(super) fn new(
        participant: &DomainParticipant,
        publisher: &rustdds::Publisher,
    ) -> Result<Self, TransportError> {
        let qos = QosPolicies::from(&Qos::LATCHED);
        let publisher = publisher.clone();
        let writer = participant_watchdog::create(participant, move |participant| {
            let (name, kind) = (TOPIC.0.to_owned(), TOPIC.1.to_owned());
            let topic = participant.create_topic(name, kind, &qos, TopicKind::NoKey)?;
            publisher.create_datawriter_no_key_cdr(&topic, Some(qos))
        })?;
        Ok(Self {
            writer,
            participant: participant.guid().into(),
        })
    }

    /// Publishes the nodes with their endpoints (from [`nodes`]).
    pub(super) fn publish(&self, nodes: Vec<NodeEntitiesInfo>) {
        let info = ParticipantEntitiesInfo::new(self.participant, nodes);
        // An error means that the participant's threads have ended; the participant is about to be replaced.
        if let Err(e) = self.writer.write(info, Some(rustdds::Timestamp::now())) {
            tracing::debug!("ros_discovery_info of {:?}: {e}", self.participant);
        }
    }
}

/// The nodes of a participant, each with its endpoints.
pub(super) fn nodes(endpoints: &Endpoints) -> Vec<NodeEntitiesInfo> {
    let describe = |node: &Member| {
        let name = WireNodeName::new(node.name.namespace(), node.name.name()).ok()?;
        let mut entities = NodeEntitiesInfo::new(name);
        let writers = endpoints.writers.iter();
        for writer in writers.filter(|w| Arc::ptr_eq(&w.node, &node.name)) {
            if let Some(gid) = writer.gid() {
                entities.add_writer(gid);
            }
        }
        let readers = endpoints.readers.iter();
        for reader in readers.filter(|r| Arc::ptr_eq(&r.node, &node.name)) {
            if let Some(gid) = reader.gid() {
                entities.add_reader(gid);
            }
        }
        Some(entities)
    };
    endpoints.nodes.iter().filter_map(describe).collect()
}
