//! A Zenoh router, as `rmw_zenohd` and `zenohd` are.

use std::{
    collections::HashMap,
    sync::mpsc::{self, Receiver, Sender},
    time::{Duration, Instant},
};
use tracing::Level;
use zenoh::Wait;

use super::{config::ZenohConfig, router_log::RouterLog};
use crate::ros::{
    NodeError,
    signals::{self, ProcessSignal},
};

/// How often the same thing is logged at most.
const LOGGED_EVERY: Duration = Duration::from_secs(60);
/// Most kinds of things that are told apart for it.
const REMEMBERED: usize = 1024;

/// A running router. It introduces the sessions of its computer to each other, and passes on what goes to others; with
/// a configuration of [`crate::keys`] it decides who may do what. It stops when it is dropped.
pub struct ZenohRouter {
    session: zenoh::Session,
}

impl ZenohRouter {
    /// Starts a router.
    ///
    /// # Errors
    /// [`NodeError::Failed`] if it cannot listen: at a port that is in use, for example.
    pub fn start(config: &ZenohConfig) -> Result<Self, NodeError> {
        let session = config.open();
        let session = session.map_err(|e| NodeError::Failed(format!("Zenoh router: {e}")))?;
        Ok(Self { session })
    }

    /// Runs a router, with a log on stderr, until SIGINT, SIGTERM or SIGHUP.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn run(config: &ZenohConfig) -> Result<(), NodeError> {
        // All threads leave signals to the one that waits for them.
        signals::block();
        let (events, happened) = mpsc::channel();
        RouterLog::start({
            let events = events.clone();
            move |level, text| {
                // The receiver lives as long as the router.
                let _ = events.send(RouterEvent::Log(level, text));
            }
        });
        let router = Self::start(config)?;
        watch(events)?;
        for locator in router.session.info().locators().wait() {
            tracing::info!("listens at {locator}");
        }
        log_until_stopped(&happened);
        Ok(())
    }
}

impl Drop for ZenohRouter {
    fn drop(&mut self) {
        if let Err(e) = self.session.close().wait() {
            tracing::debug!("Zenoh: closing the router: {e}");
        }
    }
}

enum RouterEvent {
    Log(Level, String),
    Stop,
}

fn watch(events: Sender<RouterEvent>) -> Result<(), NodeError> {
    let watched = signals::watch(move |signal| {
        if let ProcessSignal::Stop(_) = signal {
            // Without a receiver it is stopping already.
            let _ = events.send(RouterEvent::Stop);
        }
    });
    watched.map_err(|e| NodeError::Failed(format!("cannot follow signals: {e}")))
}

/// Writes the log, each text at most once in [`LOGGED_EVERY`].
fn log_until_stopped(events: &Receiver<RouterEvent>) {
    let mut logged: HashMap<String, (Instant, u64)> = HashMap::new();
    while let Ok(RouterEvent::Log(level, text)) = events.recv() {
        let now = Instant::now();
        let entry = logged.get_mut(&text);
        match entry {
            Some((last, unlogged)) if now.duration_since(*last) < LOGGED_EVERY => *unlogged += 1,
            Some((last, unlogged)) => {
                eprintln!("[{level}] [zenoh]: {text} ({} times)", *unlogged + 1);
                (*last, *unlogged) = (now, 0);
            }
            None => {
                eprintln!("[{level}] [zenoh]: {text}");
                if logged.len() >= REMEMBERED {
                    logged.clear();
                }
                logged.insert(text, (now, 0));
            }
        }
    }
}
