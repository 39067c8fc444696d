//! Advertisements in progress.
//!
//! The SDK (0.30) sends the advertisement of a channel to a client before it registers the channel for that client
//! (`ConnectedClient::advertise_channels`). A subscription that arrives in between is refused because of an unknown
//! channel, and clients do not retry. Therefore the gate holds back client messages until the advertisement is
//! complete.

use std::sync::Arc;

use tokio::sync::watch;

/// Number of advertisements in progress; clones share the number.
#[derive(Clone)]
pub struct Advertisements(Arc<watch::Sender<usize>>);

impl Advertisements {
    /// No advertisements in progress.
    pub fn new() -> Self {
        Self(Arc::new(watch::Sender::new(0)))
    }

    /// Calls `advertise`; an advertisement is in progress until it returns.
    pub fn during<T>(&self, advertise: impl FnOnce() -> T) -> T {
        self.0.send_modify(|n| *n += 1);
        let _in_progress = InProgress(&self.0);
        advertise()
    }

    /// Waits until no advertisement is in progress.
    pub async fn complete(&self) {
        // Fails only if the sender is gone, which `self` owns.
        let _ = self.0.subscribe().wait_for(|n| *n == 0).await;
    }
}

/// One advertisement; ends when dropped, also by a panic.
struct InProgress<'a>(&'a watch::Sender<usize>);

impl Drop for InProgress<'_> {
    fn drop(&mut self) {
        self.0.send_modify(|n| *n -= 1);
    }
}
