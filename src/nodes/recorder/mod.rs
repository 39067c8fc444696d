//! The recorder node: writes topics to a rosbag2 bag.

mod deck;
mod params;
mod selection;
mod services;
mod times;

use std::{collections::HashMap, path::PathBuf, sync::Arc, time::Duration};

use super::topics;
use crate::{
    bag,
    ros::{Node, NodeError, Qos, RawSubscription, Status},
};
use deck::Deck;
pub use params::RecorderParams;
pub use selection::Selection;

/// How often new topics are looked for.
const LOOK: Duration = Duration::from_millis(200);

/// `bags/`, `prefix` and the time, as `ros2 bag record` names its folders.
pub fn new_folder(prefix: &str) -> PathBuf {
    let time = chrono::Local::now().format("%Y_%m_%d-%H_%M_%S");
    PathBuf::from(format!("bags/{prefix}-{time}"))
}

/// The node's program.
///
/// # Errors
/// When the folder exists or cannot be written, for wrong parameters, or when DDS refuses.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = RecorderParams::declare(&mut declare);
    declare.finish()?;
    let deck = Arc::new(Deck::new(
        node,
        params.options,
        params.queue,
        params.start_paused,
    ));
    deck.begin(params.bag)
        .map_err(|e| NodeError::Input(format!("node {}: {e}", node.name())))?;
    let mut session = Session {
        node,
        subscriptions: HashMap::new(),
        status: node.diagnostics().status("bag"),
        selection: params.selection.resolved(node)?,
        recording: deck.begun(),
        failed: false,
        deck: Arc::clone(&deck),
    };
    session.subscribe_known()?;
    let services = services::serve(node, &deck)?;
    while node.ok() {
        session.follow_deck()?;
        session.subscribe_discovered()?;
        session.report();
        // The receiving thread hands messages over; here nothing is urgent.
        std::thread::sleep(LOOK);
    }
    // Nobody may begin a recording that nobody ends.
    drop(services);
    session.subscriptions.clear();
    deck.end()
        .map(|_| ())
        .map_err(|e| NodeError::Failed(e.to_string()))
}

struct Session<'a> {
    node: &'a Node,
    deck: Arc<Deck>,
    /// By full name of the topic.
    subscriptions: HashMap<String, RawSubscription>,
    status: Status,
    selection: Selection,
    /// Number of the recording that the subscriptions were made for.
    recording: u64,
    /// Whether it was said that nothing is recorded any more.
    failed: bool,
}

impl Session<'_> {
    /// A new recording has new subscriptions, which get what is latched once more.
    fn follow_deck(&mut self) -> Result<(), NodeError> {
        if self.deck.begun() != self.recording {
            self.recording = self.deck.begun();
            self.failed = false;
            self.subscriptions.clear();
            self.subscribe_known()?;
        }
        Ok(())
    }

    /// Subscribes to the topics of the graph before anybody publishes them, so that not even their first
    /// message is missed.
    fn subscribe_known(&mut self) -> Result<(), NodeError> {
        for topic in topics::all() {
            let name = self.node.resolve_topic(topic.name)?;
            if self.selection.takes(&name) {
                let sink = self
                    .deck
                    .sink(bag::Topic::named(&name, &topic.type_name, topic.qos));
                let subscription = self.node.subscribe_raw(
                    topic.name,
                    &topic.type_name,
                    reading(topic.qos),
                    move |sample| sink.take(sample),
                )?;
                self.subscriptions.insert(name, subscription);
            }
        }
        Ok(())
    }

    fn subscribe_discovered(&mut self) -> Result<(), NodeError> {
        for publisher in self.node.discovered_publishers() {
            let new = !self.subscriptions.contains_key(&publisher.topic);
            if new && self.selection.takes(&publisher.topic) {
                let mut topic =
                    bag::Topic::named(&publisher.topic, &publisher.type_name, publisher.qos);
                topic.type_hash.clone_from(&publisher.type_hash);
                let sink = self.deck.sink(topic);
                let take = move |sample| sink.take(sample);
                let subscription =
                    self.node
                        .subscribe_discovered(&publisher, reading(publisher.qos), take)?;
                self.subscriptions.insert(publisher.topic, subscription);
            }
        }
        Ok(())
    }

    fn report(&mut self) {
        let Some(handle) = self.deck.handle() else {
            self.status.ok("nothing is recorded");
            return;
        };
        let recorded = handle.status();
        self.status.set("bag", handle.folder().display());
        self.status.set("files", recorded.files);
        self.status.set("messages", recorded.accepted);
        self.status.set("dropped", recorded.dropped);
        self.status.set("queued [bytes]", recorded.queued_bytes);
        for (topic, dropped) in &recorded.dropped_topics {
            self.status.set(&format!("dropped {topic}"), dropped);
        }
        match recorded.failure {
            Some(problem) => {
                if !self.failed {
                    tracing::error!("nothing is recorded any more: {problem}");
                    self.failed = true;
                }
                self.status.error(problem);
            }
            None if recorded.dropped > 0 => {
                self.status.warn(format!(
                    "{} messages were dropped: the disk is too slow",
                    recorded.dropped
                ));
            }
            None if self.deck.is_paused() => self.status.ok("paused"),
            None => self.status.ok("recording"),
        }
    }
}

/// What is offered, with a queue deep enough for what arrives while the receiving thread is busy.
fn reading(offered: Qos) -> Qos {
    offered.depth(offered.depth.max(100))
}
