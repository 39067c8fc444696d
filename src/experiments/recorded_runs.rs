//! Runs within a recording: time restarts after a reset of the simulation, or when a bag is played again.

use std::collections::BTreeMap;

use super::recorded_names::is_of_target;
use crate::bag::Message;
use crate::msg::{self, scan::scan};

/// Topics of the node that owns the time. Messages of each topic are in order.
const TIMED: [&str; 3] = [
    "/joint_states",
    "/ground_truth/odom",
    "/ground_truth/momentum",
];

/// Time has restarted if a state is earlier than the previous one by more than this \[ns\]; if by less, only if it is
/// the earliest of the run, otherwise it is merely out of order.
const RESTART: i64 = 1_000_000_000;

/// A message of another topic whose stamp is later than the run by more than this was left over from the previous run
/// \[ns\].
const LEFT_OVER: i64 = 1_000_000_000;

/// Determines the run of each message by the stamps of each robot's states.
#[derive(Debug, Default)]
pub struct RunCounter {
    /// Current runs by namespace.
    robots: BTreeMap<String, Run>,
}

#[derive(Debug, Default)]
struct Run {
    index: usize,
    /// The earliest stamp of a state in this run \[ns\].
    first: Option<i64>,
    /// The latest stamp of a state in this run \[ns\].
    latest: i64,
    /// The last stamp of each topic of states in this run \[ns\].
    last: BTreeMap<&'static str, i64>,
}

impl RunCounter {
    /// The run of a message: 0, plus one for every restart of its robot's time. Messages must be given in their
    /// recorded order.
    pub fn run_of(&mut self, message: &Message) -> usize {
        let name = message.topic.name.as_str();
        let timed = TIMED
            .into_iter()
            .find_map(|topic| Some((topic, name.strip_suffix(topic)?)));
        // `/camera/joint_states` belongs to a robot. A target's topics belong to the run of the robot in whose world it
        // is.
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

    /// Number of restarts of the time of the robot to which `topic` belongs.
    pub fn index(&self, topic: &str) -> usize {
        self.robot(topic).map_or(0, |run| run.index)
    }

    /// Total number of restarts of the time of any robot.
    pub fn restarts(&self) -> usize {
        self.robots.values().map(|run| run.index).sum()
    }

    /// The robot of the innermost namespace of a topic; the first robot for topics above all robots, such as `/tf`.
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
            // The last states of the previous run, on a topic that was recorded later.
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
        // The base's state of the first run is recorded after the joints' state of the second run.
        assert_eq!(take(0, 0), 1);
        assert_eq!(take(1, 100), 0);
        assert_eq!((take(1, 0), take(0, 1), take(1, 1)), (1, 1, 1));
        // A state that was published twice is not a restart.
        assert_eq!((take(0, 1), take(0, 50)), (1, 1));
        // Neither is a state that is out of order.
        assert_eq!((take(0, 45), take(0, 51)), (1, 1));
        assert_eq!(take(0, 2), 2);
    }
}
