//! Common simulated time of several robots, each simulated by its own dynamics node.
//!
//! The node of the first robot in the parameter `robots` owns the time and publishes `/clock`; the others simulate up
//! to the time of `/clock`. At the start, and after a reset, the owner waits until all others have published their
//! first state, and then their second state, which a robot with `start_on_command` publishes after its first command.
//! Later, before each tick, it waits until the others have published their states of the current time: in lockstep
//! always; otherwise for `answer_timeout`, and only for nodes that have published their previous state in time.

use std::time::{Duration, Instant};

use super::params::DynamicsParams;
use crate::{
    msg::{nav_msgs::Odometry, rosgraph_msgs::Clock},
    nodes::topics,
    ros::{Gid, Node, NodeError, Subscription, Time},
};

/// How long `/clock` must repeat one time for simulated time to count as standing still.
const STANDS_STILL: Duration = Duration::from_secs(1);

/// Maximum number of foreign publishers of `/clock` that are reported.
const MOST_OTHER_PUBLISHERS: usize = 16;

/// Role of a node in a world with one or several robots.
pub enum SharedTime {
    /// The only robot.
    Alone,
    /// This node owns the time.
    Leader {
        /// The other robots.
        followers: Vec<Follower>,
        /// Silence after which another robot is not waited for in real time.
        follower_timeout: Duration,
        /// Stamps of this node's last states.
        stamps: LastStamps,
    },
    /// Another node owns the time; this node follows `/clock`.
    Follower(LeaderClock),
}

/// Another robot, whose node follows `/clock`.
pub struct Follower {
    odometry: Subscription<Odometry>,
    progress: Progress,
}

impl Follower {
    /// Whether a state has arrived from it within the last `follower_timeout`.
    fn is_alive(&self, follower_timeout: Duration) -> bool {
        self.odometry
            .age()
            .is_some_and(|age| age < follower_timeout)
    }
}

/// Stamps of the last two states of the node that owns the time; both are zero before the second state.
#[derive(Debug, Clone, Copy, Default)]
pub struct LastStamps {
    previous: Time,
    current: Time,
}

impl LastStamps {
    /// Records that the state of `stamp` was published, possibly again.
    fn publish(&mut self, stamp: Time) {
        if stamp != self.current {
            (self.previous, self.current) = (self.current, stamp);
        }
    }
}

/// Progress of another robot since the start or the last reset.
#[derive(Debug, Default)]
struct Progress {
    /// Stamp of its last state.
    last: Option<Time>,
    /// Whether it has published a state after time zero.
    has_advanced: bool,
}

impl Progress {
    /// Records that its state of `stamp` has arrived.
    fn see(&mut self, stamp: Time, stamps: LastStamps) {
        // A robot is never ahead of the owner of the time: such a state is from before a reset.
        if stamp <= stamps.current {
            self.last = Some(stamp);
            self.has_advanced |= stamp > Time::ZERO;
        }
    }

    /// Whether its state of the last tick is still missing.
    fn is_behind(&self, stamps: LastStamps) -> bool {
        self.last != Some(stamps.current)
    }

    /// Whether its state of the last tick is still missing, but that of the tick before had arrived.
    fn has_just_fallen_behind(&self, stamps: LastStamps) -> bool {
        self.is_behind(stamps) && self.last == Some(stamps.previous)
    }

    /// Whether its first states have arrived, so that time may advance from the last tick.
    fn is_ready(&self, stamps: LastStamps) -> bool {
        self.last.is_some() && (self.has_advanced || stamps.current == Time::ZERO)
    }
}

/// `/clock` as published by the node that owns the time.
pub struct LeaderClock {
    node: Node,
    clock: Subscription<Clock>,
    /// Namespace of the robot whose node owns the time.
    leader: String,
    /// The publisher of that node, once known.
    publisher: Option<Gid>,
    /// Publishers of other nodes, already reported.
    other_publishers: Vec<Gid>,
    /// The last received time, and the instant of its first arrival.
    now: Option<(Time, Instant)>,
}

