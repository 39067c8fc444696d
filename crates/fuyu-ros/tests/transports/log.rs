//! The log of all routers of this process.

use fuyu_ros::ros::RouterLog;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::router::eventually;

static LINES: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Begins to keep it, for one test at a time: as long as that keeps what is returned.
pub fn start() -> MutexGuard<'static, ()> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let guard = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    RouterLog::start(|_, line| LINES.lock().unwrap().push(line));
    LINES.lock().unwrap().clear();
    guard
}

/// Whether a line has all of these words.
pub fn said(words: &[&str]) -> bool {
    let lines = LINES.lock().unwrap();
    lines
        .iter()
        .any(|line| words.iter().all(|w| line.contains(w)))
}

/// Waits for a line with all of these words.
#[track_caller]
pub fn has(words: &[&str]) {
    let mut at_last = Vec::new();
    let is_there = || {
        at_last = LINES.lock().unwrap().clone();
        said(words)
    };
    if let Err(e) = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        eventually(&format!("the log has {words:?}"), is_there);
    })) {
        eprintln!("the log: {at_last:#?}");
        std::panic::resume_unwind(e);
    }
}
