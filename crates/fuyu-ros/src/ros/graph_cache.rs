//! Cache of the graph: names and publishers of the nodes of other participants, from `ros_discovery_info`.
//!
//! ROS allows two nodes with the same name; a service call or parameter change then reaches either of them. So a node that
//! discovers another one of its own name logs a warning.

use rustdds::GUID;
use serde::Deserialize;
use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::{
    Gid, NodeError, NodeName, Qos, RawSample,
    endpoint::{Counters, EndpointSpec},
    node_core::NodeCore,
};
use crate::msg::cdr::{self, CdrError};

const TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";

/// Depth of the subscription: participants whose messages may wait.
const QUEUE_DEPTH: usize = 100;

/// `rmw_dds_common/ParticipantEntitiesInfo`.
#[derive(Deserialize)]
struct ParticipantEntities {
    #[expect(
        dead_code,
        reason = "the sender is known from the sample and cannot be forged"
    )]
    gid: Gid,
    nodes: Vec<NodeEntities>,
}

#[derive(Deserialize)]
struct NodeEntities {
    namespace: String,
    name: String,
    #[expect(dead_code, reason = "precedes the field that is read")]
    readers: Vec<Gid>,
    writers: Vec<Gid>,
}

impl NodeEntities {
    /// Full name; names of other nodes have not been checked by [`NodeName::new`].
    fn full_name(&self) -> String {
        format!("{}/{}", self.namespace.trim_end_matches('/'), self.name)
    }
}

/// GUID prefix that all endpoints of a participant share.
type Prefix = [u8; 12];

fn prefix(gid: Gid) -> Prefix {
    let bytes = gid.to_bytes16();
    std::array::from_fn(|i| bytes[i])
}

#[derive(Default)]
struct Participant {
    /// Publishers, with the full names of their nodes.
    publishers: Vec<(Gid, String)>,
    has_namesake: bool,
}

/// Nodes of other participants.
pub(super) struct GraphCache {
    node: String,
    known: Mutex<Inner>,
}

#[derive(Default)]
struct Inner {
    /// The node's own participant, whose messages it receives unless it uses loopback only.
    own: Option<Prefix>,
    others: HashMap<Prefix, Participant>,
}

impl GraphCache {
    /// An empty cache for a node.
    pub(super) fn new(node: &NodeName) -> Self {
        Self {
            node: node.full(),
            known: Mutex::default(),
        }
    }

    /// Subscribes to `ros_discovery_info`.
    pub(super) fn subscribe(core: &Arc<NodeCore>) -> Result<(), NodeError> {
        let spec = EndpointSpec {
            name: "ros_discovery_info".to_owned(),
            dds_topic: "ros_discovery_info".to_owned(),
            dds_type: TYPE.to_owned(),
            qos: Qos::LATCHED.depth(QUEUE_DEPTH),
            definition: None,
            internal: true,
        };
        let graph = Arc::clone(&core.graph);
        let sink = move |sample: RawSample, _: &Counters| {
            let taken = graph.update(sample.publisher, &sample.cdr);
            if let Ok(true) = taken {
                tracing::warn!(
                    "node {}: another node of this name is in the graph, and calls of services and parameters may \
                     reach either; rename one (-r __node:=NAME) or namespace (-r __ns:=/NAMESPACE)",
                    graph.node
                );
            }
            taken.is_ok()
        };
        core.add_reader(spec, Box::new(sink)).map(drop)
    }

    /// Clears the cache for a new participant, which will receive all messages again.
    pub(super) fn reset(&self, own: Gid) {
        *self.lock() = Inner {
            own: Some(prefix(own)),
            others: HashMap::new(),
        };
    }

    /// Stores the nodes announced by the participant of `publisher`. Returns whether one of them has this node's name
    /// and none had before.
    fn update(&self, publisher: Gid, cdr: &[u8]) -> Result<bool, CdrError> {
        let ParticipantEntities { nodes, .. } = cdr::decode_as(cdr, TYPE)?;
        let participant = prefix(publisher);
        let mut known = self.lock();
        if known.own == Some(participant) {
            return Ok(false);
        }
        let has_namesake = nodes.iter().any(|node| node.full_name() == self.node);
        let publishers: Vec<_> = nodes
            .into_iter()
            .flat_map(|node| {
                let name = node.full_name();
                node.writers.into_iter().map(move |gid| (gid, name.clone()))
            })
            // A participant reports its own endpoints only.
            .filter(|(gid, _)| prefix(*gid) == participant)
            .collect();
        if publishers.is_empty() && !has_namesake {
            known.others.remove(&participant);
            return Ok(false);
        }
        let announced = known.others.entry(participant).or_default();
        announced.publishers = publishers;
        Ok(has_namesake && !std::mem::replace(&mut announced.has_namesake, has_namesake))
    }

