//! Making DDS entities although a participant may lock itself up meanwhile.
//!
//! rustdds announces an endpoint with its discovery database locked for reading, while it waits for room in a queue of
//! 32. The thread that empties that queue reads the database too, and so waits behind whoever wants to write it: the
//! maker of the next endpoint (docs/upstream.md). With many peers and too little processor these three then wait for
//! each other, and the participant neither hears nor says anything any more. Nothing frees it, so it is given up.

use rustdds::{DomainParticipant, dds::CreateError};
use std::{
    any::Any,
    fmt,
    sync::mpsc,
    thread::{self, JoinHandle},
    time::Duration,
};

use super::signals;

/// What takes longer than this is taken to be locked up; some microseconds are usual.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Why there is no entity.
#[derive(Debug)]
pub(super) enum EntityError {
    /// The participant has locked itself up. Another one may do better.
    Deadlocked(AbandonedParticipant),
    /// What DDS says.
    Dds(String),
}

impl EntityError {
    pub(super) fn dds(reason: impl fmt::Display) -> Self {
        Self::Dds(reason.to_string())
    }

    /// Lets go of what belongs to the participant, when that does not have to wait for it.
    pub(super) fn abandoning(mut self, rest: impl Send + 'static) -> Self {
        match &mut self {
            Self::Deadlocked(stuck) => stuck.keep(rest),
            Self::Dds(_) => drop(rest),
        }
        self
    }
}

impl fmt::Display for EntityError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Deadlocked(_) => write!(
                f,
                "the DDS participant has not done it run_with_timeout {TIMEOUT:?}: it has locked itself up"
            ),
            Self::Dds(reason) => f.write_str(reason),
        }
    }
}

/// A participant that has locked itself up, as the thread that waits for it. What belongs to it waits when dropped, so
/// it is kept here, and dropped when that thread is through: never, as a rule.
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

/// What `make` makes of a participant, unless that locks itself up.
pub(super) fn create<T: Send + 'static>(
    participant: &DomainParticipant,
    make: impl FnOnce(&DomainParticipant) -> Result<T, CreateError> + Send + 'static,
) -> Result<T, EntityError> {
    let participant = participant.clone();
    run_with_timeout(TIMEOUT, move || {
        let made = make(&participant);
        // Never the last one, unless this comes too late.
        drop(participant);
        made
    })?
    .map_err(EntityError::dds)
}

fn run_with_timeout<T: Send + 'static>(
    patience: Duration,
    make: impl FnOnce() -> T + Send + 'static,
) -> Result<T, EntityError> {
    let (tell, told) = mpsc::sync_channel(1);
    let maker = signals::with_blocked(|| {
        let maker = thread::Builder::new().name("maker".to_owned());
        maker.spawn(move || {
            let _ = tell.send(make());
        })
    });
    let maker = Some(maker.map_err(EntityError::dds)?);
    told.recv_timeout(patience).map_err(|_| {
        EntityError::Deadlocked(AbandonedParticipant {
            maker,
            kept: Vec::new(),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Tells(mpsc::Sender<()>);

    impl Drop for Tells {
        fn drop(&mut self) {
            let _ = self.0.send(());
        }
    }

    // Would break if the caller waited, or if what is left behind were dropped while the maker is stuck.
    #[test]
    fn what_never_comes_is_not_waited_for() {
        assert!(matches!(run_with_timeout(TIMEOUT, || 7), Ok(7)));
        let (end, ended) = mpsc::channel::<()>();
        let stuck = run_with_timeout(Duration::from_millis(20), move || ended.recv()).unwrap_err();
        assert!(matches!(stuck, EntityError::Deadlocked(_)), "{stuck}");
        let (tell, told) = mpsc::channel();
        drop(stuck.abandoning(Tells(tell)));
        let silence = told.recv_timeout(Duration::from_millis(50));
        assert_eq!(silence, Err(mpsc::RecvTimeoutError::Timeout));
        drop(end);
        assert_eq!(told.recv(), Ok(()));
    }
}
