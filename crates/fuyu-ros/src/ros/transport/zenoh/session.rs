//! A Zenoh session with the endpoints of a participant's nodes.

use std::{
    collections::HashMap,
    sync::{Arc, PoisonError},
};
use zenoh::{Wait, liveliness::LivelinessToken, pubsub::Subscriber, sample::SampleKind};

use super::{
    config::ZenohConfig,
    entity::{self, Entity, EntityKind},
    graph::{Side, ZenohGraph},
    keys::TopicKey,
    reader::ZenohReader,
    request::{ReplyReaders, RequestWriter},
    router_check::wait_for_router,
    service::{PendingQueries, ReplyWriter, ServiceOfNode},
    writer::TopicWriter,
};
use crate::ros::{
    Domain, Gid, NodeName,
    endpoint::{EndpointSpec, Reader, Role, Writer},
    transport::{Discovery, Session, Shared, TransportError, WireWriter},
};

/// A connected session.
pub(super) struct ZenohSession {
    session: zenoh::Session,
    domain: u16,
    shared: Shared,
    graph: Arc<ZenohGraph>,
    nodes: Vec<NodeInGraph>,
    /// Receivers by the address of their subscription, which is kept alive.
    readers: HashMap<usize, (Arc<Reader>, ZenohReader)>,
    replies: Arc<ReplyReaders>,
    pending: Arc<PendingQueries>,
    /// Number of the next entity.
    next: u64,
    _tokens: Subscriber<()>,
}

/// An announced node.
struct NodeInGraph {
    name: Arc<NodeName>,
    id: u64,
    _token: LivelinessToken,
}

impl ZenohSession {
    /// Opens a session with all endpoints of `shared`. Its threads inherit the caller's signal mask.
    pub(super) fn open(
        domain: Domain,
        config: &ZenohConfig,
        shared: &Shared,
    ) -> Result<Self, TransportError> {
        let session = config.open()?;
        wait_for_router(&session, config.router_checks);
        let graph = Arc::new(ZenohGraph::new(session.zid().to_string(), shared.clone()));
        let changed = Arc::clone(&graph);
        let tokens = session
            .liveliness()
            .declare_subscriber(Entity::all_tokens(domain.id))
            .history(true)
            .callback(move |sample| {
                let is_alive = sample.kind() == SampleKind::Put;
                changed.changed(sample.key_expr().as_str(), is_alive);
            })
            .wait()
            .map_err(TransportError::other)?;
        let mut new = Self {
            session,
            domain: domain.id,
            shared: shared.clone(),
            graph,
            nodes: Vec::new(),
            readers: HashMap::new(),
            replies: Arc::default(),
            pending: Arc::default(),
            next: 0,
            _tokens: tokens,
        };
        let (writers, readers) = {
            let all = shared.endpoints.lock();
            let all = all.unwrap_or_else(PoisonError::into_inner);
            (all.writers.clone(), all.readers.clone())
        };
        new.announce();
        writers.iter().try_for_each(|w| new.add_writer(w))?;
        readers.iter().try_for_each(|r| new.add_reader(r))?;
        Ok(new)
    }

    fn next_id(&mut self) -> u64 {
        self.next += 1;
        self.next - 1
    }

    /// Announces an endpoint. Returns its GID and its token.
    fn declare(
        &mut self,
        node: &Arc<NodeName>,
        kind: EntityKind,
        spec: &EndpointSpec,
    ) -> Result<(Gid, LivelinessToken), TransportError> {
        let node_id = self.node_id(node)?;
        let id = self.next_id();
        let topic = Some((TopicKey::of(spec), spec.qos));
        self.declare_entity(node, (node_id, id), kind, topic)
    }

    fn declare_entity(
        &self,
        node: &NodeName,
        (node_id, id): (u64, u64),
        kind: EntityKind,
        topic: Option<(TopicKey, crate::ros::Qos)>,
    ) -> Result<(Gid, LivelinessToken), TransportError> {
        let entity = Entity {
            domain: self.domain,
            session: self.session.zid().to_string(),
            node_id,
            id,
            kind,
            namespace: node.namespace().to_owned(),
            node: node.name().to_owned(),
            topic,
        };
        let token = entity.token();
        let gid = entity::gid(&token);
        let declared = self.session.liveliness().declare_token(token).wait();
        Ok((gid, declared.map_err(TransportError::other)?))
    }

