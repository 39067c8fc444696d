//! Tests that need the machine to keep time.
//!
//! With the gains of the thesis the loop over the graph is stable up to a delay of 20 ms (the fastest rate of
//! joint damping over reduced inertia is 80 1/s, at joint 6). A machine that runs the nodes later than that
//! makes the robot diverge, which is no fault of theirs. Tests that only need a living loop run it with
//! `process::GENTLE` gains, which bear 150 ms.

use std::{
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{
        PoisonError, RwLock,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread,
    time::{Duration, Instant},
};

/// A command is three nodes and some ten wake-ups behind its state, so this much each is too much.
const LATE: Duration = Duration::from_millis(1);
/// More than this part of late wake-ups is starvation; on an idle machine it is two in a thousand, beside as
/// many busy loops as cores two in ten.
const TOO_MANY: f64 = 0.01;

/// Held by tests that run beside each other, taken by one that has failed beside others.
static MACHINE: RwLock<()> = RwLock::new(());

/// Runs a test that failed beside others once more alone, for they share two processors with it; and that again once
/// if threads of this machine still wake up late.
pub fn in_time(test: impl Fn()) {
    for attempt in 1.. {
        let watched = || while_watching(|| catch_unwind(AssertUnwindSafe(&test)));
        let (outcome, late) = if attempt == 1 {
            let _beside = MACHINE.read().unwrap_or_else(PoisonError::into_inner);
            watched()
        } else {
            let _alone = MACHINE.write().unwrap_or_else(PoisonError::into_inner);
            watched()
        };
        println!("{:.2} % of wake-ups are late", 100.0 * late);
        match outcome {
            Ok(()) => return,
            Err(_) if attempt == 1 => println!("failed beside others; once more alone"),
            Err(_) if late > TOO_MANY && attempt == 2 => println!("starved; once more"),
            Err(failure) => resume_unwind(failure),
        }
    }
}

/// What `work` gives, and the part of wake-ups that were late meanwhile.
fn while_watching<T>(work: impl FnOnce() -> T) -> (T, f64) {
    const NAP: Duration = Duration::from_millis(5);
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        let watch = scope.spawn(|| {
            let (mut late, mut all) = (0, 0);
            while !over.load(Relaxed) {
                let asleep = Instant::now();
                thread::sleep(NAP);
                late += u32::from(asleep.elapsed() > NAP + LATE);
                all += 1;
            }
            f64::from(late) / f64::from(all.max(1))
        });
        let outcome = work();
        over.store(true, Relaxed);
        (outcome, watch.join().expect("it only sleeps"))
    })
}
