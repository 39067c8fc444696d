//! States of the robots and targets of a recorded run at given times.

use std::collections::BTreeMap;

use super::PictureError;
use crate::bag::{Bag, Message};
use crate::experiments::recorded_names::is_of_target;
use crate::experiments::recorded_runs::RunCounter;
use crate::msg::{nav_msgs::Odometry, sensor_msgs::JointState, std_msgs};

/// Type of the messages that contain poses.
const ODOMETRY: &str = "nav_msgs/msg/Odometry";

/// A message on a body, classified by type and topic.
enum BodyMessage {
    Description(String),
    Joints(JointState),
    Odometry(Box<Odometry>),
}

impl BodyMessage {
    /// The namespace of the body that a message describes (a robot, or `ground_truth/NAME` for a target), and the
    /// message.
    fn of(message: &Message) -> Option<(String, Self)> {
        let topic = &message.topic;
        let below = |suffix: &str| topic.name.strip_suffix(suffix).map(str::to_owned);
        match topic.type_name.as_str() {
            "std_msgs/msg/String" => {
                let namespace = below("/robot_description")?;
                let text: std_msgs::String = message.decode().ok()?;
                Some((namespace, Self::Description(text.data)))
            }
            "sensor_msgs/msg/JointState" => {
                let namespace = below("/joint_states")?;
                Some((namespace, Self::Joints(message.decode().ok()?)))
            }
            ODOMETRY => {
                let of_robot = below("/ground_truth/odom");
                let of_target = || below("/odom").filter(|namespace| is_of_target(namespace));
                let namespace = of_robot.or_else(of_target)?;
                let odometry = message.decode().ok()?;
                Some((namespace, Self::Odometry(Box::new(odometry))))
            }
            _ => None,
        }
    }
}

/// The first and last stamp \[ns\] of poses in a run.
pub fn time_range(bag: &Bag, run: usize) -> Result<(i64, i64), PictureError> {
    let mut counter = RunCounter::default();
    let mut range: Option<(i64, i64)> = None;
    let mut runs = 0;
    bag.messages().for_each(|message| {
        let of = counter.run_of(&message) + 1;
        if message.topic.type_name == ODOMETRY
            && let Some((_, BodyMessage::Odometry(odometry))) = BodyMessage::of(&message)
        {
            runs = runs.max(of);
            if of == run {
                let stamp = odometry.header.stamp.nanos();
                let (first, last) = range.unwrap_or((stamp, stamp));
                range = Some((first.min(stamp), last.max(stamp)));
            }
        }
    });
    range.ok_or_else(|| {
        PictureError::Input(match runs {
            0 => "nothing to draw: no ground_truth/odom, which has the poses of robots and targets"
                .to_owned(),
            runs => format!("--run {run}: the bag has the runs 1 to {runs}"),
        })
    })
}

/// The messages of a topic valid at the pictures' times: for each time the latest message up to then, or else the first
/// one.
pub struct Samples<M> {
    at_times: Vec<M>,
    latest: Option<M>,
}

impl<M: Clone> Samples<M> {
    fn new() -> Self {
        Self {
            at_times: Vec::new(),
            latest: None,
        }
    }

    /// Takes the next message. `stamps` \[ns\] are the ascending times of the pictures.
    fn push(&mut self, stamps: &[i64], stamp: i64, message: M) {
        let before = self.latest.as_ref().unwrap_or(&message);
        // Times of pictures are rounded to milliseconds.
        let passed = stamps[self.at_times.len()..]
            .iter()
            .take_while(|at| **at + 500_000 < stamp);
        let passed = passed.map(|_| before.clone()).collect::<Vec<_>>();
        self.at_times.extend(passed);
        self.latest = Some(message);
    }

    /// One message for each of `count` pictures; none without messages.
    pub fn finish(mut self, count: usize) -> Vec<M> {
        if let Some(latest) = self.latest {
            self.at_times.resize(count, latest);
        }
        self.at_times
    }
}

/// The recorded data of a body.
pub struct RecordedBody {
    pub description: Option<String>,
    pub joints: Samples<JointState>,
    pub odometry: Samples<Odometry>,
}

/// The bodies by namespace, with their states at `stamps` \[ns\].
pub fn recorded_bodies(bag: &Bag, run: usize, stamps: &[i64]) -> BTreeMap<String, RecordedBody> {
    let mut counter = RunCounter::default();
    let mut bodies: BTreeMap<String, RecordedBody> = BTreeMap::new();
    bag.messages().for_each(|message| {
        let of = counter.run_of(&message) + 1;
        let Some((namespace, message)) = BodyMessage::of(&message) else {
            return;
        };
        let body = bodies.entry(namespace).or_insert_with(|| RecordedBody {
            description: None,
            joints: Samples::new(),
            odometry: Samples::new(),
        });
        match message {
            // Latched messages are not repeated after a reset.
            BodyMessage::Description(text) if of <= run => body.description = Some(text),
            BodyMessage::Joints(joints) if of == run => {
                (body.joints).push(stamps, joints.header.stamp.nanos(), joints);
            }
            BodyMessage::Odometry(odometry) if of == run => {
                (body.odometry).push(stamps, odometry.header.stamp.nanos(), *odometry);
            }
            _ => {}
        }
    });
    bodies.retain(|_, body| body.description.is_some() || body.odometry.latest.is_some());
    bodies
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if a picture shows a state after its time.
    #[test]
    fn a_picture_shows_the_latest_state_up_to_its_time() {
        const MS: i64 = 1_000_000;
        let stamps = [0, 20 * MS, 25 * MS, 30 * MS, 90 * MS];
        let mut samples = Samples::new();
        for k in 1..=4 {
            samples.push(&stamps, 10 * MS * k, k);
        }
        assert_eq!(samples.finish(stamps.len()), [1, 2, 2, 3, 4]);
        assert!(Samples::<i64>::new().finish(3).is_empty());
    }
}