impl LeaderClock {
    fn new(node: &Node, leader: &str) -> Result<Self, NodeError> {
        // Reliable, unlike other subscriptions to `/clock`: this node cannot simulate without a new time.
        let clock = topics::CLOCK.subscribe(node)?;
        clock.separate_publishers();
        Ok(Self {
            node: node.clone(),
            clock,
            leader: leader.to_owned(),
            publisher: None,
            other_publishers: Vec::new(),
            now: None,
        })
    }

    fn take(&mut self) {
        while let Some(received) = self.clock.take() {
            if !self.is_of_leader(received.publisher) {
                continue;
            }
            let time = Time::from(received.message.clock);
            if self.now.is_none_or(|(shown, _)| shown != time) {
                self.now = Some((time, Instant::now()));
            }
        }
    }

    /// Whether a publisher of `/clock` is in the leader's namespace. Warns of others. A publisher whose node is not
    /// known yet is ignored; meanwhile the leader repeats each time.
    fn is_of_leader(&mut self, publisher: Gid) -> bool {
        if self.publisher == Some(publisher) {
            return true;
        }
        if self.other_publishers.contains(&publisher) {
            return false;
        }
        let Some(name) = self.node.node_of(publisher) else {
            return false;
        };
        let is_of_leader = is_in_namespace(&name, &self.leader);
        match is_of_leader {
            true => self.publisher = Some(publisher),
            false if self.other_publishers.len() == MOST_OTHER_PUBLISHERS => {}
            false => {
                self.other_publishers.push(publisher);
                tracing::warn!(
                    "/clock: ignoring the time of node {name}: `robots` names {} first, whose dynamics node alone should publish it",
                    self.leader
                );
            }
        }
        is_of_leader
    }

    fn time(&self) -> Option<Time> {
        self.now.map(|(time, _)| time)
    }
}

/// Whether the node called `name` is directly in this namespace, not in a nested one.
fn is_in_namespace(name: &str, namespace: &str) -> bool {
    let parent = name.rsplit_once('/').map(|(parent, _)| parent);
    parent == Some(namespace.trim_end_matches('/'))
}

impl SharedTime {
    /// The role of `node`.
    ///
    /// # Errors
    /// When the parameter `robots` does not name the node's namespace, or the node cannot subscribe.
    pub fn new(node: &Node, params: &DynamicsParams) -> Result<Self, NodeError> {
        let Some(leader) = params.robots.first() else {
            return Ok(Self::Alone);
        };
        let own = node.name().namespace();
        if !params.robots.iter().any(|robot| robot == own) {
            return Err(NodeError::Input(format!(
                "node {}: parameter robots is [{}], which does not name this robot's namespace, {own}",
                node.name(),
                params.robots.join(", ")
            )));
        }
        if leader != own {
            return Ok(Self::Follower(LeaderClock::new(node, leader)?));
        }
        let followers = params.robots.iter().skip(1).map(|namespace| {
            let base = format!("{}/{}", namespace.trim_end_matches('/'), topics::BASE);
            let topic = topics::TARGET_ODOMETRY.of(&base);
            Ok(Follower {
                odometry: node.subscribe(&topic, topics::ODOMETRY.qos)?,
                progress: Progress::default(),
            })
        });
        Ok(Self::Leader {
            followers: followers.collect::<Result<_, NodeError>>()?,
            follower_timeout: Duration::from_secs_f64(params.answer_timeout),
            stamps: LastStamps::default(),
        })
    }

    /// Takes received messages.
    pub fn take(&mut self) {
        match self {
            Self::Alone => {}
            Self::Leader {
                followers, stamps, ..
            } => {
                for follower in followers {
                    if let Some(received) = follower.odometry.latest() {
                        let stamp = Time::from(&received.message.header.stamp);
                        follower.progress.see(stamp, *stamps);
                    }
                }
            }
            Self::Follower(clock) => clock.take(),
        }
    }

