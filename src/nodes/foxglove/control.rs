//! Control arbitration: one client at a time has control, as long as its messages arrive.

use std::time::{Duration, Instant};

/// Number of clients whose delays are remembered.
const REMEMBERED: usize = 64;
/// Largest clock drift between client and server that is tracked \[s/s\].
const DRIFT: f64 = 1e-3;

/// Arbiter of control over the robot. Clients are identified by `C`.
#[derive(Debug)]
pub struct Control<C> {
    timeout: Duration,
    holder: Option<Holder<C>>,
    /// The client that lost control last by silence. Its delayed messages must not give it control again.
    silent: Option<C>,
    /// Delays of the clients that have had control, the current one last. They are kept, since a client that takes
    /// control again after a network stall may still have delayed commands on the way.
    delays: Vec<(C, Delay)>,
}

#[derive(Debug)]
struct Holder<C> {
    client: C,
    heard: Instant,
}

impl<C: Copy + PartialEq> Control<C> {
    /// Nobody has control. A client loses control when it is silent for `timeout`.
    pub fn new(timeout: Duration) -> Self {
        Self {
            timeout,
            holder: None,
            silent: None,
            delays: Vec::new(),
        }
    }

    /// Gives `client` control if nobody else has it. Returns whether `client` has control now.
    pub fn take(&mut self, client: C, now: Instant) -> bool {
        match &mut self.holder {
            Some(holder) if holder.client == client => holder.heard = now,
            Some(_) => return false,
            None => {
                self.holder = Some(Holder { client, heard: now });
                self.silent = None;
                self.remember(client);
            }
        }
        true
    }

    /// Moves the delays of `client` to the end of the list, the place of the client in control.
    fn remember(&mut self, client: C) {
        let known = self.delays.iter().position(|(known, _)| *known == client);
        let delay = known.map_or(Delay::default(), |i| self.delays.remove(i).1);
        if self.delays.len() >= REMEMBERED {
            self.delays.remove(0);
        }
        self.delays.push((client, delay));
    }

    /// Whether a command published by `client` is accepted. If nobody has control, the client takes it by the command,
    /// unless it has just lost control by silence.
    pub fn command(&mut self, client: C, now: Instant) -> bool {
        if self.holder.is_none() && self.silent == Some(client) {
            return false;
        }
        self.take(client, now)
    }

    /// Whether `client` has control.
    pub fn holds(&self, client: C) -> bool {
        self.holder.as_ref().is_some_and(|h| h.client == client)
    }

    /// Whether any client has control.
    pub fn is_held(&self) -> bool {
        self.holder.is_some()
    }

    /// Lateness of a message \[s\]: its delay beyond the smallest delay of the client in control. `sent` is by the
    /// client's clock, `received` by the server's.
    pub fn lateness(&mut self, sent: f64, received: f64) -> f64 {
        match (&self.holder, self.delays.last_mut()) {
            (Some(_), Some((_, delay))) => delay.excess(sent, received),
            _ => 0.0,
        }
    }

    /// Ends the control of `client`. Returns whether it had control.
    pub fn release(&mut self, client: C) -> bool {
        let held = self.holds(client);
        if held {
            self.holder = None;
        }
        held
    }

    /// Ends the control of a client that was silent for too long. Returns the client.
    pub fn expire(&mut self, now: Instant) -> Option<C> {
        let holder = self.holder.as_ref()?;
        let (client, silence) = (holder.client, now.saturating_duration_since(holder.heard));
        if silence <= self.timeout {
            return None;
        }
        self.holder = None;
        self.silent = Some(client);
        Some(client)
    }
}

/// Delays of messages between two clocks with unknown offset, relative to the smallest delay.
#[derive(Debug, Default)]
struct Delay {
    /// Smallest clock difference (received minus sent) so far, corrected for drift, and the time of its last update
    /// \[s\].
    least: Option<(f64, f64)>,
}

impl Delay {
    fn excess(&mut self, sent: f64, received: f64) -> f64 {
        let difference = received - sent;
        let least = match self.least {
            Some((least, at)) => (least + DRIFT * (received - at).max(0.0)).min(difference),
            None => difference,
        };
        self.least = Some((least, received));
        difference - least
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIMEOUT: Duration = Duration::from_secs(1);

    #[test]
    fn one_client_operates_until_it_releases() {
        let mut control = Control::new(TIMEOUT);
        let now = Instant::now();
        assert!(!control.is_held());
        assert!(control.command('a', now) && control.holds('a'));
        assert!(!control.take('b', now) && !control.command('b', now));
        assert!(!control.release('b') && control.holds('a'));
        assert!(control.release('a') && !control.is_held());
        assert!(control.take('b', now) && !control.command('a', now));
    }

    // A network that was interrupted delivers what was sent during the interruption.
    #[test]
    fn a_silent_client_loses_control_and_must_ask_for_it() {
        let mut control = Control::new(TIMEOUT);
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        assert!(control.command('a', at(0)) && control.command('a', at(900)));
        assert_eq!(control.expire(at(1900)), None);
        assert_eq!(control.expire(at(1901)), Some('a'));
        assert_eq!(control.expire(at(1902)), None);
        assert!(!control.command('a', at(1950)) && !control.is_held());
        assert!(control.take('a', at(2000)) && control.command('a', at(2001)));
        // Another client need not ask first.
        assert_eq!(control.expire(at(9000)), Some('a'));
        assert!(control.command('b', at(9001)));
    }

    // The call that takes control again comes before commands that were held up with it.
    #[test]
    fn commands_are_late_too_after_control_was_taken_again() {
        let mut control = Control::new(TIMEOUT);
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        control.take('a', at(0));
        assert_eq!(control.lateness(0.0, 0.1), 0.0);
        assert_eq!(control.expire(at(1500)), Some('a'));
        assert!(control.take('a', at(2000)));
        assert!((control.lateness(0.4, 2.0) - 1.5).abs() < 0.01);
        // Another client has delays of its own, and does not disturb those of the first.
        control.release('a');
        assert!(control.take('b', at(2100)));
        assert_eq!(control.lateness(0.0, 5.0), 0.0);
        control.release('b');
        assert!(control.take('a', at(2200)));
        assert!((control.lateness(2.0, 2.2) - 0.1).abs() < 0.01);
    }

    #[test]
    fn the_memory_of_delays_is_bounded() {
        let mut control = Control::new(TIMEOUT);
        for client in 0..1000 {
            assert!(control.take(client, Instant::now()) && control.release(client));
        }
        assert_eq!(control.delays.len(), REMEMBERED);
    }

    #[test]
    fn lateness_is_measured_between_clocks_of_any_offset() {
        for offset in [0.0, 1e9, -1e9] {
            let mut control = Control::new(TIMEOUT);
            control.take('a', Instant::now());
            let mut late = |sent: f64, delay| control.lateness(sent, sent + delay + offset);
            let close = |a: f64, b: f64| (a - b).abs() < 1e-6;
            assert!(close(late(0.0, 0.08), 0.0));
            assert!(close(late(0.02, 0.05), 0.0));
            assert!(close(late(0.04, 0.75), 0.7 - 0.72 * DRIFT));
            assert!(late(0.8, 0.05).abs() < 2e-3);
            // A clock that is slower by 5e-4 s/s is not late after an hour.
            for i in 1..36_000 {
                let t = f64::from(i) * 0.1;
                assert!(late(t, 0.05 + 5e-4 * t) < 1e-3);
            }
        }
    }
}
