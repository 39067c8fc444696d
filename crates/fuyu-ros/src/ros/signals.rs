//! Signals. The threads of rustdds end when a signal interrupts them, so all threads block signals except one that waits for
//! them here.

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

/// Blocks signals in this thread and in every thread that it starts from now on.
pub(super) fn block() {
    if let Err(e) = blocked().thread_block() {
        tracing::error!("cannot block signals, a signal may cut the node off: {e}");
    }
}

/// Runs `f` with signals blocked, so that threads it starts inherit that.
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
    /// SIGCONT: the process was stopped and continues.
    Continued,
}

/// Signals that follow the first one within this time are the same request: a terminal or a launcher sends one to the
/// process and one to its group.
const SAME_REQUEST: Duration = Duration::from_millis(250);

/// Counts requests to stop.
#[derive(Debug, Default)]
pub(super) struct StopRequests {
    first: Option<Instant>,
}

impl StopRequests {
    /// A signal to stop has arrived at `now`.
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

    /// Whether the process has been asked to stop.
    pub(super) fn is_stopping(&self) -> bool {
        self.first.is_some()
    }
}

/// Effect of a signal to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StopRequest {
    /// To stop in order.
    First,
    /// Nothing new.
    Same,
    /// To end at once.
    Again,
}

/// Waits for signals on a thread of its own. The signals must be blocked in all threads.
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

    // Would break if Ctrl-C in a terminal, which signals parent and child, cut off a run in the middle of its bag.
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
