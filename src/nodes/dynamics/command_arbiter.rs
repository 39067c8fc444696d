//! Who may command the robot: one at a time.

use std::time::{Duration, Instant};

use crate::ros::Gid;

/// Keeps the robot for the publisher that commands it, until that is gone or has been silent for too long.
///
/// A publisher is known by its identity on the wire, which names and messages cannot forge by accident: a
/// second controller of the same name is another publisher.
#[derive(Debug)]
pub struct CommandArbiter {
    holder: Option<Gid>,
    /// When its last command came.
    heard: Instant,
    timeout: Duration,
}

impl CommandArbiter {
    /// Nobody commands; whoever is silent for `timeout` loses the robot.
    pub fn new(timeout: Duration) -> Self {
        Self {
            holder: None,
            heard: Instant::now(),
            timeout,
        }
    }

    /// A sound command of `publisher` has come. Gives whether it may act; `is_there` tells whether a publisher is
    /// still in the graph.
    pub fn admit(&mut self, publisher: Gid, is_there: impl Fn(Gid) -> bool) -> bool {
        if let Some(holder) = self.holder
            && holder != publisher
            && self.heard.elapsed() <= self.timeout
            && is_there(holder)
        {
            return false;
        }
        self.holder = Some(publisher);
        self.heard = Instant::now();
        true
    }

    /// Who commands.
    pub fn holder(&self) -> Option<Gid> {
        self.holder
    }

    /// Nobody commands any more.
    pub fn forget(&mut self) {
        self.holder = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gid(n: u8) -> Gid {
        Gid::from([n; 16])
    }

    // Would break if two publishers could command by turns.
    #[test]
    fn one_commands_until_it_is_silent_or_gone() {
        let mut commander = CommandArbiter::new(Duration::from_secs(3600));
        let there = |_| true;
        assert!(commander.admit(gid(1), there));
        assert!(!commander.admit(gid(2), there));
        assert!(commander.admit(gid(1), there));
        assert_eq!(commander.holder(), Some(gid(1)));
        assert!(commander.admit(gid(2), |holder| holder != gid(1)));
        assert!(!commander.admit(gid(1), there));
        commander.timeout = Duration::ZERO;
        commander.heard -= Duration::from_millis(1);
        assert!(commander.admit(gid(1), there));
    }
}
