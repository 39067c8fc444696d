//! Subscription of a node to `/clock`: sets its clock from one publisher, and warns if there are several.

use std::{
    sync::{
        Arc, Mutex, PoisonError, Weak,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::Instant,
};

use super::{
    Clock, Gid, NodeName, Time,
    clock_source::{ClockSource, Verdict},
    endpoint::{Counters, Inbox, Origin},
    local_delivery::LocalSample,
    participant::Participant,
};
use crate::msg::{cdr, rosgraph_msgs};

/// Sets the clock of a node from `/clock`. This runs in the thread that publishes or receives the message, so no other
/// thread has to be woken.
pub(super) struct ClockFollower {
    topic: String,
    clock: Clock,
    node: Arc<NodeName>,
    participant: Weak<Participant>,
    source: Mutex<ClockSource>,
    has_warned: AtomicBool,
}

impl ClockFollower {
    /// For `node`, which belongs to `participant` and subscribes to `topic`.
    pub(super) fn new(
        topic: String,
        clock: Clock,
        node: Arc<NodeName>,
        participant: Weak<Participant>,
    ) -> Self {
        Self {
            topic,
            clock,
            node,
            participant,
            source: Mutex::default(),
            has_warned: AtomicBool::new(false),
        }
    }

    /// Whether a publisher belongs to this node's robot, that is, to a node in the same namespace.
    fn is_own(&self, publisher: Gid) -> bool {
        let publisher = self.name_of(publisher);
        let namespace = publisher.as_deref().and_then(|name| name.rsplit_once('/'));
        let own = self.node.namespace().trim_end_matches('/');
        namespace.is_some_and(|(namespace, _)| namespace == own)
    }

    fn name_of(&self, publisher: Gid) -> Option<String> {
        self.participant.upgrade()?.node_of(publisher)
    }

    fn warn(&self, [followed, other]: [Gid; 2]) {
        if self.has_warned.swap(true, Relaxed) {
            return;
        }
        let name = |publisher| {
            let name = self.name_of(publisher);
            name.unwrap_or_else(|| format!("publisher {publisher:?}"))
        };
        tracing::warn!(
            "node {}: {} and {} both publish {}, and time follows the first; give each robot a clock of its own \
             (-r /clock:=clock, with its namespace)",
            self.node,
            name(followed),
            name(other),
            self.topic
        );
    }
}

impl Inbox for ClockFollower {
    fn accept(&self, sample: LocalSample, origin: Origin, _: &Counters) -> bool {
        let LocalSample { raw, message } = sample;
        let time = match message.and_then(|m| m.downcast::<rosgraph_msgs::Clock>().ok()) {
            Some(message) => Time::from(&message.clock),
            None => match cdr::decode::<rosgraph_msgs::Clock>(&raw.cdr) {
                Ok(message) => Time::from(&message.clock),
                Err(_) => return false,
            },
        };
        if self.clock.is_driven() {
            return true;
        }
        let mut source = self.source.lock().unwrap_or_else(PoisonError::into_inner);
        let verdict = source.receive(raw.publisher, Instant::now(), |p| self.is_own(p));
        let several = source.several();
        drop(source);
        if verdict == Verdict::FollowInstead {
            self.clock.publisher_changes();
        }
        if verdict != Verdict::Ignore {
            self.clock.set_publisher(raw.publisher);
            self.clock.set(time);
        }
        // Nothing may be logged while messages are delivered within the participant. One of two publishers belongs to
        // another participant, so the warning can wait for its message.
        if let Some(several) = several
            && origin == Origin::Remote
        {
            self.warn(several);
        }
        true
    }
}
