//! Cache of the graph: names and publishers of the nodes of other participants, from `ros_discovery_info`.
//!
//! ROS allows two nodes with the same name; a service call or parameter change then reaches either of them. So a warning is
//! logged when a node is discovered that has the name of one of this participant.

use rustdds::GUID;
use serde::Deserialize;
use std::{
    collections::HashMap,
    sync::{Mutex, MutexGuard, PoisonError},
};

use super::{Gid, NodeName, announcer::TOPIC};
use crate::msg::cdr::{self, CdrError};

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
    /// Full names of its nodes.
    nodes: Vec<String>,
}

/// Nodes of other participants.
#[derive(Default)]
pub(super) struct GraphCache {
    known: Mutex<Inner>,
}

#[derive(Default)]
struct Inner {
    /// The own participant, whose messages it receives unless it uses loopback only.
    own: Option<Prefix>,
    /// Full names of the nodes of the own participant.
    own_nodes: Vec<String>,
    others: HashMap<Prefix, Participant>,
}

impl GraphCache {
    /// Adds a node of this participant. Returns whether another node of its name is known.
    pub(super) fn add_own_node(&self, node: &NodeName) -> bool {
        let name = node.full();
        let mut known = self.lock();
        let mut all = known.others.values().flat_map(|other| &other.nodes);
        let is_taken = known.own_nodes.contains(&name) || all.any(|other| *other == name);
        known.own_nodes.push(name);
        is_taken
    }

    /// Removes a node of this participant.
    pub(super) fn remove_own_node(&self, node: &NodeName) {
        let name = node.full();
        let own = &mut self.lock().own_nodes;
        if let Some(index) = own.iter().position(|own| *own == name) {
            own.swap_remove(index);
        }
    }

    /// Clears the cache for a new participant, which will receive all messages again.
    pub(super) fn reset(&self, own: Gid) {
        let mut known = self.lock();
        known.own = Some(prefix(own));
        known.others.clear();
    }

    /// Stores the nodes announced by the participant of `publisher`, and warns of those that have the name of a node of this
    /// participant.
    pub(super) fn receive(&self, publisher: Gid, cdr: &[u8]) {
        // What is not valid is no announcement.
        for node in self.update(publisher, cdr).unwrap_or_default() {
            warn_of_namesake(&node);
        }
    }

    /// Returns the names of nodes that have newly been found to be names of this participant's nodes too.
    fn update(&self, publisher: Gid, cdr: &[u8]) -> Result<Vec<String>, CdrError> {
        let ParticipantEntities { nodes, .. } = cdr::decode_as(cdr, TOPIC.1)?;
        let participant = prefix(publisher);
        let mut known = self.lock();
        let Inner {
            own,
            own_nodes,
            others,
        } = &mut *known;
        if *own == Some(participant) {
            return Ok(Vec::new());
        }
        if nodes.is_empty() {
            others.remove(&participant);
            return Ok(Vec::new());
        }
        let names: Vec<_> = nodes.iter().map(NodeEntities::full_name).collect();
        let publishers: Vec<_> = nodes
            .into_iter()
            .flat_map(|node| {
                let name = node.full_name();
                node.writers.into_iter().map(move |gid| (gid, name.clone()))
            })
            // A participant reports its own endpoints only.
            .filter(|(gid, _)| prefix(*gid) == participant)
            .collect();
        let announced = others.entry(participant).or_default();
        announced.publishers = publishers;
        let before = std::mem::replace(&mut announced.nodes, names.clone());
        let is_new = |name: &String| own_nodes.contains(name) && !before.contains(name);
        Ok(names.into_iter().filter(is_new).collect())
    }

    /// Full names of the nodes of the participant with this GUID prefix, as it has announced them.
    pub(super) fn nodes_of(&self, participant: &[u8]) -> Vec<String> {
        let known = self.lock();
        let others = known.others.iter();
        let mut same = others.filter(|(prefix, _)| prefix.as_slice() == participant);
        same.next()
            .map_or_else(Vec::new, |(_, other)| other.nodes.clone())
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

/// Warns that a name belongs to two nodes.
pub(super) fn warn_of_namesake(node: &str) {
    tracing::warn!(
        "node {node}: another node of this name is in the graph, and calls of services and parameters may reach either; \
         rename one (-r __node:=NAME) or namespace (-r __ns:=/NAMESPACE)"
    );
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
        let graph = GraphCache::default();
        graph.reset(gid(1, 0));
        assert!(!graph.add_own_node(&NodeName::new("/chaser", "arm").unwrap()));
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
        assert_eq!(all.update(gid(2, 7), &announced(two)).ok(), Some(vec![]));
        let owner = |publisher| all.node_of(publisher);
        assert_eq!(owner(gid(2, 1)).as_deref(), Some("/alpha"));
        assert_eq!(owner(gid(2, 2)).as_deref(), Some("/chaser/beta"));
        assert_eq!(owner(gid(3, 1)), None, "of another participant");
        assert!(all.update(gid(2, 7), &announced(two)[..40]).is_err());
        assert_eq!(owner(gid(2, 1)).as_deref(), Some("/alpha"));
        assert_eq!(
            all.update(gid(2, 7), &announced(&two[..1])).ok(),
            Some(vec![])
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
        let found = |participant, message: &[u8]| all.update(gid(participant, 7), message).unwrap();
        assert!(found(1, &own).is_empty());
        assert!(found(4, &announced(&[("/", "arm", &[gid(4, 1)])])).is_empty());
        for participant in [2, 3] {
            assert_eq!(found(participant, &own), ["/chaser/arm"]);
            assert!(found(participant, &own).is_empty());
        }
    }

    // Fails if nodes that share the participant are not compared with each other and with those that came before them.
    #[test]
    fn a_node_that_joins_learns_of_its_namesakes() {
        let all = graph();
        let arm = NodeName::new("/chaser", "arm").unwrap();
        let eye = NodeName::new("/chaser", "eye").unwrap();
        assert!(all.add_own_node(&arm), "within the participant");
        all.remove_own_node(&arm);
        let other = announced(&[("/chaser", "eye", &[])]);
        assert!(all.update(gid(2, 7), &other).unwrap().is_empty());
        assert!(all.add_own_node(&eye), "in another participant");
        all.remove_own_node(&eye);
        all.update(gid(2, 7), &announced(&[])).unwrap();
        assert!(!all.add_own_node(&eye));
    }
}