    /// Removes participants that have left or died.
    pub(super) fn remove_participants(&self, is_lost: impl Fn(&GUID) -> bool) {
        let any_endpoint = |prefix: &Prefix| {
            let mut bytes = [0; 16];
            bytes[..12].copy_from_slice(prefix);
            GUID::from_bytes(bytes)
        };
        let others = &mut self.lock().others;
        others.retain(|prefix, _| !is_lost(&any_endpoint(prefix)));
    }

    /// Full name of the node that `publisher` belongs to, if it is known.
    pub(super) fn node_of(&self, publisher: Gid) -> Option<String> {
        let known = self.lock();
        let announced = known.others.get(&prefix(publisher))?;
        let mut all = announced.publishers.iter();
        let (_, name) = all.find(|(gid, _)| *gid == publisher)?;
        Some(name.clone())
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ros2_client::{
        NodeName as WireNodeName,
        entities_info::{NodeEntitiesInfo, ParticipantEntitiesInfo},
    };

    /// Endpoint `entity` of participant `participant`.
    fn gid(participant: u8, entity: u8) -> Gid {
        let mut bytes = [participant; 16];
        bytes[12..].fill(entity);
        bytes.into()
    }

    /// The announcement of a participant: namespace, name and publishers of each node.
    fn announced(nodes: &[(&str, &str, &[Gid])]) -> Vec<u8> {
        let nodes = nodes.iter().map(|(namespace, name, writers)| {
            let mut node = NodeEntitiesInfo::new(WireNodeName::new(namespace, name).unwrap());
            writers.iter().for_each(|&gid| node.add_writer(gid));
            node
        });
        let announced = ParticipantEntitiesInfo::new(gid(9, 9), nodes.collect());
        let body = cdr_encoding::to_vec::<_, byteorder::LittleEndian>(&announced).unwrap();
        [&[0, 1, 0, 0], body.as_slice()].concat()
    }

    fn graph() -> GraphCache {
        let graph = GraphCache::new(&NodeName::new("/chaser", "arm").unwrap());
        graph.reset(gid(1, 0));
        graph
    }

    // Would break if a publisher kept a node that is gone, or could be claimed by somebody else.
    #[test]
    fn publishers_belong_to_the_nodes_that_tell_of_them() {
        let all = graph();
        let two: &[(&str, &str, &[Gid])] = &[
            ("/", "alpha", &[gid(2, 1), gid(3, 1)]),
            ("/chaser", "beta", &[gid(2, 2)]),
        ];
        assert_eq!(all.update(gid(2, 7), &announced(two)).ok(), Some(false));
        let owner = |publisher| all.node_of(publisher);
        assert_eq!(owner(gid(2, 1)).as_deref(), Some("/alpha"));
        assert_eq!(owner(gid(2, 2)).as_deref(), Some("/chaser/beta"));
        assert_eq!(owner(gid(3, 1)), None, "of another participant");
        assert!(all.update(gid(2, 7), &announced(two)[..40]).is_err());
        assert_eq!(owner(gid(2, 1)).as_deref(), Some("/alpha"));
        assert_eq!(
            all.update(gid(2, 7), &announced(&two[..1])).ok(),
            Some(false)
        );
        assert_eq!(owner(gid(2, 2)), None);
        all.update(gid(3, 7), &announced(&[("/", "gamma", &[gid(3, 1)])]))
            .unwrap();
        all.remove_participants(|guid| Gid::from(*guid).to_bytes16()[0] == 2);
        assert_eq!(owner(gid(2, 1)), None);
        assert_eq!(owner(gid(3, 1)).as_deref(), Some("/gamma"));
        all.update(gid(3, 7), &announced(&[])).unwrap();
        assert!(all.lock().others.is_empty());
    }

    // Would break if a node took itself for another, or warned with every message.
    #[test]
    fn a_namesake_is_new_once() {
        let all = graph();
        let own = announced(&[("/chaser", "arm", &[])]);
        assert_eq!(all.update(gid(1, 7), &own).ok(), Some(false));
        let elsewhere = announced(&[("/", "arm", &[gid(4, 1)])]);
        assert_eq!(all.update(gid(4, 7), &elsewhere).ok(), Some(false));
        for participant in [2, 3] {
            assert_eq!(all.update(gid(participant, 7), &own).ok(), Some(true));
            assert_eq!(all.update(gid(participant, 7), &own).ok(), Some(false));
        }
    }
}
