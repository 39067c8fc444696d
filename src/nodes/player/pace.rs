//! Playback timing: when a recorded message is due.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use super::tell_time;
use crate::{
    msg::rosgraph_msgs::Clock,
    ros::{Node, Publisher},
};

/// Longest wait for the next message without a log message.
const USUAL_WAIT: Duration = Duration::from_secs(10);

/// Longest sleep between checks for stop and pause.
const SLICE: Duration = Duration::from_millis(20);

/// Maps wall time to recorded time.
pub(super) struct Pace<'a> {
    node: &'a Node,
    begin: u64,
    rate: f64,
    paused: Arc<AtomicBool>,
    /// A wall time and the recorded time at that moment.
    origin: (Instant, u64),
    clock: Option<Publisher<Clock>>,
    clock_period: Duration,
    next_clock: Instant,
}

impl<'a> Pace<'a> {
    /// Begins at the recorded time `begin`.
    pub fn new(
        node: &'a Node,
        begin: u64,
        rate: f64,
        clock_rate: Option<f64>,
        clock: Option<Publisher<Clock>>,
        paused: Arc<AtomicBool>,
    ) -> Self {
        let now = Instant::now();
        Self {
            node,
            begin,
            rate,
            paused,
            origin: (now, begin),
            clock,
            clock_period: Duration::from_secs_f64(1.0 / clock_rate.unwrap_or(1.0)),
            next_clock: now,
        }
    }

    /// Begins again at the recorded time `begin`.
    pub fn restart(&mut self) {
        self.origin = (Instant::now(), self.begin);
    }

    /// Waits `patience` of wall time; recorded time does not advance.
    pub fn wait(&mut self, patience: Duration) {
        let until = Instant::now() + patience;
        while self.node.ok() && Instant::now() < until {
            std::thread::sleep(SLICE.min(until.saturating_duration_since(Instant::now())));
        }
        self.restart();
    }

    /// Waits until the recorded time `time`; `false` if the node must stop.
    pub fn reach(&mut self, time: u64) -> bool {
        let mut is_logged = false;
        loop {
            if !self.node.ok() {
                return false;
            }
            let now = Instant::now();
            if self.paused.load(Ordering::Acquire) {
                let here = self.recorded(now).min(time);
                self.publish_clock(now, here);
                std::thread::sleep(SLICE);
                // Recorded time does not advance during a pause.
                self.origin = (Instant::now(), here);
                continue;
            }
            let (instant, recorded) = self.origin;
            let ahead = time.saturating_sub(recorded) as f64 * 1e-9 / self.rate;
            let passed = now.saturating_duration_since(instant);
            let left = Duration::try_from_secs_f64(ahead)
                .unwrap_or(Duration::MAX)
                .saturating_sub(passed);
            self.publish_clock(now, self.recorded(now).min(time));
            if left.is_zero() {
                return true;
            }
            if left > USUAL_WAIT && !is_logged {
                is_logged = true;
                let gap = time.saturating_sub(self.recorded(now));
                tracing::warn!("{}", long_wait(gap, left));
            }
            let mut nap = left.min(SLICE);
            if self.clock.is_some() {
                nap = nap.min(self.next_clock.saturating_duration_since(now));
            }
            std::thread::sleep(nap);
        }
    }

    /// The recorded time at the wall time `now`.
    fn recorded(&self, now: Instant) -> u64 {
        let (instant, recorded) = self.origin;
        let passed = now.saturating_duration_since(instant).as_secs_f64();
        // Casts from floats saturate.
        recorded.saturating_add((passed * self.rate * 1e9) as u64)
    }

    fn publish_clock(&mut self, now: Instant, time: u64) {
        let Some(clock) = &self.clock else { return };
        if now >= self.next_clock {
            tell_time(clock, time);
            self.next_clock = (self.next_clock + self.clock_period).max(now);
        }
    }
}

/// The log message on a gap of `nanos` in the bag, which takes `left` to play.
fn long_wait(nanos: u64, left: Duration) -> String {
    format!(
        "the next message in the bag is {:.0} s later: waiting for {:.0} s (--rate plays faster, --start-offset skips what is before)",
        nanos as f64 * 1e-9,
        left.as_secs_f64()
    )
}
