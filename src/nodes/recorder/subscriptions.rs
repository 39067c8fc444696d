//! Subscriptions of a recording: to fuyu's topics, and to discovered topics as long as they have publishers.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use super::{Selection, recording_session::RecordingSession};
use crate::{
    bag::{self, BATCHING_DELAY},
    nodes::topics,
    ros::{DiscoveredPublisher, LocalTopicUse, Node, NodeError, Qos, RawSubscription},
};

/// Time without a publisher after which a subscription ends, so that samples still on their way are received.
const RELEASED_AFTER: Duration = Duration::from_secs(2);
/// Time between two attempts to subscribe to a topic.
const RETRY_AFTER: Duration = Duration::from_secs(10);

/// The subscriptions of the current recording, shared by the node's program and by threads that create publishers.
pub struct TopicSubscriptions {
    node: Node,
    session: Arc<RecordingSession>,
    selection: Selection,
    /// Topics of fuyu with their offered QoS; subscribers may request less.
    known: Vec<(String, Qos)>,
    topics: Mutex<Topics>,
}

#[derive(Default)]
struct Topics {
    /// State of each selected topic, by full name.
    all: HashMap<String, State>,
    /// Whether no further subscriptions may be added.
    closed: bool,
}

/// State of a topic.
enum State {
    /// A thread is creating the subscription.
    Subscribing,
    /// The subscription receives.
    Subscribed {
        _subscription: RawSubscription,
        /// Whether it is kept while nobody publishes.
        stays: bool,
        last_publisher: Instant,
    },
    /// The subscription failed at that time.
    Refused(Instant),
}

impl TopicSubscriptions {
    /// Without subscriptions.
    ///
    /// # Errors
    /// For a name that is invalid after remapping.
    pub fn new(
        node: &Node,
        session: &Arc<RecordingSession>,
        selection: Selection,
    ) -> Result<Self, NodeError> {
        let known = topics::all().into_iter();
        let known = known.map(|topic| Ok((node.resolve_topic(topic.name)?, topic.qos)));
        Ok(Self {
            known: known.collect::<Result<_, NodeError>>()?,
            node: node.clone(),
            session: Arc::clone(session),
            selection,
            topics: Mutex::default(),
        })
    }

    /// Subscribes to the topics that nodes of this process use. If the recorder is alone in its process, subscribes to
    /// fuyu's topics even without publishers, so that the first message is recorded.
    ///
    /// # Errors
    /// For a name that is invalid after remapping.
    pub fn subscribe_in_advance(&self) -> Result<(), NodeError> {
        if self.node.is_only_node() {
            for topic in topics::all() {
                let name = self.node.resolve_topic(topic.name)?;
                let recorded = bag::Topic::named(&name, &topic.type_name, topic.qos);
                self.subscribe_to(recorded, topic.qos, true);
            }
        }
        for used in self.node.local_topics() {
            self.subscribe_local(&used);
        }
        Ok(())
    }

    /// Subscribes to a topic that a node of this process publishes or subscribes to.
    pub fn subscribe_local(&self, used: &LocalTopicUse) {
        let known = self.known.iter().find(|(name, _)| *name == used.topic);
        let qos = match known {
            Some((_, qos)) => *qos,
            None if used.is_published => used.qos,
            // The QoS of its publishers is not known yet.
            None => return,
        };
        let topic = bag::Topic::named(&used.topic, &used.type_name, qos);
        self.subscribe_to(topic, qos, !used.is_published);
    }

    /// Subscribes to the topic of a discovered publisher, if it is selected and not subscribed yet.
    fn subscribe(&self, publisher: &DiscoveredPublisher) {
        let mut topic = bag::Topic::named(&publisher.topic, &publisher.type_name, publisher.qos);
        topic.type_hash.clone_from(&publisher.type_hash);
        self.subscribe_to(topic, publisher.qos, false);
    }

    /// Subscribes to the topics of `publishers`, and ends subscriptions to topics that have had no publisher for a
    /// while.
    pub fn follow(&self, publishers: &[DiscoveredPublisher]) {
        for publisher in publishers {
            self.subscribe(publisher);
        }
        let now = Instant::now();
        let mut topics = self.lock();
        for publisher in publishers {
            if let Some(State::Subscribed { last_publisher, .. }) =
                topics.all.get_mut(&publisher.topic)
            {
                *last_publisher = now;
            }
        }
        let is_over = |_: &String, state: &mut State| match state {
            State::Subscribed {
                stays: false,
                last_publisher,
                ..
            } => now - *last_publisher > RELEASED_AFTER,
            _ => false,
        };
        let ended: Vec<_> = topics.all.extract_if(is_over).collect();
        drop(topics);
        // Dropped after unlocking: samples received so far are recorded first.
        drop(ended);
    }

    /// Ends all subscriptions.
    pub fn clear(&self) {
        let ended = std::mem::take(&mut self.lock().all);
        drop(ended);
    }

    /// Ends all subscriptions and prevents new ones.
    pub fn close(&self) {
        self.lock().closed = true;
        self.clear();
    }

    /// Creates a subscription without holding the lock.
    fn subscribe_to(&self, topic: bag::Topic, offered: Qos, stays: bool) {
        let name = topic.name.clone();
        if !self.selection.takes(&name) {
            return;
        }
        let mut topics = self.lock();
        let is_due = match topics.all.get(&name) {
            None => true,
            Some(State::Refused(at)) => at.elapsed() > RETRY_AFTER,
            Some(State::Subscribing | State::Subscribed { .. }) => false,
        };
        if topics.closed || !is_due {
            return;
        }
        let before = topics.all.insert(name.clone(), State::Subscribing);
        drop(topics);
        let kind = topic.type_name.clone();
        let sink = self.session.sink(topic);
        let take = move |sample| sink.take(sample);
        let node = &self.node;
        let (full_name, qos) = (name.clone(), reading(offered));
        let state = match node.subscribe_patiently(full_name, &kind, qos, BATCHING_DELAY, take) {
            Ok(subscription) => State::Subscribed {
                _subscription: subscription,
                stays,
                last_publisher: Instant::now(),
            },
            Err(e) => {
                if before.is_none() {
                    tracing::warn!("{name} is not recorded: {e}");
                }
                State::Refused(Instant::now())
            }
        };
        let mut topics = self.lock();
        // The recording may have ended meanwhile.
        let unused = match topics.closed {
            true => Some(state),
            false => topics.all.insert(name, state),
        };
        drop(topics);
        drop(unused);
    }

    fn lock(&self) -> MutexGuard<'_, Topics> {
        self.topics.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The offered QoS, with a queue long enough for messages that arrive while the receiving thread is busy.
fn reading(offered: Qos) -> Qos {
    offered.depth(offered.depth.max(100))
}
