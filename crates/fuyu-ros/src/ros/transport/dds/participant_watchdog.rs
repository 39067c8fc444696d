//! Watchdog for the creation of DDS entities: detects a participant that has deadlocked.
//!
//! While rustdds announces an endpoint, it holds a read lock on its discovery database and waits for room in a queue of
//! 32 entries. The thread that empties the queue also reads the database, but its read lock waits behind the thread
//! that requests the write lock to create the next endpoint (docs/upstream.md). With many peers and little processor
//! time these three threads deadlock, and the participant no longer sends or receives. It cannot be recovered, so it is
//! abandoned.

use nix::errno::Errno;
use rustdds::{DomainParticipant, dds::CreateError};
use std::{
    sync::mpsc::{self, RecvTimeoutError},
    thread,
    time::{Duration, Instant},
};

use crate::ros::{
    signals,
    transport::{AbandonedSession, TransportError},
};

/// If the creation takes longer, the participant counts as deadlocked. Usually it takes some microseconds.
const TIMEOUT: Timeout = Timeout {
    on_time: Duration::from_secs(2),
    total: Duration::from_secs(5),
};
/// How often the waiting thread checks whether it runs on time.
const CHECK: Duration = Duration::from_millis(50);

/// Limits of a wait.
#[derive(Clone, Copy)]
struct Timeout {
    /// Time during which the waiting thread was scheduled on time: other threads then had processor time, too.
    on_time: Duration,
    /// All time.
    total: Duration,
}

impl From<CreateError> for TransportError {
    fn from(e: CreateError) -> Self {
        match e {
            CreateError::Io(io) if is_exhausted(&io) => Self::NoDescriptors(io.to_string()),
            e => Self::other(e),
        }
    }
}

/// Whether the error says that the process, or the computer, has no file descriptors left.
fn is_exhausted(e: &std::io::Error) -> bool {
    let limits = [Errno::EMFILE, Errno::ENFILE];
    e.raw_os_error()
        .is_some_and(|code| limits.contains(&Errno::from_raw(code)))
}

/// Runs `make` on a participant, with a time limit.
pub(super) fn create<T: Send + 'static>(
    participant: &DomainParticipant,
    make: impl FnOnce(&DomainParticipant) -> Result<T, CreateError> + Send + 'static,
) -> Result<T, TransportError> {
    let participant = participant.clone();
    run_with_timeout(TIMEOUT, move || {
        let made = make(&participant);
        // This drop does not end the participant, since the caller still has a handle, unless the caller has given up.
        drop(participant);
        made
    })?
    .map_err(TransportError::from)
}

fn run_with_timeout<T: Send + 'static>(
    timeout: Timeout,
    make: impl FnOnce() -> T + Send + 'static,
) -> Result<T, TransportError> {
    let (finish, finished) = mpsc::sync_channel(1);
    let maker = signals::with_blocked(|| {
        let maker = thread::Builder::new().name("dds-create".to_owned());
        maker.spawn(move || {
            let _ = finish.send(make());
        })
    });
    let maker = Some(maker.map_err(TransportError::other)?);
    let (start, mut on_time) = (Instant::now(), Duration::ZERO);
    while on_time < timeout.on_time && start.elapsed() < timeout.total {
        let checked = Instant::now();
        match finished.recv_timeout(CHECK) {
            Ok(made) => return Ok(made),
            Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) if checked.elapsed() < 2 * CHECK => on_time += CHECK,
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
    Err(TransportError::Deadlocked(AbandonedSession::blocking(
        maker,
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct NotifiesOnDrop(mpsc::Sender<()>);

    impl Drop for NotifiesOnDrop {
        fn drop(&mut self) {
            let _ = self.0.send(());
        }
    }

    // Fails if the caller waits, or if abandoned objects are dropped while the creating thread is blocked.
    #[test]
    fn a_deadlocked_participant_is_not_waited_for() {
        assert!(matches!(run_with_timeout(TIMEOUT, || 7), Ok(7)));
        let (end, ended) = mpsc::channel::<()>();
        let short = Timeout {
            on_time: CHECK,
            total: 2 * CHECK,
        };
        let stuck = run_with_timeout(short, move || ended.recv()).unwrap_err();
        assert!(matches!(stuck, TransportError::Deadlocked(_)), "{stuck}");
        let (finish, finished) = mpsc::channel();
        drop(stuck.abandoning(NotifiesOnDrop(finish)));
        let silence = finished.recv_timeout(Duration::from_millis(50));
        assert_eq!(silence, Err(mpsc::RecvTimeoutError::Timeout));
        drop(end);
        assert_eq!(finished.recv(), Ok(()));
    }
}
