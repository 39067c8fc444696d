//! Graph cache: names and publishers of the nodes of other participants, as the transport discovers them.
//!
//! ROS allows two nodes with the same name; a service call or parameter change then reaches either of them. So a
//! warning is logged when a discovered node has the name of a node of this participant.

use std::{
    collections::HashMap,
    sync::{Mutex, MutexGuard, PoisonError},
};

use super::{Gid, NodeName};

/// Identity of a participant; its form depends on the transport.
type ParticipantId = Box<[u8]>;

/// Full names of the nodes of a participant, each with its publishers.
type Nodes = Vec<(String, Vec<Gid>)>;

/// Nodes of other participants.
#[derive(Default)]
pub(super) struct GraphCache {
    known: Mutex<Inner>,
}

#[derive(Default)]
struct Inner {
    /// This participant, whose own announcements may be received.
    own: Option<ParticipantId>,
    /// Full names of the nodes of this participant.
    own_nodes: Vec<String>,
    others: HashMap<ParticipantId, Nodes>,
}

impl GraphCache {
    /// Adds a node of this participant. Returns whether a node with the same name is known.
    pub(super) fn add_own_node(&self, node: &NodeName) -> bool {
        let name = node.full();
        let mut known = self.lock();
        let mut all = known.others.values().flatten();
        let is_taken = known.own_nodes.contains(&name) || all.any(|(other, _)| *other == name);
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

    /// Clears the cache for a new session, which will discover all nodes again.
    pub(super) fn reset(&self, own: &[u8]) {
        let mut known = self.lock();
        known.own = Some(own.into());
        known.others.clear();
    }

    /// Stores the present nodes of a participant. Returns names that are newly found to be the names of nodes of this
    /// participant as well.
    pub(super) fn replace(&self, participant: &[u8], nodes: Nodes) -> Vec<String> {
        let mut known = self.lock();
        let Inner {
            own,
            own_nodes,
            others,
        } = &mut *known;
        if own.as_deref() == Some(participant) {
            return Vec::new();
        }
        if nodes.is_empty() {
            others.remove(participant);
            return Vec::new();
        }
        let before = others.insert(participant.into(), nodes.clone());
        let before = before.unwrap_or_default();
        let was_known = |name: &String| before.iter().any(|(known, _)| known == name);
        (nodes.into_iter().map(|(name, _)| name))
            .filter(|name| own_nodes.contains(name) && !was_known(name))
            .collect()
    }

    /// Full names of the nodes of a participant.
    pub(super) fn nodes_of(&self, participant: &[u8]) -> Vec<String> {
        let known = self.lock();
        let nodes = known.others.get(participant).into_iter().flatten();
        nodes.map(|(name, _)| name.clone()).collect()
    }

    /// Removes participants that have left or died.
    pub(super) fn remove_participants(&self, is_lost: impl Fn(&[u8]) -> bool) {
        let others = &mut self.lock().others;
        others.retain(|participant, _| !is_lost(participant));
    }

    /// Full name of the node that `publisher` belongs to, if it is known.
    pub(super) fn node_of(&self, publisher: Gid) -> Option<String> {
        let known = self.lock();
        let mut all = known.others.values().flatten();
        let (name, _) = all.find(|(_, publishers)| publishers.contains(&publisher))?;
        Some(name.clone())
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Warns that two nodes have the same name.
pub(super) fn warn_of_namesake(node: &str) {
    tracing::warn!(
        "node {node}: another node of this name is in the graph, and calls of services and parameters may reach either; \
         rename one (-r __node:=NAME) or namespace (-r __ns:=/NAMESPACE)"
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if a new node of a participant is not compared with the other nodes of this participant and with those
    // discovered before.
    #[test]
    fn a_node_that_joins_learns_of_its_namesakes() {
        let all = GraphCache::default();
        all.reset(&[1]);
        let arm = NodeName::new("/chaser", "arm").unwrap();
        let eye = NodeName::new("/chaser", "eye").unwrap();
        assert!(!all.add_own_node(&arm));
        assert!(all.add_own_node(&arm), "within the participant");
        all.remove_own_node(&arm);
        let other = vec![("/chaser/eye".to_owned(), Vec::new())];
        assert!(all.replace(&[2], other).is_empty());
        assert!(all.add_own_node(&eye), "in another participant");
        all.remove_own_node(&eye);
        all.replace(&[2], Vec::new());
        assert!(!all.add_own_node(&eye));
    }
}
