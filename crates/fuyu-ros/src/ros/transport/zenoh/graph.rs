//! The ROS graph from liveliness tokens: the nodes of other sessions, and the matched peers of this session's
//! endpoints.

use std::{
    collections::{HashMap, HashSet},
    sync::{Mutex, MutexGuard, PoisonError, atomic::Ordering::Relaxed},
};

use super::{
    entity::{self, Entity, EntityKind},
    keys::TopicKey,
};
use crate::ros::{
    Gid,
    endpoint::{Counters, EndpointSpec, Role},
    graph_cache::warn_of_namesake,
    transport::{Discovery, RemotePublisher, Shared},
};

/// Largest number of pairs of topics that are warned about, since peers choose the names and types.
const MOST_WARNINGS: usize = 1000;

/// Entities of other sessions.
pub(super) struct ZenohGraph {
    /// Zenoh id of this session.
    own: String,
    shared: Shared,
    known: Mutex<Known>,
}

#[derive(Default)]
struct Known {
    entities: HashMap<Gid, Entity>,
    /// Pairs of topics for which a warning was logged.
    warned: HashSet<(TopicKey, TopicKey)>,
}

/// Side of an endpoint: publishing or subscribing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Writer,
    Reader,
}

impl ZenohGraph {
    /// For the session with this Zenoh id.
    pub(super) fn new(own: String, shared: Shared) -> Self {
        shared.graph.reset(own.as_bytes());
        Self {
            own,
            shared,
            known: Mutex::default(),
        }
    }

    /// Processes a token that has appeared or, if not `is_alive`, disappeared.
    pub(super) fn changed(&self, token: &str, is_alive: bool) {
        let Some(entity) = Entity::parse(token) else {
            tracing::debug!("Zenoh: {token} is not a token of a ROS entity");
            return;
        };
        if entity.session == self.own {
            return;
        }
        let mut known = self.lock();
        let gid = entity::gid(token);
        let has_changed = match is_alive {
            true => known.entities.insert(gid, entity.clone()).is_none(),
            false => known.entities.remove(&gid).is_some(),
        };
        if !has_changed {
            return;
        }
        for name in self.update_nodes(&known, &entity.session) {
            warn_of_namesake(&name);
        }
        if let Some((key, _)) = &entity.topic {
            self.update_matches(&mut known, key);
        }
    }

    /// Stores the nodes of a session. Returns names that are newly found to be the names of nodes of this session as
    /// well.
    fn update_nodes(&self, known: &Known, session: &str) -> Vec<String> {
        let mut nodes: HashMap<u64, (String, Vec<Gid>)> = HashMap::new();
        for (gid, entity) in &known.entities {
            if entity.session == session {
                let node = nodes.entry(entity.node_id);
                let (_, publishers) = node.or_insert_with(|| (entity.node_name(), Vec::new()));
                if matches!(entity.kind, EntityKind::Publisher | EntityKind::Client) {
                    publishers.push(*gid);
                }
            }
        }
        let nodes = nodes.into_values().collect();
        self.shared.graph.replace(session.as_bytes(), nodes)
    }

    /// Updates the matched peers of all endpoints of a topic or service.
    fn update_matches(&self, known: &mut Known, changed: &TopicKey) {
        let endpoints = self.shared.endpoints.lock();
        let endpoints = endpoints.unwrap_or_else(PoisonError::into_inner);
        let (writers, readers) = (endpoints.writers.clone(), endpoints.readers.clone());
        drop(endpoints);
        for writer in writers.iter().filter(|w| w.spec.name == changed.name) {
            known.count(&writer.spec, Side::Writer, &writer.counters);
        }
        for reader in readers.iter().filter(|r| r.spec.name == changed.name) {
            known.count(&reader.spec, Side::Reader, &reader.counters);
        }
    }

    /// Determines the matched peers of a new endpoint.
    pub(super) fn count(&self, spec: &EndpointSpec, side: Side, counters: &Counters) {
        self.lock().count(spec, side, counters);
    }

    fn lock(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Known {
    fn count(&mut self, spec: &EndpointSpec, side: Side, counters: &Counters) {
        let key = TopicKey::of(spec);
        let kind = counterpart(&spec.role, side);
        let mut peers = Vec::new();
        for (gid, entity) in &self.entities {
            let Some((other, _)) = entity.topic.as_ref().filter(|_| entity.kind == kind) else {
                continue;
            };
            if other.name != key.name {
                continue;
            }
            if other.is_exchanged_with(&key) {
                peers.push(*gid);
            } else if self.warned.len() < MOST_WARNINGS
                && self.warned.insert((key.clone(), other.clone()))
            {
                tracing::warn!(
                    "{} is not exchanged with node {}, which has another type or definition: {} {}, here {} {}",
                    key.name,
                    entity.node_name(),
                    other.type_name,
                    other.token_hash(),
                    key.type_name,
                    key.token_hash()
                );
            }
        }
        counters.remote.store(peers.len(), Relaxed);
        let stored = counters.peers.lock();
        *stored.unwrap_or_else(PoisonError::into_inner) = peers;
    }
}

/// Kind of the entities that an endpoint is matched with.
fn counterpart(role: &Role, side: Side) -> EntityKind {
    match (role, side) {
        (Role::Topic, Side::Writer) => EntityKind::Subscription,
        (Role::Topic, Side::Reader) => EntityKind::Publisher,
        (Role::Request(_), Side::Writer) | (Role::Reply(_), Side::Reader) => EntityKind::Service,
        (Role::Request(_), Side::Reader) | (Role::Reply(_), Side::Writer) => EntityKind::Client,
    }
}

impl Discovery for ZenohGraph {
    fn publishers(&self) -> Vec<RemotePublisher> {
        let known = self.lock();
        let all = known.entities.iter();
        let publishers = all.filter(|(_, entity)| entity.kind == EntityKind::Publisher);
        let describe = |(gid, entity): (&Gid, &Entity)| {
            let (key, qos) = entity.topic.as_ref()?;
            Some(RemotePublisher {
                dds_topic: format!("rt{}", key.name),
                dds_type: key.type_name.clone(),
                qos: *qos,
                type_hash: key.hash.clone(),
                gid: *gid,
            })
        };
        publishers.filter_map(describe).collect()
    }

    fn take_returned_peer(&self) -> Option<String> {
        // Zenoh restores its connections itself, so no session is replaced.
        None
    }
}
