//! Check for a router before the nodes start (`ZENOH_ROUTER_CHECK_ATTEMPTS`). Without a router, nodes do not discover
//! each other.

use std::{
    thread,
    time::{Duration, Instant},
};
use zenoh::{Session, Wait};

/// Duration of one attempt.
const ATTEMPT: Duration = Duration::from_secs(1);
const POLL: Duration = Duration::from_millis(20);

/// Waits until the session is connected to a router, for at most this number of attempts, and warns if it is not. The
/// session continues to try to connect.
pub(super) fn wait_for_router(session: &Session, attempts: Option<u64>) {
    let Some(attempts) = attempts else { return };
    for attempt in 1..=attempts {
        let deadline = Instant::now() + ATTEMPT;
        while Instant::now() < deadline {
            if has_router(session) {
                return;
            }
            thread::sleep(POLL);
        }
        if attempt == 1 || attempt % 10 == 0 {
            tracing::warn!(
                "Zenoh: no router is connected; nodes of other processes are found once one runs (fuyu router)"
            );
        }
    }
}

fn has_router(session: &Session) -> bool {
    session.info().routers_zid().wait().next().is_some()
}
