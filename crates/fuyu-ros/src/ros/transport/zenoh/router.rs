//! A Zenoh router, like `rmw_zenohd` and `zenohd`.

use std::{
    collections::HashMap,
    sync::mpsc::{self, Receiver, SyncSender},
    time::{Duration, Instant},
};
use tracing::Level;
use zenoh::Wait;

use super::{config::ZenohConfig, router_log::RouterLog};
use crate::ros::{
    NodeError,
    signals::{self, ProcessSignal},
};

/// Shortest time between two log entries with the same text.
const LOGGED_EVERY: Duration = Duration::from_secs(60);
/// Largest number of different texts that are logged in this time.
const DIFFERENT: usize = 200;
/// Largest number of queued log entries; further ones are dropped.
const WAITING: usize = 1000;

/// A running router. It introduces the sessions of its computer to each other and forwards messages to other computers.
/// With a configuration from [`crate::keys`] it also enforces permissions. It stops when dropped.
pub struct ZenohRouter {
    session: zenoh::Session,
}

impl ZenohRouter {
    /// Starts a router.
    ///
    /// # Errors
    /// [`NodeError::Failed`] if it cannot listen, for example if the port is in use.
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
        // All threads block signals, except the one that waits for them.
        signals::block();
        let (events, happened) = mpsc::sync_channel(WAITING);
        RouterLog::start({
            let events = events.clone();
            move |level, text| {
                // A full queue drops the entry, so that a slow terminal does not delay Zenoh.
                let _ = events.try_send(RouterEvent::Log(level, text));
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

fn watch(events: SyncSender<RouterEvent>) -> Result<(), NodeError> {
    let watched = signals::watch(move |signal| {
        if let ProcessSignal::Stop(_) = signal {
            // An error means that the router is stopping already.
            let _ = events.send(RouterEvent::Stop);
        }
    });
    watched.map_err(|e| NodeError::Failed(format!("cannot follow signals: {e}")))
}

/// Writes the log, each text at most once in [`LOGGED_EVERY`] and at most [`DIFFERENT`] texts.
fn log_until_stopped(events: &Receiver<RouterEvent>) {
    let mut throttle = Throttle::default();
    while let Ok(RouterEvent::Log(level, text)) = events.recv() {
        if let Some(text) = throttle.pass(text, Instant::now()) {
            eprintln!("[{level}] [zenoh]: {text}");
        }
    }
}

/// Limits the rate of log entries, so that a client whose messages are refused cannot fill the log.
#[derive(Default)]
struct Throttle {
    /// Time at which each text was logged last, and its number of occurrences since.
    logged: HashMap<String, (Instant, u64)>,
    is_full: bool,
}

impl Throttle {
    /// The line to log for a text that occurs now, if any.
    fn pass(&mut self, text: String, now: Instant) -> Option<String> {
        if let Some((last, unlogged)) = self.logged.get_mut(&text) {
            *unlogged += 1;
            if now.duration_since(*last) < LOGGED_EVERY {
                return None;
            }
            let often = format!("{text} ({unlogged} times)");
            (*last, *unlogged) = (now, 0);
            return Some(often);
        }
        if self.logged.len() >= DIFFERENT {
            let is_recent = |last: &Instant| now.duration_since(*last) < LOGGED_EVERY;
            self.logged.retain(|_, (last, _)| is_recent(last));
        }
        if self.logged.len() >= DIFFERENT {
            let is_new = !std::mem::replace(&mut self.is_full, true);
            return is_new.then(|| format!("more than {DIFFERENT} different messages a minute"));
        }
        self.is_full = false;
        self.logged.insert(text.clone(), (now, 0));
        Some(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if a client that tries many forbidden actions fills the disk, or suppresses later log entries.
    #[test]
    fn a_flood_is_not_logged() {
        let (mut throttle, start) = (Throttle::default(), Instant::now());
        let mut logged =
            |text: String, seconds: u64| throttle.pass(text, start + Duration::from_secs(seconds));
        assert_eq!(logged("a".into(), 0).as_deref(), Some("a"));
        assert_eq!(logged("a".into(), 30), None);
        assert_eq!(logged("a".into(), 61).as_deref(), Some("a (2 times)"));
        let flood = (0..10_000).filter_map(|i| logged(format!("text {i}"), 62));
        assert_eq!(flood.count(), DIFFERENT - 1 + 1);
        assert_eq!(logged("b".into(), 63), None);
        assert_eq!(logged("b".into(), 123).as_deref(), Some("b"));
    }
}