    /// Records that the state of `time` \[s\] was published.
    pub fn published(&mut self, time: f64) {
        if let Self::Leader { stamps, .. } = self {
            stamps.publish(Time::from_secs_f64(time));
        }
    }

    /// Resets after time or state was reset: earlier states of other robots no longer count.
    pub fn restart(&mut self) {
        if let Self::Leader {
            followers, stamps, ..
        } = self
        {
            *stamps = LastStamps::default();
            for follower in followers {
                follower.progress = Progress::default();
            }
        }
    }

    /// Whether there are other robots.
    pub fn is_shared(&self) -> bool {
        !matches!(self, Self::Alone)
    }

    /// Whether the node follows `/clock`.
    pub fn is_follower(&self) -> bool {
        matches!(self, Self::Follower(_))
    }

    /// Namespace of the robot that owns the time, if it is another one.
    pub fn leader(&self) -> Option<&str> {
        match self {
            Self::Follower(clock) => Some(&clock.leader),
            _ => None,
        }
    }

    /// Why this node refuses to step, pause or reset the simulation; `None` unless another node owns the time.
    pub fn refusal(&self) -> Option<String> {
        self.leader().map(|leader| {
            format!(
                "time belongs to the dynamics node of the robot {leader}, which `robots` names first; ask that one"
            )
        })
    }

    /// Whether `/clock` shows an earlier time than the state of `time` \[s\], because its owner was reset.
    pub fn went_back(&self, time: f64) -> bool {
        self.clock_time()
            .is_some_and(|now| now < Time::from_secs_f64(time))
    }

    /// How far `/clock` is ahead of the state of `time` \[s\]; zero if the node owns the time.
    pub fn lag(&self, time: f64) -> f64 {
        self.clock_time()
            .map_or(0.0, |now| now.as_secs_f64() - time)
    }

    /// Whether the owner of the time has stopped time at `time` \[s\].
    pub fn stands_still(&self, time: f64) -> bool {
        match self {
            Self::Follower(LeaderClock {
                clock,
                now: Some((now, since)),
                ..
            }) => {
                *now == Time::from_secs_f64(time)
                    && since.elapsed() > STANDS_STILL
                    && clock.age().is_some_and(|age| age < STANDS_STILL)
            }
            _ => false,
        }
    }

    /// The time shown by `/clock`, if another node owns the time.
    fn clock_time(&self) -> Option<Time> {
        match self {
            Self::Follower(clock) => clock.time(),
            _ => None,
        }
    }

    /// Whether the other robots permit simulation of the next state, at `time` \[s\]: the owner of the time needs their
    /// states of the last tick, the others need a `/clock` of at least `time`.
    pub fn may_reach(&self, time: f64) -> bool {
        match self {
            Self::Alone => true,
            Self::Leader {
                followers, stamps, ..
            } => !followers.iter().any(|f| f.progress.is_behind(*stamps)),
            Self::Follower(clock) => {
                (clock.time()).is_some_and(|now| now >= Time::from_secs_f64(time))
            }
        }
    }

    /// Whether another robot that is alive and has kept up so far has not published its state of the last tick yet.
    pub fn is_awaiting_follower(&self) -> bool {
        match self {
            Self::Leader {
                followers,
                follower_timeout,
                stamps,
            } => followers.iter().any(|f| {
                f.is_alive(*follower_timeout) && f.progress.has_just_fallen_behind(*stamps)
            }),
            _ => false,
        }
    }

    /// Whether every other robot has been seen since the start or the last reset, and has left time zero if this one
    /// has.
    pub fn is_complete(&self) -> bool {
        match self {
            Self::Leader {
                followers, stamps, ..
            } => followers.iter().all(|f| f.progress.is_ready(*stamps)),
            _ => true,
        }
    }

