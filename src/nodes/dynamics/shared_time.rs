//! One time for several robots, each simulated by a dynamics node of its own.
//!
//! The node of the robot that the parameter `robots` names first publishes `/clock`; the others simulate up to the time
//! that it shows. The first one waits, before it goes on, until the others have published the state of that time: in
//! lockstep always, otherwise for `answer_timeout`, and not for those that have been silent for so long.

use std::time::Duration;

use super::params::DynamicsParams;
use crate::{
    msg::{nav_msgs::Odometry, rosgraph_msgs::Clock},
    nodes::topics,
    ros::{Node, NodeError, Qos, Subscription, Time},
};

/// What a node has to do with the time of the world.
pub enum SharedTime {
    /// There is no other robot.
    Alone,
    /// It owns the time.
    Leader {
        /// The other robots.
        followers: Vec<Follower>,
        /// Silence of a robot after which it is not waited for in real time.
        patience: Duration,
        /// Stamp of the last state.
        tick: Time,
    },
    /// The time is that of `/clock`.
    Follower {
        /// `/clock`.
        clock: Subscription<Clock>,
        /// The time that it shows.
        now: Option<Time>,
        /// Namespace of the robot whose node publishes it.
        leader: String,
    },
}

/// Another robot, whose node follows `/clock`.
pub struct Follower {
    odometry: Subscription<Odometry>,
    /// Stamp of its last state.
    last: Option<Time>,
}

impl Follower {
    /// Whether its state of this time has not arrived.
    fn is_behind(&self, tick: Time) -> bool {
        self.last != Some(tick)
    }

    /// Whether it was silent for less than `patience`.
    fn is_alive(&self, patience: Duration) -> bool {
        self.odometry.age().is_some_and(|age| age < patience)
    }
}

impl SharedTime {
    /// What `node` has to do.
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
            return Ok(Self::Follower {
                clock: node.subscribe(topics::CLOCK.name, Qos::CLOCK_SUBSCRIPTION)?,
                now: None,
                leader: leader.clone(),
            });
        }
        let followers = params.robots.iter().skip(1).map(|namespace| {
            let base = format!("{}/{}", namespace.trim_end_matches('/'), topics::BASE);
            let topic = topics::TARGET_ODOMETRY.of(&base);
            Ok(Follower {
                odometry: node.subscribe(&topic, topics::ODOMETRY.qos)?,
                last: None,
            })
        });
        Ok(Self::Leader {
            followers: followers.collect::<Result<_, NodeError>>()?,
            patience: Duration::from_secs_f64(params.answer_timeout),
            tick: Time::ZERO,
        })
    }

    /// Takes what has arrived.
    pub fn take(&mut self) {
        match self {
            Self::Alone => {}
            Self::Leader { followers, .. } => {
                for follower in followers {
                    if let Some(received) = follower.odometry.latest() {
                        follower.last = Some(Time::from(&received.message.header.stamp));
                    }
                }
            }
            Self::Follower { clock, now, .. } => {
                if let Some(received) = clock.latest() {
                    *now = Some(Time::from(received.message.clock));
                }
            }
        }
    }

    /// The state of `time` \[s\] is published.
    pub fn published(&mut self, time: f64) {
        if let Self::Leader { tick, .. } = self {
            *tick = Time::from_secs_f64(time);
        }
    }

    /// Time or state is reset: what other robots have published belongs to the previous run.
    pub fn restart(&mut self) {
        if let Self::Leader {
            followers, tick, ..
        } = self
        {
            *tick = Time::ZERO;
            for follower in followers {
                follower.last = None;
            }
        }
    }

    /// Whether the node follows `/clock`.
    pub fn is_follower(&self) -> bool {
        matches!(self, Self::Follower { .. })
    }

    /// Why the node cannot decide about time, if another one does.
    pub fn owner(&self) -> Option<String> {
        match self {
            Self::Follower { leader, .. } => Some(format!(
                "time belongs to the dynamics node of the robot {leader}, which `robots` names first; ask that one"
            )),
            _ => None,
        }
    }

    /// Whether `/clock` shows a time before the state of `time` \[s\]: its owner was reset.
    pub fn went_back(&self, time: f64) -> bool {
        match self {
            Self::Follower { now, .. } => now.is_some_and(|now| now < Time::from_secs_f64(time)),
            _ => false,
        }
    }

    /// Whether the next state, at `time` \[s\], may be simulated, as far as the other robots are concerned.
    pub fn may_reach(&self, time: f64) -> bool {
        match self {
            Self::Alone => true,
            Self::Leader {
                followers, tick, ..
            } => !followers.iter().any(|f| f.is_behind(*tick)),
            Self::Follower { now, .. } => now.is_some_and(|now| now >= Time::from_secs_f64(time)),
        }
    }

    /// Whether a robot that is alive has not published its state of the last tick yet.
    pub fn is_due(&self) -> bool {
        match self {
            Self::Leader {
                followers,
                patience,
                tick,
            } => followers
                .iter()
                .any(|f| f.is_alive(*patience) && f.is_behind(*tick)),
            _ => false,
        }
    }

    /// Whether every robot has been seen since the start.
    pub fn is_complete(&self) -> bool {
        match self {
            Self::Leader { followers, .. } => followers.iter().all(|f| f.last.is_some()),
            _ => true,
        }
    }

    /// What time waits for.
    pub fn waits_for(&self) -> String {
        match self {
            Self::Alone => String::new(),
            Self::Leader {
                followers, tick, ..
            } => {
                let behind = followers.iter().filter(|f| f.is_behind(*tick));
                let behind: Vec<_> = behind.map(|f| f.odometry.topic()).collect();
                format!("the state of {tick} s on {}", behind.join(", "))
            }
            Self::Follower { leader, .. } => {
                format!("/clock, from the dynamics node of the robot {leader}")
            }
        }
    }
}
