//! Signal handling. Threads of rustdds end when a signal interrupts them, so all threads block signals except one,
//! which waits for them here.

use nix::sys::signal::{SigSet, SigmaskHow, Signal, pthread_sigmask};
use std::{
    thread,
    time::{Duration, Instant},
};

/// Signals that stay unblocked: faults of the thread itself, and job control of the terminal.
const NOT_BLOCKED: [Signal; 11] = [
    Signal::SIGSEGV,
    Signal::SIGBUS,
    Signal::SIGFPE,
    Signal::SIGILL,
    Signal::SIGTRAP,
    Signal::SIGABRT,
    Signal::SIGSYS,
    Signal::SIGQUIT,
    Signal::SIGTSTP,
    Signal::SIGTTIN,
    Signal::SIGTTOU,
];

fn blocked() -> SigSet {
    let mut set = SigSet::all();
    for signal in NOT_BLOCKED {
        set.remove(signal);
    }
    set
}

/// Blocks signals in this thread and in all threads that it starts from now on.
pub(super) fn block() {
    if let Err(e) = blocked().thread_block() {
        tracing::error!("cannot block signals, a signal may cut the node off: {e}");
    }
}

/// Runs `f` with signals blocked, so that threads started by `f` block them too.
pub(super) fn with_blocked<R>(f: impl FnOnce() -> R) -> R {
    let mut before = SigSet::empty();
    let changed = pthread_sigmask(SigmaskHow::SIG_BLOCK, Some(&blocked()), Some(&mut before));
    let result = f();
    if changed.is_ok() {
        // Fails only for a wrong first argument.
        let _ = pthread_sigmask(SigmaskHow::SIG_SETMASK, Some(&before), None);
    }
    result
}

/// A signal that a process handles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ProcessSignal {
    /// SIGINT, SIGTERM or SIGHUP.
    Stop(Signal),
    /// SIGCONT: the process continues after it was suspended.
    Continued,
}

/// Signals within this time after the first one belong to the same request: a terminal or a launcher sends one to the
/// process and one to its group.
const SAME_REQUEST: Duration = Duration::from_millis(250);

/// Distinguishes first, duplicate and repeated stop requests.
#[derive(Debug, Default)]
pub(super) struct StopRequests {
    first: Option<Instant>,
}

impl StopRequests {
    /// Classifies a stop signal that arrived at `now`.
    pub(super) fn add(&mut self, now: Instant) -> StopRequest {
        match self.first {
            None => {
                self.first = Some(now);
                StopRequest::First
            }
            Some(first) if now.duration_since(first) < SAME_REQUEST => StopRequest::Same,
            Some(_) => StopRequest::Again,
        }
    }

    /// Whether a stop has been requested.
    pub(super) fn is_stopping(&self) -> bool {
        self.first.is_some()
    }
}

/// Meaning of a stop signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StopRequest {
    /// First request: stop in order.
    First,
    /// Duplicate of the first request: no effect.
    Same,
    /// Second request: end at once.
    Again,
}

/// Starts a thread that waits for signals and calls `handle` for each. The signals must be blocked in all threads.
pub(super) fn watch(mut handle: impl FnMut(ProcessSignal) + Send + 'static) -> std::io::Result<()> {
    let mut set = SigSet::empty();
    for signal in [
        Signal::SIGINT,
        Signal::SIGTERM,
        Signal::SIGHUP,
        Signal::SIGCONT,
    ] {
        set.add(signal);
    }
    thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            loop {
                match set.wait() {
                    Ok(Signal::SIGCONT) => handle(ProcessSignal::Continued),
                    Ok(signal) => handle(ProcessSignal::Stop(signal)),
                    Err(nix::errno::Errno::EINTR) => {}
                    Err(e) => {
                        tracing::error!("cannot wait for signals: {e}");
                        return;
                    }
                }
            }
        })
        .map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if Ctrl-C in a terminal, which signals parent and child, aborts a run while it writes its bag.
    #[test]
    fn signals_within_milliseconds_are_one_request() {
        let mut requests = StopRequests::default();
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        assert!(!requests.is_stopping());
        assert_eq!(requests.add(at(0)), StopRequest::First);
        assert!(requests.is_stopping());
        assert_eq!(requests.add(at(3)), StopRequest::Same);
        assert_eq!(requests.add(at(200)), StopRequest::Same);
        assert_eq!(requests.add(at(400)), StopRequest::Again);
    }
}
