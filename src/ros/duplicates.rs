//! Other nodes of the same name. ROS lets them be, and whoever calls a service or sets a parameter then reaches one
//! of them by chance; so a node that hears of a namesake says so.

use byteorder::LittleEndian;
use ros2_client::entities_info::ParticipantEntitiesInfo;
use std::{
    collections::BTreeSet,
    sync::{Arc, Mutex, PoisonError},
};

use super::{
    Gid, NodeError, NodeName, Qos, RawSample,
    endpoint::{Counters, EndpointSpec},
    node::Core,
};

/// What all endpoints of a participant have in common.
fn participant(gid: Gid) -> [u8; 12] {
    let bytes = gid.to_bytes16();
    std::array::from_fn(|i| bytes[i])
}

/// Listens to what other participants say of their nodes, and warns once of each that has one with this node's name.
pub(super) fn watch(core: &Arc<Core>) -> Result<(), NodeError> {
    let spec = EndpointSpec {
        name: "ros_discovery_info".to_owned(),
        dds_topic: "ros_discovery_info".to_owned(),
        dds_type: "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_".to_owned(),
        qos: Qos::LATCHED,
        internal: true,
    };
    let node = core.names.node().clone();
    let told = Mutex::new(BTreeSet::new());
    let weak = Arc::downgrade(core);
    let sink = move |sample: RawSample, _: &Counters| {
        let whose = participant(sample.publisher);
        let Some(core) = weak.upgrade() else {
            return true;
        };
        if is_ours(&core, whose) || !has_namesake(&sample, &node) {
            return true;
        }
        let mut told = told.lock().unwrap_or_else(PoisonError::into_inner);
        if told.insert(whose) {
            tracing::warn!(
                "node {node}: another node of this name is in the graph, and services and parameters reach either of \
                 them; give one another name (-r __node:=NAME) or namespace (-r __ns:=/NAMESPACE)"
            );
        }
        true
    };
    core.add_reader(spec, Box::new(sink)).map(drop)
}

/// Whether the node's own participant is meant, which it hears where there is more than loopback.
fn is_ours(core: &Core, whose: [u8; 12]) -> bool {
    let all = core
        .endpoints
        .lock()
        .unwrap_or_else(PoisonError::into_inner);
    // The one that hears this is among them.
    all.readers
        .iter()
        .filter_map(|reader| reader.gid())
        .any(|gid| participant(gid) == whose)
}

fn has_namesake(sample: &RawSample, node: &NodeName) -> bool {
    // All that speak ROS today are little-endian; what is not understood is no namesake.
    let body = sample.cdr.get(4..).unwrap_or_default();
    let info = cdr_encoding::from_bytes::<ParticipantEntitiesInfo, LittleEndian>(body);
    info.is_ok_and(|(info, _)| {
        let others = info.nodes().iter();
        others
            .map(|other| (other.namespace(), other.name()))
            .any(|other| other == (node.namespace(), node.name()))
    })
}
