//! Command arbiter: one publisher at a time commands the robot.

use std::time::{Duration, Instant};

use crate::ros::Gid;

/// Reserves the robot for the publisher that commands it, until that publisher has left the graph or has been silent for
/// too long.
///
/// A publisher is known by its GUID, not by the name of its node: a second controller of the same name is another
/// publisher.
#[derive(Debug)]
pub struct CommandArbiter {
    holder: Option<Gid>,
    /// When the holder's last command arrived.
    last_command: Instant,
    timeout: Duration,
}

impl CommandArbiter {
    /// No publisher holds the robot; one that is silent for `timeout` loses it.
    pub fn new(timeout: Duration) -> Self {
        Self {
            holder: None,
            last_command: Instant::now(),
            timeout,
        }
    }

    /// Decides whether a valid command of `publisher` may act; if so, it holds the robot. `is_present` says whether a
    /// publisher is still in the graph.
    pub fn admit(&mut self, publisher: Gid, is_present: impl Fn(Gid) -> bool) -> bool {
        if !self.is_free_for(publisher, is_present) {
            return false;
        }
        self.holder = Some(publisher);
        self.last_command = Instant::now();
        true
    }

    /// Whether a command of `publisher` would be admitted.
    pub fn is_free_for(&self, publisher: Gid, is_present: impl Fn(Gid) -> bool) -> bool {
        let Some(holder) = self.holder else {
            return true;
        };
        holder == publisher || self.last_command.elapsed() > self.timeout || !is_present(holder)
    }

    /// The publisher that holds the robot.
    pub fn holder(&self) -> Option<Gid> {
        self.holder
    }

    /// Frees the robot.
    pub fn release(&mut self) {
        self.holder = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gid(n: u8) -> Gid {
        Gid::from([n; 16])
    }

    // Would break if two publishers could command alternately.
    #[test]
    fn one_publisher_commands_until_it_is_silent_or_gone() {
        let mut arbiter = CommandArbiter::new(Duration::from_secs(3600));
        let present = |_| true;
        assert!(arbiter.admit(gid(1), present));
        assert!(!arbiter.admit(gid(2), present));
        assert!(arbiter.admit(gid(1), present));
        assert_eq!(arbiter.holder(), Some(gid(1)));
        assert!(arbiter.admit(gid(2), |holder| holder != gid(1)));
        assert!(!arbiter.admit(gid(1), present));
        arbiter.timeout = Duration::ZERO;
        arbiter.last_command -= Duration::from_millis(1);
        assert!(arbiter.admit(gid(1), present));
    }

    #[test]
    fn a_released_robot_is_free_for_all() {
        let mut arbiter = CommandArbiter::new(Duration::from_secs(3600));
        assert!(arbiter.admit(gid(1), |_| true));
        arbiter.release();
        assert_eq!(arbiter.holder(), None);
        assert!(arbiter.admit(gid(2), |_| true));
    }
}
