//! The recorder node: writes topics to a rosbag2 bag.

mod folders;
mod health;
mod params;
mod recording_session;
mod selection;
mod services;
mod subscriptions;
mod times;

use std::{path::PathBuf, sync::Arc, time::Duration};

use crate::ros::{Node, NodeError};
pub use folders::RecordFolders;
use health::Health;
pub use params::RecorderParams;
use recording_session::RecordingSession;
pub use selection::Selection;
use subscriptions::TopicSubscriptions;

/// Period of the search for new topics.
const DISCOVERY_INTERVAL: Duration = Duration::from_millis(200);

/// A new folder `bags/PREFIX-TIME`, named as by `ros2 bag record`.
pub fn new_folder(prefix: &str) -> PathBuf {
    let time = chrono::Local::now().format("%Y_%m_%d-%H_%M_%S");
    PathBuf::from(format!("bags/{prefix}-{time}"))
}

/// The node's program.
///
/// # Errors
/// If the folder exists or cannot be written, for invalid parameters, or when DDS reports an error.
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
    let subscriptions = Arc::new(TopicSubscriptions::new(
        node,
        &session,
        params.selection.resolved(node)?,
    )?);
    subscriptions.subscribe_in_advance()?;
    let watching = Arc::clone(&subscriptions);
    node.watch_local_topics(move |used| watching.subscribe_local(used));
    node.set_ready();
    let services = services::serve(node, &session, params.folders)?;
    let mut health = Health::new(node, &session);
    let mut recording = session.begun();
    while node.ok() {
        // A new recording must contain latched messages: subscribe again.
        if session.begun() != recording {
            recording = session.begun();
            health.begin();
            subscriptions.clear();
            subscriptions.subscribe_in_advance()?;
        }
        subscriptions.follow(&node.discovered_publishers());
        health.report();
        // The receiving thread records the messages; nothing in this loop is urgent.
        std::thread::sleep(DISCOVERY_INTERVAL);
    }
    // End the services first, so that no call starts another recording, which would stay open.
    drop(services);
    subscriptions.close();
    session
        .end()
        .map(|_| ())
        .map_err(|e| NodeError::Failed(e.to_string()))
}
