//! When a recorded moment is due.

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

/// How long it sleeps before it looks whether it is to stop or to pause.
const SLICE: Duration = Duration::from_millis(20);

/// Recorded time as it passes.
pub(super) struct Pace<'a> {
    node: &'a Node,
    begin: u64,
    rate: f64,
    paused: Arc<AtomicBool>,
    /// A moment of the computer's clock and what recorded time it was.
    origin: (Instant, u64),
    clock: Option<Publisher<Clock>>,
    clock_period: Duration,
    next_clock: Instant,
}

impl<'a> Pace<'a> {
    /// Recorded time `begin` is now.
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

    /// Begins anew.
    pub fn restart(&mut self) {
        self.origin = (Instant::now(), self.begin);
    }

    /// Lets `patience` of the computer's time pass, and no recorded time.
    pub fn wait(&mut self, patience: Duration) {
        let until = Instant::now() + patience;
        while self.node.ok() && Instant::now() < until {
            std::thread::sleep(SLICE.min(until.saturating_duration_since(Instant::now())));
        }
        self.restart();
    }

    /// Waits until it is recorded time `time`; `false` if the node is to stop.
    pub fn reach(&mut self, time: u64) -> bool {
        loop {
            if !self.node.ok() {
                return false;
            }
            let now = Instant::now();
            if self.paused.load(Ordering::Acquire) {
                let here = self.recorded(now).min(time);
                self.publish_clock(now, here);
                std::thread::sleep(SLICE);
                // Recorded time stood still meanwhile.
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
            let mut nap = left.min(SLICE);
            if self.clock.is_some() {
                nap = nap.min(self.next_clock.saturating_duration_since(now));
            }
            std::thread::sleep(nap);
        }
    }

    /// The recorded time at `now`.
    fn recorded(&self, now: Instant) -> u64 {
        let (instant, recorded) = self.origin;
        let passed = now.saturating_duration_since(instant).as_secs_f64();
        // A cast of floats stops at the largest number.
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
