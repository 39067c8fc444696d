//! Subscriptions of the attitude node, which feed its loop.

use std::time::Duration;

use super::{AttitudeLoop, health::Refusals};
use crate::{
    control::{Stamp, attitude::StarTrackerUse},
    msg::{
        builtin_interfaces,
        geometry_msgs::QuaternionStamped,
        sensor_msgs::{Imu, JointState},
    },
    nodes::{
        geometry::{unit_quaternion, vector_from_msg},
        joint_vectors, topics,
    },
    ros::{Node, NodeError, Subscription, Time},
};

pub(super) struct Inputs {
    joint_states: Subscription<JointState>,
    wheel_states: Subscription<JointState>,
    imu: Subscription<Imu>,
    star_tracker: Subscription<QuaternionStamped>,
    target: Subscription<QuaternionStamped>,
    newest: Newest,
}

/// Newest stamps of the messages that make up a state.
#[derive(Debug, Default)]
struct Newest {
    joints: Option<Stamp>,
    wheels: Option<Stamp>,
    gyro: Option<Stamp>,
    /// Stamp of the first joint state.
    first: Option<Stamp>,
}

impl Newest {
    /// The stamp of the state to answer, see [`Inputs::state`].
    fn state(&self, timeout: Option<f64>) -> Option<Stamp> {
        let Self { joints, wheels, .. } = self;
        let Some(timeout) = timeout else {
            return self
                .gyro
                .filter(|gyro| *joints == Some(*gyro) && *wheels == Some(*gyro));
        };
        let others = (*joints).max(*wheels);
        let is_lost = |now: Stamp| {
            let last = self.gyro.or(self.first);
            last.is_some_and(|last| now.seconds_since(last).abs() > timeout)
        };
        others.filter(|now| is_lost(*now)).or(self.gyro)
    }
}

impl Inputs {
    pub(super) fn new(node: &Node) -> Result<Self, NodeError> {
        Ok(Self {
            joint_states: topics::JOINT_STATES.subscribe(node)?,
            wheel_states: topics::WHEEL_STATES.subscribe(node)?,
            imu: topics::IMU.subscribe(node)?,
            star_tracker: topics::STAR_TRACKER.subscribe(node)?,
            target: topics::ATTITUDE_TARGET.subscribe(node)?,
            newest: Newest::default(),
        })
    }

    /// Passes received messages to the loop. Refused messages are recorded in `refusals`.
    pub(super) fn feed(&mut self, attitude: &mut AttitudeLoop, refusals: &mut Refusals) {
        let Self { newest, .. } = self;
        each(&self.joint_states, refusals, |message| {
            let model = attitude.system().model();
            let q = joint_vectors::positions(model, message)?;
            let qd = joint_vectors::velocities(model, message)?;
            let stamp = stamp(&message.header.stamp);
            attitude.add_joint_state(stamp, q.as_slice(), qd.as_slice())?;
            newest.joints = Some(stamp);
            newest.first.get_or_insert(stamp);
            Ok(())
        });
        each(&self.imu, refusals, |message| {
            let stamp = stamp(&message.header.stamp);
            let added = attitude.add_gyro(stamp, vector_from_msg(&message.angular_velocity));
            added.map_err(|e| e.to_string())?;
            newest.gyro = Some(stamp);
            Ok(())
        });
        each(&self.star_tracker, refusals, |message| {
            let q = &message.quaternion;
            let R_WB = unit_quaternion(q.x, q.y, q.z, q.w)?;
            let added = attitude.add_star_tracker(stamp(&message.header.stamp), &R_WB);
            match added.map_err(|e| e.to_string())? {
                Some(StarTrackerUse::TooNew) => {
                    Err("the stamp is far ahead of that of the last imu message".into())
                }
                _ => Ok(()),
            }
        });
        each(&self.wheel_states, refusals, |message| {
            let wheels = attitude.system().wheels().iter();
            let names = wheels.map(|wheel| wheel.name.as_str());
            let speeds = joint_vectors::wheel_speeds(names, message)?;
            let stamp = stamp(&message.header.stamp);
            let added = attitude.add_wheel_speeds(stamp, &speeds);
            added.map_err(|e| e.to_string())?;
            newest.wheels = Some(stamp);
            Ok(())
        });
        each(&self.target, refusals, |message| {
            let q = &message.quaternion;
            let R_WD = unit_quaternion(q.x, q.y, q.z, q.w)?;
            let set = attitude.set_target(stamp(&message.header.stamp), R_WD);
            set.map_err(|e| e.to_string())
        });
    }

    /// Stamp of the state to answer: that of the newest gyro sample; if joints and wheels are more than `timeout` \[s\]
    /// ahead, the newest stamp of these. Without a timeout (in lockstep), the stamp that gyro, joints and wheels have
    /// in common.
    pub(super) fn state(&self, timeout: Option<f64>) -> Option<Stamp> {
        self.newest.state(timeout)
    }

    /// Time since the newest gyro sample or joint state, if longer than `limit`, and the names of their topics.
    pub(super) fn silence(&self, limit: Duration) -> Option<(Duration, [&str; 2])> {
        let ages = [self.imu.age(), self.joint_states.age()];
        let age = ages.into_iter().flatten().min()?;
        let topics = [self.imu.topic(), self.joint_states.topic()];
        (age > limit).then_some((age, topics))
    }
}

fn stamp(stamp: &builtin_interfaces::Time) -> Stamp {
    Stamp::from_nanos(Time::from(stamp).as_nanos())
}

/// Calls `add` for every message received, and records the messages that it refuses.
fn each<M: crate::msg::Interface>(
    topic: &Subscription<M>,
    refusals: &mut Refusals,
    mut add: impl FnMut(&M) -> Result<(), String>,
) {
    while let Some(received) = topic.take() {
        if let Err(problem) = add(&received.message) {
            refusals.note(format!("{}: {problem}; it is ignored", topic.topic()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Would break if a lost gyro left the last torques in force, or if a state were answered before its gyro sample.
    #[test]
    fn without_a_gyro_the_other_inputs_tell_the_time() {
        let at = |t: f64| Some(Stamp::from_secs_f64(t));
        let mut newest = Newest {
            joints: at(0.0),
            first: at(0.0),
            ..Newest::default()
        };
        assert_eq!(newest.state(Some(0.5)), None);
        newest.wheels = at(0.4);
        assert_eq!(newest.state(Some(0.5)), None);
        newest.wheels = at(0.6);
        assert_eq!(newest.state(Some(0.5)), at(0.6));
        newest.gyro = at(0.5);
        assert_eq!(newest.state(Some(0.5)), at(0.5));
        newest.joints = at(1.1);
        assert_eq!(newest.state(Some(0.5)), at(1.1));
        assert_eq!(newest.state(None), None);
        let all = Newest {
            joints: at(2.0),
            wheels: at(2.0),
            gyro: at(2.0),
            first: at(0.0),
        };
        assert_eq!(all.state(None), at(2.0));
    }
}
