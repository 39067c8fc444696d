//! Watchdog for the creation of DDS entities: detects a participant that has deadlocked.
//!
//! While rustdds announces an endpoint it holds a read lock on its discovery database and waits for room in a queue of 32.
//! The thread that empties the queue also reads the database, and queues behind the writer that creates the next endpoint
//! (docs/upstream.md). With many peers and little processor time these three threads deadlock, and the participant neither
//! sends nor receives from then on. It cannot be recovered, so it is abandoned.

use nix::errno::Errno;
use rustdds::{DomainParticipant, dds::CreateError};
use std::{
    any::Any,
    fmt,
    sync::mpsc,
    thread::{self, JoinHandle},
    time::Duration,
};

use super::signals;

/// A creation that takes longer than this counts as a deadlock; usually it takes some microseconds.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Why an entity could not be created.
#[derive(Debug)]
pub(super) enum EntityError {
    /// The participant has deadlocked; a new one may work.
    Deadlocked(AbandonedParticipant),
    /// The process has no file descriptors left; the participant is not affected.
    NoDescriptors(String),
    /// Any other error of DDS, as text.
    Dds(String),
}

impl From<CreateError> for EntityError {
    fn from(e: CreateError) -> Self {
        match e {
            CreateError::Io(io) if is_exhausted(&io) => Self::NoDescriptors(io.to_string()),
            e => Self::dds(e),
        }
    }
}

/// Whether the process, or the computer, has no file descriptors left.
fn is_exhausted(e: &std::io::Error) -> bool {
    let limits = [Errno::EMFILE, Errno::ENFILE];
    e.raw_os_error()
        .is_some_and(|code| limits.contains(&Errno::from_raw(code)))
}

impl EntityError {
    pub(super) fn dds(reason: impl fmt::Display) -> Self {
        Self::Dds(reason.to_string())
    }

    /// Drops what belongs to the participant, as soon as the drop cannot block.
    pub(super) fn abandoning(mut self, rest: impl Send + 'static) -> Self {
        match &mut self {
            Self::Deadlocked(stuck) => stuck.keep(rest),
            Self::Dds(_) | Self::NoDescriptors(_) => drop(rest),
        }
        self
    }
}

impl fmt::Display for EntityError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Deadlocked(_) => write!(
                f,
                "the DDS participant did not respond within {TIMEOUT:?}: it has deadlocked"
            ),
            Self::NoDescriptors(reason) => {
                write!(f, "{reason}; raise the limit of open files (ulimit -n)")
            }
            Self::Dds(reason) => f.write_str(reason),
        }
    }
}

/// A deadlocked participant: the thread that is blocked in it, and objects whose drop would block too. They are dropped when
/// that thread ends, which it usually never does.
#[derive(Debug, Default)]
pub(super) struct AbandonedParticipant {
    maker: Option<JoinHandle<()>>,
    kept: Vec<Box<dyn Any + Send>>,
}

impl AbandonedParticipant {
    pub(super) fn keep(&mut self, rest: impl Send + 'static) {
        self.kept.push(Box::new(rest));
    }
}

impl Drop for AbandonedParticipant {
    fn drop(&mut self) {
        let (maker, kept) = (self.maker.take(), std::mem::take(&mut self.kept));
        if kept.is_empty() {
            return;
        }
        thread::spawn(move || {
            let _ = maker.map(JoinHandle::join);
            drop(kept);
        });
    }
}

/// Runs `make` on a participant, with a limit on its duration.
pub(super) fn create<T: Send + 'static>(
    participant: &DomainParticipant,
    make: impl FnOnce(&DomainParticipant) -> Result<T, CreateError> + Send + 'static,
) -> Result<T, EntityError> {
    let participant = participant.clone();
    run_with_timeout(TIMEOUT, move || {
        let made = make(&participant);
        // The caller still has a handle, so this drop does not end the participant, unless the caller has given up.
        drop(participant);
        made
    })?
    .map_err(EntityError::from)
}

fn run_with_timeout<T: Send + 'static>(
    patience: Duration,
    make: impl FnOnce() -> T + Send + 'static,
) -> Result<T, EntityError> {
    let (finish, finished) = mpsc::sync_channel(1);
    let maker = signals::with_blocked(|| {
        let maker = thread::Builder::new().name("dds-create".to_owned());
        maker.spawn(move || {
            let _ = finish.send(make());
        })
    });
    let maker = Some(maker.map_err(EntityError::dds)?);
    finished.recv_timeout(patience).map_err(|_| {
        EntityError::Deadlocked(AbandonedParticipant {
            maker,
            kept: Vec::new(),
        })
    })
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
        let stuck = run_with_timeout(Duration::from_millis(20), move || ended.recv()).unwrap_err();
        assert!(matches!(stuck, EntityError::Deadlocked(_)), "{stuck}");
        let (finish, finished) = mpsc::channel();
        drop(stuck.abandoning(NotifiesOnDrop(finish)));
        let silence = finished.recv_timeout(Duration::from_millis(50));
        assert_eq!(silence, Err(mpsc::RecvTimeoutError::Timeout));
        drop(end);
        assert_eq!(finished.recv(), Ok(()));
    }
}
