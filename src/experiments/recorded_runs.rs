//! Runs within a recording: a reset of the simulation, or a bag that is played again, restarts the time.

use std::collections::BTreeMap;

use super::recorded_names::is_of_target;
use crate::bag::Message;
use crate::msg::{self, scan::scan};

/// Topics of the node that owns the time. Each is in order.
const TIMED: [&str; 3] = [
    "/joint_states",
    "/ground_truth/odom",
    "/ground_truth/momentum",
];

/// A state that is earlier than the one before by more than this restarts the time; by less only if it is the earliest of
/// the run, otherwise it is out of order \[ns\].
const RESTART: i64 = 1_000_000_000;

/// A message of another topic with a stamp later than the run by more than this was left over from the run before \[ns\].
const LEFT_OVER: i64 = 1_000_000_000;

/// Finds the run of each message, by the stamps of each robot's states.
#[derive(Debug, Default)]
pub struct RunCounter {
    /// By namespace.
    robots: BTreeMap<String, Run>,
}

#[derive(Debug, Default)]
struct Run {
    index: usize,
    /// The earliest stamp of a state in this run \[ns\].
    first: Option<i64>,
    /// The latest one \[ns\].
    latest: i64,
    /// The last stamp of each topic of states in this run \[ns\].
    last: BTreeMap<&'static str, i64>,
}

impl RunCounter {
    /// The run that a message belongs to: 0, and one more for every restart of the time of its robot. Messages must be
    /// given in their order.
    pub fn run_of(&mut self, message: &Message) -> usize {
        let name = message.topic.name.as_str();
        let timed = TIMED
            .into_iter()
            .find_map(|topic| Some((topic, name.strip_suffix(topic)?)));
        // `/camera/joint_states` is a robot's. A target's topics belong to the run of the robot in whose world it is.
        let timed = timed.filter(|(_, namespace)| !is_of_target(namespace));
        if let Some((topic, namespace)) = timed {
            let Some(stamp) = stamp(message) else {
                return self.index(name);
            };
            let run = self.robots.entry(namespace.to_owned()).or_default();
            return run.take(topic, stamp);
        }
        match self.robot(name) {
            Some(run) if run.index > 0 => match stamp(message) {
                Some(stamp) if stamp > run.latest + LEFT_OVER => run.index - 1,
                _ => run.index,
            },
            _ => 0,
        }
    }

    /// How many times the time of the robot that `topic` belongs to has restarted.
    pub fn index(&self, topic: &str) -> usize {
        self.robot(topic).map_or(0, |run| run.index)
    }

    /// How many times the time of any robot has restarted.
    pub fn restarts(&self) -> usize {
        self.robots.values().map(|run| run.index).sum()
    }

    /// The robot in the innermost namespace of a topic; for topics above all robots, such as `/tf`, the first one.
    fn robot(&self, topic: &str) -> Option<&Run> {
        let inside = |namespace: &&String| {
            topic
                .strip_prefix(namespace.as_str())
                .is_some_and(|rest| rest.starts_with('/'))
        };
        let innermost = self.robots.keys().filter(inside).max_by_key(|n| n.len());
        match innermost {
            Some(namespace) => self.robots.get(namespace),
            None => self.robots.values().next(),
        }
    }
}

impl Run {
    fn take(&mut self, topic: &'static str, stamp: i64) -> usize {
        let before = self.last.get(topic).copied();
        match before {
            Some(before) if self.is_restart(before, stamp) => {
                self.index += 1;
                self.last.clear();
                self.latest = stamp;
                self.first = None;
            }
            // The last states of the run before, on a topic that was recorded later.
            None if self.index > 0 && stamp > self.latest + LEFT_OVER => return self.index - 1,
            _ => {}
        }
        self.last.insert(topic, stamp);
        self.latest = self.latest.max(stamp);
        self.first = Some(self.first.map_or(stamp, |first| first.min(stamp)));
        self.index
    }

    fn is_restart(&self, before: i64, stamp: i64) -> bool {
        let is_earliest = self.first.is_some_and(|first| stamp <= first);
        before - stamp > RESTART || (stamp < before && is_earliest)
    }
}

/// Stamp of a message's header \[ns\].
fn stamp(message: &Message) -> Option<i64> {
    let definition = msg::find(&message.topic.type_name)?;
    let found = scan(definition, &message.data).ok()?;
    found.stamp.map(|stamp| stamp.nanos())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_run_changes_with_the_first_state_that_goes_back() {
        const SECOND: i64 = 1_000_000_000;
        let mut run = Run::default();
        let mut take = |topic: usize, tenths: i64| run.take(TIMED[topic], tenths * SECOND / 10);
        for t in 0..100 {
            assert_eq!((take(0, t), take(1, t)), (0, 0));
        }
        // The base's state of the first run is recorded after the joints' of the second.
        assert_eq!(take(0, 0), 1);
        assert_eq!(take(1, 100), 0);
        assert_eq!((take(1, 0), take(0, 1), take(1, 1)), (1, 1, 1));
        // A state that was published twice is no restart.
        assert_eq!((take(0, 1), take(0, 50)), (1, 1));
        // Neither is one that is out of order.
        assert_eq!((take(0, 45), take(0, 51)), (1, 1));
        assert_eq!(take(0, 2), 2);
    }
}