    /// Number of a node in the session; announces the node if it is new.
    fn node_id(&mut self, node: &Arc<NodeName>) -> Result<u64, TransportError> {
        let known = self.nodes.iter().find(|n| Arc::ptr_eq(&n.name, node));
        if let Some(known) = known {
            return Ok(known.id);
        }
        let id = self.next_id();
        let (_, token) = self.declare_entity(node, (id, id), EntityKind::Node, None)?;
        self.nodes.push(NodeInGraph {
            name: Arc::clone(node),
            id,
            _token: token,
        });
        Ok(id)
    }

    fn reply_writer(&self, writer: &Writer, key: &TopicKey) -> ReplyWriter {
        let key = key.data(self.domain);
        ReplyWriter {
            // Not visible to peers: replies state the GID of the client.
            gid: writer.identity(),
            service: ServiceOfNode::new(&writer.node, &writer.spec.name),
            key,
            pending: Arc::clone(&self.pending),
        }
    }
}

impl Session for ZenohSession {
    fn discovery(&self) -> Arc<dyn Discovery> {
        Arc::clone(&self.graph) as Arc<dyn Discovery>
    }

    fn add_writer(&mut self, writer: &Arc<Writer>) -> Result<(), TransportError> {
        let spec = &writer.spec;
        let key = TopicKey::of(spec);
        match spec.role {
            Role::Topic => {
                let token = self.declare(&writer.node, EntityKind::Publisher, spec)?;
                let data = key.data(self.domain);
                let wire = TopicWriter::new(&self.session, data, writer, token)?;
                writer.attach(Some(Arc::new(wire)));
            }
            Role::Request(_) => {
                let token = self.declare(&writer.node, EntityKind::Client, spec)?;
                let service = ServiceOfNode::new(&writer.node, &spec.name);
                let place = (service, &key, self.domain);
                let graph = &self.shared.graph;
                let client = (writer, &self.replies);
                let wire = RequestWriter::new(&self.session, place, token, client, graph)?;
                writer.attach(Some(Arc::new(wire)));
            }
            Role::Reply(_) => {
                let wire = self.reply_writer(writer, &key);
                writer.attach(Some(Arc::new(wire)));
            }
        }
        self.graph.count(spec, Side::Writer, &writer.counters);
        Ok(())
    }

    fn add_reader(&mut self, reader: &Arc<Reader>) -> Result<(), TransportError> {
        let spec = &reader.spec;
        let key = TopicKey::of(spec);
        let graph = Arc::clone(&self.shared.graph);
        let zenoh = match spec.role {
            Role::Topic => {
                let (gid, token) = self.declare(&reader.node, EntityKind::Subscription, spec)?;
                reader.set_gid(gid);
                let data = key.any_data(self.domain);
                ZenohReader::topic(&self.session, data, (reader, &graph), token)?
            }
            Role::Request(_) => {
                let (gid, token) = self.declare(&reader.node, EntityKind::Service, spec)?;
                reader.set_gid(gid);
                let data = key.data(self.domain);
                let to = (reader, &graph);
                ZenohReader::service(&self.session, data, to, &self.pending, token)?
            }
            Role::Reply(_) => {
                self.replies.add(reader);
                ZenohReader::Replies
            }
        };
        let address = Arc::as_ptr(reader) as usize;
        self.readers.insert(address, (Arc::clone(reader), zenoh));
        self.graph.count(spec, Side::Reader, &reader.counters);
        Ok(())
    }

    fn remove_writer(&mut self, writer: &Writer) -> Option<Arc<dyn WireWriter>> {
        writer.detach()
    }

    fn remove_reader(&mut self, reader: &Arc<Reader>) {
        self.readers.remove(&(Arc::as_ptr(reader) as usize));
        match reader.spec.role {
            Role::Topic => {}
            Role::Request(_) => {
                let service = ServiceOfNode::new(&reader.node, &reader.spec.name);
                self.pending.forget(&service);
            }
            Role::Reply(_) => self.replies.remove(reader),
        }
        // Dropping the receiver also removes its token.
    }

    fn announce(&mut self) {
        let members = {
            let all = self.shared.endpoints.lock();
            let all = all.unwrap_or_else(PoisonError::into_inner);
            all.nodes.clone()
        };
        let is_there = |name: &Arc<NodeName>| members.iter().any(|m| Arc::ptr_eq(&m.name, name));
        self.nodes.retain(|node| is_there(&node.name));
        for member in &members {
            if let Err(e) = self.node_id(&member.name) {
                tracing::warn!("node {}: not announced: {e}", member.name);
            }
        }
    }
}

impl Drop for ZenohSession {
    fn drop(&mut self) {
        self.readers.clear();
        self.nodes.clear();
        if let Err(e) = self.session.close().wait() {
            tracing::debug!("Zenoh: closing a session: {e}");
        }
    }
}
