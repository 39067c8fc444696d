//! The clock of a node: the computer's clock or, if `use_sim_time` is set, simulated time from `/clock`.

use std::{
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use super::{Gid, Time, events::Events};

/// The time of a node. Clones show the same time.
#[derive(Debug, Clone)]
pub struct Clock {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    simulated: AtomicBool,
    /// Whether the node's program sets the time ([`Clock::drive`]).
    driven: AtomicBool,
    /// Last time received on `/clock` [ns]; zero before the first message.
    now: AtomicI64,
    /// Number of changes to another publisher of `/clock` while the previous one was still publishing.
    changes_of_publisher: AtomicU64,
    /// The publisher of `/clock` that sets the time.
    followed: Mutex<Option<Gid>>,
    events: Arc<Events>,
}

impl Clock {
    pub(super) fn new(events: Arc<Events>) -> Self {
        Self {
            inner: Arc::new(Inner {
                simulated: AtomicBool::new(false),
                driven: AtomicBool::new(false),
                now: AtomicI64::new(0),
                changes_of_publisher: AtomicU64::new(0),
                followed: Mutex::default(),
                events,
            }),
        }
    }

    /// The present time: of the computer, or the last one received on `/clock` (zero before the first message).
    pub fn now(&self) -> Time {
        if self.is_simulated() {
            Time::from_nanos(self.inner.now.load(Ordering::Acquire))
        } else {
            Time::wall()
        }
    }

    /// Whether `use_sim_time` is set.
    pub fn is_simulated(&self) -> bool {
        self.inner.simulated.load(Ordering::Acquire)
    }

    pub(super) fn simulate(&self, simulated: bool) {
        self.inner.simulated.store(simulated, Ordering::Release);
        self.inner.events.notify();
    }

    /// Sets the time of a node whose program runs the simulation and publishes `/clock` itself; the node ignores
    /// received `/clock` messages from then on. From the first call on, stamps, timers, log and diagnostics use the
    /// last time set here, whatever the value of `use_sim_time`, and waits need a limit in wall time, as in
    /// [`Node::wait_for`](crate::ros::Node::wait_for).
    pub fn drive(&self, now: Time) {
        self.inner.driven.store(true, Ordering::Release);
        // The time is stored first, so that no thread sees simulated time before its start.
        self.inner.now.store(now.as_nanos(), Ordering::Release);
        self.inner.simulated.store(true, Ordering::Release);
        // No event: the only program that could wait for one makes this call.
    }

    /// Number of changes to another publisher of `/clock` while the previous one was still publishing. A jump of the
    /// time at such a change is not a restart of the simulation.
    pub fn changes_of_publisher(&self) -> u64 {
        self.inner.changes_of_publisher.load(Ordering::Acquire)
    }

    pub(super) fn publisher_changes(&self) {
        let count = &self.inner.changes_of_publisher;
        count.fetch_add(1, Ordering::AcqRel);
    }

    /// Whether this publisher of `/clock` sets the time; by mistake there may be several publishers. True for all
    /// publishers before the first message.
    pub fn follows(&self, publisher: Gid) -> bool {
        self.followed().is_none_or(|followed| followed == publisher)
    }

    fn followed(&self) -> MutexGuard<'_, Option<Gid>> {
        let followed = self.inner.followed.lock();
        followed.unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn set_publisher(&self, publisher: Gid) {
        *self.followed() = Some(publisher);
    }

    /// Whether the node's program sets the time.
    pub(super) fn is_driven(&self) -> bool {
        self.inner.driven.load(Ordering::Acquire)
    }

    /// Sets the time from a `/clock` message, unless the node's program sets the time.
    pub(super) fn set(&self, now: Time) {
        if self.inner.driven.load(Ordering::Acquire) {
            return;
        }
        self.inner.now.store(now.as_nanos(), Ordering::Release);
        if self.is_simulated() {
            self.inner.events.notify_of_message();
        }
    }

    /// The computer's time at which `time` is reached; `None` for simulated time, whose rate is unknown, and for times
    /// too far ahead.
    pub(super) fn instant(&self, time: Time) -> Option<Instant> {
        if self.is_simulated() {
            return None;
        }
        Instant::now().checked_add(time.since(Time::wall()))
    }
}

/// Periodic timer in the time of a node.
#[derive(Debug)]
pub struct Timer {
    clock: Clock,
    period: Duration,
    next: Time,
    missed: u64,
}

impl Timer {
    pub(super) fn new(clock: Clock, period: Duration) -> Self {
        let next = clock.now() + period;
        Self {
            clock,
            period,
            next,
            missed: 0,
        }
    }

    /// Time at which the timer is due next.
    pub fn next(&self) -> Time {
        // After the clock was set back (restart of the simulation), the timer must not wait for the old time.
        self.next.min(self.clock.now() + self.period)
    }

    /// Whether the timer is due. If it is, the timer is set to the next period; periods that were missed are skipped
    /// and counted.
    pub fn due(&mut self) -> bool {
        let now = self.clock.now();
        self.next = self.next();
        if now < self.next {
            return false;
        }
        self.next += self.period;
        if self.next <= now && !self.period.is_zero() {
            let late = now.since(self.next).as_nanos() / self.period.as_nanos() + 1;
            self.missed += late as u64;
            self.next += Duration::from_nanos((late * self.period.as_nanos()) as u64);
        }
        true
    }

    /// Period of the timer.
    pub fn period(&self) -> Duration {
        self.period
    }

    /// Sets the period, counted from now.
    pub fn set_period(&mut self, period: Duration) {
        self.period = period;
        self.next = self.clock.now() + period;
    }

    /// Number of skipped periods.
    pub fn missed(&self) -> u64 {
        self.missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if setting the time wakes the program that does so, or if it reads the computer's time.
    #[test]
    fn a_driven_clock_shows_its_time_and_wakes_nobody() {
        let events = Arc::new(Events::default());
        let clock = Clock::new(Arc::clone(&events));
        let mut timer = Timer::new(clock.clone(), Duration::from_secs(1));
        clock.drive(Time::from_secs_f64(2.5));
        assert!(clock.is_simulated());
        assert_eq!(clock.now(), Time::from_secs_f64(2.5));
        assert_eq!(events.wait(0, Some(Instant::now())), 0);
        assert!(!timer.due());
        clock.drive(Time::from_secs_f64(3.5));
        assert!(timer.due());
        // A `/clock` message of the node itself, which arrives late.
        clock.set(Time::from_secs_f64(2.5));
        assert_eq!(clock.now(), Time::from_secs_f64(3.5));
    }

    #[test]
    fn a_timer_follows_the_simulated_clock_forward_and_back() {
        let clock = Clock::new(Arc::default());
        clock.simulate(true);
        clock.set(Time::from_secs_f64(10.0));
        let mut timer = Timer::new(clock.clone(), Duration::from_secs(1));
        assert!(!timer.due());
        clock.set(Time::from_secs_f64(11.0));
        assert!(timer.due() && !timer.due());
        // Three periods have passed: the timer is due once and counts two missed periods.
        clock.set(Time::from_secs_f64(14.5));
        assert!(timer.due() && !timer.due());
        assert_eq!(timer.missed(), 2);
        assert_eq!(timer.next(), Time::from_secs_f64(15.0));
        clock.set(Time::ZERO);
        assert_eq!(timer.next(), Time::from_secs_f64(1.0));
        clock.set(Time::from_secs_f64(1.0));
        assert!(timer.next() <= Time::from_secs_f64(2.0));
    }
}
