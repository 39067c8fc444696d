//! Repeats a failed test once, and only if the machine was measurably late while it ran.
//!
//! A graph in real time depends on being scheduled in time. A failure on a machine that is busy with something else says
//! nothing about fuyu; a failure on a machine that was not late is a fault, and the test is never repeated. Every
//! repetition is written to stderr as one line that begins with `REPEATED `, past the capture of output by the test
//! harness; `.ci/run` counts these lines and fails above a small number.

use std::{
    any::Any,
    io::Write as _,
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{
        PoisonError, RwLock,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread,
    time::{Duration, Instant},
};

/// How long the sampling thread sleeps each time.
const NAP: Duration = Duration::from_millis(5);
/// A wake-up is late if it is delayed by more than this: one tick of the graph at 100 Hz.
const LATE: Duration = Duration::from_millis(10);
/// The machine counts as late if the fraction of late wake-ups is above this. Measured on two cores: zero when idle or next
/// to builds of lower priority, 1.3 % next to two busy loops of the same priority, 34 % next to four.
const LATE_SHARE: f64 = 0.01;
/// The machine is also late after a single delay as long as this, such as a pause of a virtual machine.
const PAUSE: Duration = Duration::from_millis(100);
/// The machine is also late if so many threads, on average, run or wait for each processor. A thread that sleeps most of the time, as
/// the sampling one, is woken in time even then; one that works is not. Three test suites at a time on two cores have 3 to 4.
const BUSY: f64 = 2.5;

/// Held shared by tests on their first run, exclusively by a test that is repeated.
static MACHINE: RwLock<()> = RwLock::new(());

/// Runs a test. If it fails and the machine was late meanwhile, runs it once more, while no other test of this kind
/// runs in the same executable; the result of the second run counts.
pub fn repeat_if_late(test: impl Fn()) {
    let (outcome, delays) = {
        let _shared = MACHINE.read().unwrap_or_else(PoisonError::into_inner);
        sampled(&test)
    };
    println!("{delays}");
    let Err(failure) = outcome else { return };
    if !delays.are_late() {
        resume_unwind(failure);
    }
    report(&delays, &*failure);
    let _alone = MACHINE.write().unwrap_or_else(PoisonError::into_inner);
    let (outcome, delays) = sampled(&test);
    println!("{delays}");
    if let Err(failure) = outcome {
        resume_unwind(failure);
    }
}

/// Writes the line that `.ci/run` counts. `print!` and `eprint!` would be captured by the test harness.
fn report(delays: &Delays, failure: &(dyn Any + Send)) {
    let message = failure
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| failure.downcast_ref::<&str>().copied())
        .unwrap_or("a panic without a message");
    let first_line = message.lines().next().unwrap_or_default();
    let thread = thread::current();
    let test = thread.name().unwrap_or("a test");
    // The harness may be in the middle of a line.
    let line = format!("\nREPEATED {test}: {delays}; it had failed with: {first_line}\n");
    let _ = std::io::stderr().lock().write_all(line.as_bytes());
}

/// Delays of wake-ups during a run.
struct Delays {
    wake_ups: u32,
    late: u32,
    longest: Duration,
    /// Sum over the wake-ups of the threads that run or wait for each processor.
    runnable: f64,
}

impl Delays {
    fn late_share(&self) -> f64 {
        f64::from(self.late) / f64::from(self.wake_ups.max(1))
    }

    fn runnable(&self) -> f64 {
        self.runnable / f64::from(self.wake_ups.max(1))
    }

    fn are_late(&self) -> bool {
        self.late_share() > LATE_SHARE || self.longest >= PAUSE || self.runnable() > BUSY
    }
}

impl std::fmt::Display for Delays {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = 100.0 * self.late_share();
        let longest = self.longest.as_secs_f64() * 1e3;
        write!(
            f,
            "{percent:.2} % of {} wake-ups later than {LATE:?}, the latest by {longest:.1} ms; {:.1} threads per processor",
            self.wake_ups,
            self.runnable()
        )
    }
}

/// Runs `work` while another thread sleeps and measures by how much it wakes up late.
fn sampled(work: impl Fn()) -> (thread::Result<()>, Delays) {
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        let sampler = scope.spawn(|| {
            let mut delays = Delays {
                wake_ups: 0,
                late: 0,
                longest: Duration::ZERO,
                runnable: 0.0,
            };
            let processors = thread::available_parallelism().map_or(1.0, |n| n.get() as f64);
            while !over.load(Relaxed) {
                let asleep = Instant::now();
                thread::sleep(NAP);
                let delay = asleep.elapsed().saturating_sub(NAP);
                delays.wake_ups += 1;
                delays.late += u32::from(delay > LATE);
                delays.longest = delays.longest.max(delay);
                delays.runnable += runnable_threads() / processors;
            }
            delays
        });
        let outcome = catch_unwind(AssertUnwindSafe(work));
        over.store(true, Relaxed);
        (outcome, sampler.join().expect("it only sleeps"))
    })
}

/// Threads of the whole machine that run or could run; 0 where that is not known.
fn runnable_threads() -> f64 {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let counts = text
        .split(' ')
        .nth(3)
        .and_then(|counts| counts.split('/').next());
    counts
        .and_then(|running| running.parse().ok())
        .unwrap_or(0.0)
}

#[test]
fn a_machine_is_late_by_many_short_delays_one_long_one_or_many_threads() {
    let delays = |late, longest, runnable| Delays {
        wake_ups: 1000,
        late,
        longest: Duration::from_millis(longest),
        runnable,
    };
    assert!(!delays(10, 99, 2400.0).are_late());
    assert!(delays(11, 20, 0.0).are_late());
    assert!(delays(1, 100, 0.0).are_late());
    assert!(delays(0, 1, 2600.0).are_late());
}
