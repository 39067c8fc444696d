//! Time stamps of recorded messages.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use crate::{
    bag::{RecorderHandle, RecorderTopic},
    ros::{Clock, Gid, RawSample, Time},
};

/// Stamps messages with wall time or, with use_sim_time, with the time of `/clock`, like `ros2 bag record
/// --use-sim-time`.
pub struct Times {
    clock: Clock,
    /// The last recorded `/clock` \[ns\]; [`NO_CLOCK`] before the first.
    now: AtomicI64,
    /// Samples that arrived before the first `/clock`; `None` after it.
    early: Mutex<Option<Waiting>>,
    /// Stamp of the last message \[ns\].
    last: AtomicU64,
    /// [`Clock::changes_of_publisher`] at the last message, or, if `/clock` is recorded, at the last `/clock`.
    changes_of_publisher: AtomicU64,
    /// Publisher of the last recorded `/clock`.
    publisher: Mutex<Option<Gid>>,
    /// Whether time may jump back because the clock follows another publisher, which is not a restart.
    may_jump: AtomicBool,
    /// Wall time at the start, and the monotonic instant.
    start: (Time, Instant),
}

/// Samples waiting for the first `/clock`.
#[derive(Default)]
struct Waiting {
    samples: Vec<Early>,
    bytes: usize,
}

/// A sample without a stamp, and its destination.
struct Early {
    handle: RecorderHandle,
    topic: Arc<RecorderTopic>,
    sample: RawSample,
}

/// Largest number and total bytes of samples that wait for the first `/clock`.
const EARLY: usize = 10_000;
const EARLY_BYTES: usize = 64 << 20;

/// Value before any `/clock` was recorded.
const NO_CLOCK: i64 = i64::MIN;

impl Times {
    /// Stamps by `clock`.
    pub fn new(clock: Clock) -> Self {
        Self {
            clock,
            now: AtomicI64::new(NO_CLOCK),
            early: Mutex::new(Some(Waiting::default())),
            last: AtomicU64::new(0),
            changes_of_publisher: AtomicU64::new(0),
            publisher: Mutex::default(),
            may_jump: AtomicBool::new(false),
            start: (Time::wall(), Instant::now()),
        }
    }

    /// Writes a sample with its stamp, at once or when the time becomes known.
    pub fn write(&self, handle: &RecorderHandle, topic: &Arc<RecorderTopic>, sample: RawSample) {
        let mut early = self.early.lock().unwrap_or_else(PoisonError::into_inner);
        match early.as_mut() {
            Some(waiting)
                if self.clock.is_simulated()
                    && waiting.samples.len() < EARLY
                    && waiting.bytes + sample.cdr.len() <= EARLY_BYTES =>
            {
                let (handle, topic) = (handle.clone(), Arc::clone(topic));
                waiting.bytes += sample.cdr.len();
                waiting.samples.push(Early {
                    handle,
                    topic,
                    sample,
                });
            }
            _ => self.write_now(handle, topic, sample),
        }
    }

    /// Sets the simulated time `now` for the stamps of the following samples. The node's own clock may be ahead
    /// already, since samples are recorded shortly after their arrival. Ignored for a publisher that the node's clock
    /// does not follow.
    pub fn advance(&self, now: Time, publisher: Gid) {
        if !self.clock.follows(publisher) {
            return;
        }
        let mut last = self
            .publisher
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if last.replace(publisher).is_some_and(|p| p != publisher) && self.publisher_has_changed() {
            self.may_jump.store(true, Relaxed);
        }
        drop(last);
        self.now.store(now.as_nanos(), Relaxed);
        self.begin(now);
    }

    /// Writes the waiting samples with the stamp `now`, when the first `/clock` has arrived or recording ends.
    pub fn begin(&self, now: Time) {
        let early = self
            .early
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        for Early {
            handle,
            topic,
            sample,
        } in early.into_iter().flat_map(|waiting| waiting.samples)
        {
            let nanos = nanos(now);
            handle.write(&topic, nanos, nanos, sample.cdr);
        }
    }

    /// Whether the clock has switched to another publisher since the last call while the previous one still publishes.
    fn publisher_has_changed(&self) -> bool {
        let changes = self.clock.changes_of_publisher();
        changes != self.changes_of_publisher.swap(changes, Relaxed)
    }

    fn write_now(&self, handle: &RecorderHandle, topic: &RecorderTopic, sample: RawSample) {
        let simulated = self.clock.is_simulated();
        let received = if simulated {
            match self.now.load(Relaxed) {
                NO_CLOCK => self.clock.now(),
                nanos => Time::from_nanos(nanos),
            }
        } else {
            let now = self.start.0 + self.start.1.elapsed();
            advancing(sample.received_time, now)
        };
        let sent = if simulated {
            received
        } else {
            sample.source_time.unwrap_or(received)
        };
        let (received, sent) = (nanos(received), nanos(sent));
        let last = self.last.swap(received, Relaxed);
        let is_jump = simulated && received < last;
        let is_restart = match self.now.load(Relaxed) {
            NO_CLOCK => !self.publisher_has_changed(),
            _ => is_jump && !self.may_jump.swap(false, Relaxed),
        };
        if is_jump && is_restart {
            // A single file sorted by time would mix the two runs.
            tracing::info!(
                "/clock jumped back from {} s to {} s: the bag continues in a new file",
                Time::from_nanos(last as i64),
                Time::from_nanos(received as i64)
            );
            if let Err(e) = handle.split() {
                tracing::error!("{e}");
            }
        }
        handle.write(topic, received, sent, sample.cdr);
    }
}

/// The stamp of a message that arrived at `received` by the wall clock. If the wall clock was set back since the
/// recording started, the stamp is `now` instead, which is monotonic.
fn advancing(received: Time, now: Time) -> Time {
    const SET_BACK: Duration = Duration::from_millis(500);
    if now.since(received) > SET_BACK {
        now
    } else {
        received
    }
}

fn nanos(time: Time) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if messages after the clock was set back are sorted before earlier ones, or all get the same stamp.
    #[test]
    fn stamps_advance_when_the_wall_clock_is_set_back() {
        let at = Time::from_secs_f64;
        assert_eq!(advancing(at(1000.0), at(1000.1)), at(1000.0));
        assert_eq!(advancing(at(1060.0), at(1000.2)), at(1060.0));
        assert_eq!(advancing(at(940.3), at(1000.3)), at(1000.3));
        assert_eq!(advancing(at(940.4), at(1000.4)), at(1000.4));
    }
}