    /// Description of the robots for which time waits after the state of `time` \[s\].
    pub fn awaited_robots(&self, time: f64) -> String {
        match self {
            Self::Alone => String::new(),
            Self::Leader {
                followers, stamps, ..
            } => {
                let behind = followers.iter().filter(|f| f.progress.is_behind(*stamps));
                let behind: Vec<_> = behind.map(|f| f.odometry.topic()).collect();
                let (tick, behind) = (stamps.current, behind.join(", "));
                match self.is_complete() || tick == Time::ZERO {
                    true => format!("the state of {tick} s on {behind}"),
                    false => format!(
                        "the state of {tick} s on {behind}; a robot with start_on_command begins with its first command"
                    ),
                }
            }
            Self::Follower(clock) => {
                let leader = &clock.leader;
                match clock.time() {
                    Some(now) if now > Time::from_secs_f64(time) => format!(
                        "/clock, which shows {now} s, between two states of this robot: is its state_rate that of {leader}?"
                    ),
                    _ => format!("/clock, from the dynamics node of the robot {leader}"),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(i: u32) -> Time {
        Time::from_secs_f64(0.01 * f64::from(i))
    }

    fn stamps(last: u32) -> LastStamps {
        let mut stamps = LastStamps::default();
        for i in 0..=last {
            stamps.publish(at(i));
            stamps.publish(at(i));
        }
        stamps
    }

    // Would break if time went on while a robot with start_on_command still waits for its first command.
    #[test]
    fn time_leaves_the_first_tick_with_all_robots() {
        let mut robot = Progress::default();
        assert!(!robot.is_ready(stamps(0)), "it was not seen yet");
        robot.see(at(0), stamps(0));
        assert!(robot.is_ready(stamps(0)));
        assert!(!robot.is_ready(stamps(1)), "it is held");
        robot.see(at(0), stamps(1));
        assert!(!robot.is_ready(stamps(1)), "it is still held");
        robot.see(at(1), stamps(1));
        assert!(robot.is_ready(stamps(1)) && robot.is_ready(stamps(2)));
        // A process that restarts while time advances does not delay it.
        robot.see(at(0), stamps(50));
        assert!(robot.is_ready(stamps(50)) && !robot.has_just_fallen_behind(stamps(50)));
    }

    // Would break if the time crawled while a robot catches up, one answer_timeout for each state.
    #[test]
    fn only_robots_that_keep_up_are_waited_for_in_real_time() {
        let mut robot = Progress::default();
        robot.see(at(4), stamps(4));
        assert!(!robot.has_just_fallen_behind(stamps(4)), "it is there");
        assert!(robot.has_just_fallen_behind(stamps(5)) && robot.is_behind(stamps(5)));
        assert!(!robot.has_just_fallen_behind(stamps(6)) && robot.is_behind(stamps(6)));
        robot.see(at(6), stamps(6));
        assert!(robot.has_just_fallen_behind(stamps(7)));
    }

    // Would break if a state that was on its way during a reset counted as one of the new run: a stalled robot would then
    // miss the reset.
    #[test]
    fn states_of_the_run_before_a_reset_do_not_count() {
        let mut robot = Progress::default();
        robot.see(at(30), stamps(0));
        assert!(!robot.is_ready(stamps(0)) && robot.is_behind(stamps(0)));
        robot.see(at(0), stamps(0));
        assert!(robot.is_ready(stamps(0)) && !robot.is_ready(stamps(1)));
    }

    #[test]
    fn only_the_leader_owns_the_clock() {
        assert!(is_in_namespace("/chaser1/dynamics", "/chaser1"));
        assert!(is_in_namespace("/dynamics", "/"));
        for stranger in ["/dynamics", "/chaser11/dynamics", "/chaser1/fleet/dynamics"] {
            assert!(!is_in_namespace(stranger, "/chaser1"), "{stranger}");
        }
    }
}
