//! The recorder node: writes topics to a rosbag2 bag.

mod folders;
mod params;
mod recording_session;
mod selection;
mod services;
mod times;

use std::{collections::HashMap, path::PathBuf, sync::Arc, time::Duration};

use super::topics;
use crate::{
    bag,
    ros::{Node, NodeError, Qos, RawSubscription, Status},
};
pub use folders::RecordFolders;
pub use params::RecorderParams;
use recording_session::RecordingSession;
pub use selection::Selection;

/// Interval between searches for new topics.
const DISCOVERY_INTERVAL: Duration = Duration::from_millis(200);

/// `bags/PREFIX-TIME`, named as `ros2 bag record` names its folders.
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
    let session = Arc::new(RecordingSession::new(
        node,
        params.options,
        params.queue,
        params.start_paused,
    ));
    session
        .begin(params.bag)
        .map_err(|e| NodeError::Input(format!("node {}: {e}", node.name())))?;
    let mut recorded = TopicSubscriptions {
        node,
        subscriptions: HashMap::new(),
        status: node.diagnostics().status("bag"),
        selection: params.selection.resolved(node)?,
        recording: session.begun(),
        failed: false,
        waiting: false,
        session: Arc::clone(&session),
    };
    recorded.subscribe_known()?;
    let services = services::serve(node, &session, params.folders)?;
    while node.ok() {
        recorded.follow_session()?;
        recorded.subscribe_discovered()?;
        recorded.report();
        // The receiving thread records the messages; nothing here is urgent.
        std::thread::sleep(DISCOVERY_INTERVAL);
    }
    // End the services first, so that none starts a recording that would stay open.
    drop(services);
    recorded.subscriptions.clear();
    session
        .end()
        .map(|_| ())
        .map_err(|e| NodeError::Failed(e.to_string()))
}

/// The subscriptions of the recording in progress.
struct TopicSubscriptions<'a> {
    node: &'a Node,
    session: Arc<RecordingSession>,
    /// By full topic name.
    subscriptions: HashMap<String, RawSubscription>,
    status: Status,
    selection: Selection,
    /// Number of the recording for which the subscriptions were created.
    recording: u64,
    /// Whether a write failure has been logged.
    failed: bool,
    /// Whether it has been logged that writing waits for space.
    waiting: bool,
}

impl TopicSubscriptions<'_> {
    /// Subscribes again when a new recording has started, so that it contains latched messages.
    fn follow_session(&mut self) -> Result<(), NodeError> {
        if self.session.begun() != self.recording {
            self.recording = self.session.begun();
            self.failed = false;
            self.subscriptions.clear();
            self.subscribe_known()?;
        }
        Ok(())
    }

    /// Subscribes to fuyu's topics before they have publishers, so that the first message is recorded.
    fn subscribe_known(&mut self) -> Result<(), NodeError> {
        for topic in topics::all() {
            let name = self.node.resolve_topic(topic.name)?;
            if self.selection.takes(&name) {
                let sink = self
                    .session
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
                let sink = self.session.sink(topic);
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
        let Some(handle) = self.session.handle() else {
            self.status.ok("no recording in progress");
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
                    tracing::error!("recording has stopped: {problem}");
                    self.failed = true;
                }
                self.status.error(problem);
                return;
            }
            None => {}
        }
        if recorded.waiting.is_some() != self.waiting {
            self.waiting = recorded.waiting.is_some();
            match &recorded.waiting {
                Some(problem) => tracing::error!(
                    "recording waits for space on the disk: {problem}; messages are kept in memory up to {} bytes",
                    recorded.queue_capacity
                ),
                None => tracing::info!("recording continues"),
            }
        }
        match recorded.waiting {
            Some(problem) => self.status.error(format!(
                "waits for space on the disk: {problem}; {} bytes are queued, {} messages were dropped",
                recorded.queued_bytes, recorded.dropped
            )),
            None if recorded.dropped > 0 => {
                self.status.warn(format!(
                    "{} messages were dropped: the disk is too slow",
                    recorded.dropped
                ));
            }
            None if self.session.is_paused() => self.status.ok("paused"),
            None => self.status.ok("recording"),
        }
    }
}

/// The offered QoS, with a queue deep enough for messages that arrive while the receiving thread is busy.
fn reading(offered: Qos) -> Qos {
    offered.depth(offered.depth.max(100))
}
