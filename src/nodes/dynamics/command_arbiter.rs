//! Command arbiter: only one commander at a time controls the robot's joints.

use std::time::{Duration, Instant};

use crate::ros::Gid;

/// Who commands the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Commander {
    /// A publisher of a topic.
    Publisher(Gid),
    /// The clients of the action `follow_joint_trajectory`, as one commander: a goal of one client replaces that of
    /// another.
    Action,
}

/// Reserves the robot for one commander, the holder, until the holder leaves the graph or is silent for longer than the
/// timeout. While a motion is executed, silence does not count, since a motion needs no further messages.
///
/// A publisher is identified by its GUID, not by its node's name: a second controller of the same name is a different
/// commander.
#[derive(Debug)]
pub struct CommandArbiter {
    holder: Option<Commander>,
    /// Whether a motion of the holder is being executed.
    is_moving: bool,
    /// When the holder's last command arrived.
    last_command: Instant,
    timeout: Duration,
}

impl CommandArbiter {
    /// An arbiter without a holder; a holder that is silent for `timeout` loses the robot.
    pub fn new(timeout: Duration) -> Self {
        Self {
            holder: None,
            is_moving: false,
            last_command: Instant::now(),
            timeout,
        }
    }

    /// Decides whether a valid command is admitted; if so, its commander becomes the holder. `is_present` says whether
    /// a publisher is still in the graph.
    pub fn admit(&mut self, commander: Commander, is_present: impl Fn(Gid) -> bool) -> bool {
        if !self.is_free_for(commander, is_present) {
            return false;
        }
        self.holder = Some(commander);
        self.is_moving = false;
        self.last_command = Instant::now();
        true
    }

    /// The holder's last command has begun a motion.
    pub fn begin_motion(&mut self) {
        self.is_moving = true;
    }

    /// The motion is over: the robot is free for others at once.
    pub fn end_motion(&mut self) {
        if self.is_moving {
            self.release();
        }
    }

    /// Whether a motion of the holder is being executed.
    pub fn is_moving(&self) -> bool {
        self.is_moving
    }

    /// Whether a command of `commander` would be admitted.
    pub fn is_free_for(&self, commander: Commander, is_present: impl Fn(Gid) -> bool) -> bool {
        let is_present = |holder| match holder {
            Commander::Publisher(publisher) => is_present(publisher),
            Commander::Action => self.is_moving,
        };
        self.holder.is_none_or(|holder| {
            let is_silent = !self.is_moving && self.last_command.elapsed() > self.timeout;
            holder == commander || is_silent || !is_present(holder)
        })
    }

    /// The commander that holds the robot.
    pub fn holder(&self) -> Option<Commander> {
        self.holder
    }

    /// Frees the robot.
    pub fn release(&mut self) {
        (self.holder, self.is_moving) = (None, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gid(n: u8) -> Commander {
        Commander::Publisher(Gid::from([n; 16]))
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
        assert!(arbiter.admit(gid(2), |holder| Commander::Publisher(holder) != gid(1)));
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

    // Would break if a motion could be interrupted by another commander because its sender has nothing more to say.
    #[test]
    fn a_motion_holds_the_robot_until_it_is_over() {
        let mut arbiter = CommandArbiter::new(Duration::ZERO);
        let present = |_| true;
        assert!(arbiter.admit(Commander::Action, present));
        arbiter.begin_motion();
        arbiter.last_command -= Duration::from_secs(1);
        assert!(!arbiter.admit(gid(1), present));
        assert!(arbiter.is_free_for(Commander::Action, present));
        arbiter.end_motion();
        assert_eq!(arbiter.holder(), None);
        assert!(arbiter.admit(gid(1), present));
        arbiter.begin_motion();
        arbiter.last_command -= Duration::from_secs(1);
        assert!(!arbiter.admit(Commander::Action, present));
        // A publisher that publishes once and leaves the graph does not keep the robot.
        assert!(arbiter.admit(Commander::Action, |_| false));
        // `end_motion` without a motion does not release the holder.
        arbiter.end_motion();
        assert_eq!(arbiter.holder(), Some(Commander::Action));
    }
}
