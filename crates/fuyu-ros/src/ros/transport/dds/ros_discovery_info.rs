//! Received `ros_discovery_info`: the nodes of other participants, and the publishers of each.

use rustdds::GUID;
use serde::Deserialize;

use super::announcer::TOPIC;
use crate::{
    msg::cdr::{self, CdrError},
    ros::{
        Gid,
        graph_cache::{GraphCache, warn_of_namesake},
    },
};

/// The message `rmw_dds_common/ParticipantEntitiesInfo`.
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
    /// Full name of the node. Names from other participants are not validated.
    fn full_name(&self) -> String {
        format!("{}/{}", self.namespace.trim_end_matches('/'), self.name)
    }
}

/// GUID prefix: common to all endpoints of a participant.
type Prefix = [u8; 12];

fn prefix(gid: Gid) -> Prefix {
    let bytes = gid.to_bytes16();
    std::array::from_fn(|i| bytes[i])
}

/// Clears the graph cache for a new participant with this GUID, which will receive all announcements again.
pub(super) fn reset(graph: &GraphCache, participant: GUID) {
    graph.reset(&prefix(participant.into()));
}

/// Stores the nodes announced by the participant of `publisher`, and warns if one has the name of a node of this
/// participant.
pub(super) fn receive(graph: &GraphCache, publisher: Gid, cdr: &[u8]) {
    // Invalid bytes are ignored.
    for node in update(graph, publisher, cdr).unwrap_or_default() {
        warn_of_namesake(&node);
    }
}

/// Returns names that are newly found to be the names of nodes of this participant as well.
fn update(graph: &GraphCache, publisher: Gid, cdr: &[u8]) -> Result<Vec<String>, CdrError> {
    let ParticipantEntities { nodes, .. } = cdr::decode_as(cdr, TOPIC.1)?;
    let participant = prefix(publisher);
    let nodes = nodes.into_iter().map(|node| {
        let name = node.full_name();
        let writers = node.writers.into_iter();
        // A participant may announce only its own endpoints.
        (
            name,
            writers.filter(|gid| prefix(*gid) == participant).collect(),
        )
    });
    Ok(graph.replace(&participant, nodes.collect()))
}

/// Removes participants that have left or died.
pub(super) fn remove_participants(graph: &GraphCache, is_lost: impl Fn(&GUID) -> bool) {
    graph.remove_participants(|prefix| {
        let mut any_endpoint = [0; 16];
        any_endpoint[..12].copy_from_slice(prefix);
        is_lost(&GUID::from_bytes(any_endpoint))
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::NodeName;
    use ros2_client::{
        NodeName as WireNodeName,
        entities_info::{NodeEntitiesInfo, ParticipantEntitiesInfo},
    };

    /// GID of endpoint `entity` of participant `participant`.
    fn gid(participant: u8, entity: u8) -> Gid {
        let mut bytes = [participant; 16];
        bytes[12..].fill(entity);
        bytes.into()
    }

    /// Serialized announcement of a participant: namespace, name and publishers of each node.
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
        reset(&graph, gid(1, 0).into());
        assert!(!graph.add_own_node(&NodeName::new("/chaser", "arm").unwrap()));
        graph
    }

    // Fails if a publisher keeps a node that no longer exists, or if another participant can claim it.
    #[test]
    fn publishers_belong_to_the_nodes_that_tell_of_them() {
        let all = graph();
        let two: &[(&str, &str, &[Gid])] = &[
            ("/", "alpha", &[gid(2, 1), gid(3, 1)]),
            ("/chaser", "beta", &[gid(2, 2)]),
        ];
        assert_eq!(update(&all, gid(2, 7), &announced(two)).ok(), Some(vec![]));
        let owner = |publisher| all.node_of(publisher);
        assert_eq!(owner(gid(2, 1)).as_deref(), Some("/alpha"));
        assert_eq!(owner(gid(2, 2)).as_deref(), Some("/chaser/beta"));
        assert_eq!(owner(gid(3, 1)), None, "of another participant");
        assert!(update(&all, gid(2, 7), &announced(two)[..40]).is_err());
        assert_eq!(owner(gid(2, 1)).as_deref(), Some("/alpha"));
        assert_eq!(
            update(&all, gid(2, 7), &announced(&two[..1])).ok(),
            Some(vec![])
        );
        assert_eq!(owner(gid(2, 2)), None);
        let third = announced(&[("/", "gamma", &[gid(3, 1)])]);
        update(&all, gid(3, 7), &third).unwrap();
        remove_participants(&all, |guid| Gid::from(*guid).to_bytes16()[0] == 2);
        assert_eq!(owner(gid(2, 1)), None);
        assert_eq!(owner(gid(3, 1)).as_deref(), Some("/gamma"));
        update(&all, gid(3, 7), &announced(&[])).unwrap();
        assert!(all.nodes_of(&[3; 12]).is_empty());
    }

    // Fails if a node counts as its own namesake, or if every announcement causes a warning.
    #[test]
    fn a_namesake_is_new_once() {
        let all = graph();
        let own = announced(&[("/chaser", "arm", &[])]);
        let found =
            |participant, message: &[u8]| update(&all, gid(participant, 7), message).unwrap();
        assert!(found(1, &own).is_empty());
        assert!(found(4, &announced(&[("/", "arm", &[gid(4, 1)])])).is_empty());
        for participant in [2, 3] {
            assert_eq!(found(participant, &own), ["/chaser/arm"]);
            assert!(found(participant, &own).is_empty());
        }
    }
}
