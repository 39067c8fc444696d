//! A Zenoh router, as `rmw_zenohd` and `zenohd` are.

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

/// How often the same thing is logged at most.
const LOGGED_EVERY: Duration = Duration::from_secs(60);
/// Most different things that are logged in this time.
const DIFFERENT: usize = 200;
/// Things that wait for being logged; more are dropped.
const WAITING: usize = 1000;

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
        let (events, happened) = mpsc::sync_channel(WAITING);
        RouterLog::start({
            let events = events.clone();
            move |level, text| {
                // Zenoh does not wait for a slow terminal.
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
            // Without a receiver it is stopping already.
            let _ = events.send(RouterEvent::Stop);
        }
    });
    watched.map_err(|e| NodeError::Failed(format!("cannot follow signals: {e}")))
}

/// Writes the log, each text at most once in [`LOGGED_EVERY`], and no more than [`DIFFERENT`] texts.
fn log_until_stopped(events: &Receiver<RouterEvent>) {
    let mut throttle = Throttle::default();
    while let Ok(RouterEvent::Log(level, text)) = events.recv() {
        if let Some(text) = throttle.pass(text, Instant::now()) {
            eprintln!("[{level}] [zenoh]: {text}");
        }
    }
}

/// Keeps whoever is refused from filling the log.
#[derive(Default)]
struct Throttle {
    /// When each text was logged last, and how often it came since.
    logged: HashMap<String, (Instant, u64)>,
    is_full: bool,
}

impl Throttle {
    /// The line to log for a text that arrives now.
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

    // Fails if somebody who tries everything fills the disk, or silences what comes later.
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
