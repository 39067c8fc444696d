//! Whose an endpoint is: what other nodes tell on `ros_discovery_info`.

use serde::Deserialize;
use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

use super::{
    Gid, NodeError, Qos, RawSample,
    endpoint::{Counters, EndpointSpec, Reader},
    node::Core,
};
use crate::msg::cdr;

const TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";

/// `rmw_dds_common/ParticipantEntitiesInfo`.
#[derive(Deserialize)]
struct Participant {
    gid: Gid,
    nodes: Vec<Entities>,
}

#[derive(Deserialize)]
struct Entities {
    namespace: String,
    name: String,
    #[expect(dead_code, reason = "stands before what is read")]
    readers: Vec<Gid>,
    writers: Vec<Gid>,
}

/// Publishers of each participant, with the full names of their nodes.
type Known = HashMap<Gid, Vec<(Gid, String)>>;

/// Listens to what other nodes say is theirs, until it is dropped.
pub struct Owners {
    known: Arc<Mutex<Known>>,
    core: Arc<Core>,
    reader: Arc<Reader>,
}

impl Owners {
    pub(super) fn new(core: &Arc<Core>) -> Result<Self, NodeError> {
        let known = Arc::new(Mutex::new(Known::new()));
        let told = Arc::clone(&known);
        let sink = move |sample: RawSample, _: &Counters| {
            let Ok(participant) = cdr::decode_as::<Participant>(&sample.cdr, TYPE) else {
                return false;
            };
            let mut told = told.lock().unwrap_or_else(PoisonError::into_inner);
            if participant.nodes.is_empty() {
                told.remove(&participant.gid);
            } else {
                told.insert(participant.gid, publishers(participant.nodes));
            }
            true
        };
        let spec = EndpointSpec {
            name: "ros_discovery_info".to_owned(),
            dds_topic: "ros_discovery_info".to_owned(),
            dds_type: TYPE.to_owned(),
            qos: Qos::LATCHED.depth(100),
            internal: true,
        };
        let reader = core.add_reader(spec, Box::new(sink))?;
        Ok(Self {
            known,
            core: Arc::clone(core),
            reader,
        })
    }

    /// Full name of the node that `publisher` belongs to, or its identity on the wire if it has not been told.
    pub fn name_of(&self, publisher: Gid) -> String {
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let mut all = known.values().flatten();
        match all.find(|(gid, _)| *gid == publisher) {
            Some((_, name)) => format!("node {name}"),
            None => format!("publisher {publisher:?}"),
        }
    }
}

impl Drop for Owners {
    fn drop(&mut self) {
        self.core.remove_reader(&self.reader);
    }
}

fn publishers(nodes: Vec<Entities>) -> Vec<(Gid, String)> {
    let of = |node: Entities| {
        let name = format!("{}/{}", node.namespace.trim_end_matches('/'), node.name);
        node.writers.into_iter().map(move |gid| (gid, name.clone()))
    };
    nodes.into_iter().flat_map(of).collect()
}
