//! The attitude node's subscriptions, which feed its loop.

use std::time::Duration;

use super::AttitudeLoop;
use crate::{
    control::Stamp,
    dynamics::flexible::FlexibleSystem,
    msg::{
        builtin_interfaces,
        geometry_msgs::QuaternionStamped,
        sensor_msgs::{Imu, JointState},
    },
    nodes::{
        geometry::{unit_quaternion, vector_from_msg},
        joint_vectors, topics,
    },
    ros::{Node, NodeError, Status, Subscription, Time},
};

pub(super) struct Inputs {
    joint_states: Subscription<JointState>,
    wheel_states: Subscription<JointState>,
    imu: Subscription<Imu>,
    star_tracker: Subscription<QuaternionStamped>,
    target: Subscription<QuaternionStamped>,
    newest: Newest,
}

/// Newest stamps of what a state consists of.
#[derive(Debug, Default)]
struct Newest {
    joints: Option<Stamp>,
    wheels: Option<Stamp>,
    gyro: Option<Stamp>,
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

    /// Passes everything that has arrived to the loop. What it refuses is reported in `status`.
    pub(super) fn feed(&mut self, attitude: &mut AttitudeLoop, status: &Status) {
        let Self { newest, .. } = self;
        each(&self.joint_states, status, |message| {
            let model = attitude.system().model();
            let q = joint_vectors::positions(model, message)?;
            let qd = joint_vectors::velocities(model, message)?;
            let stamp = stamp(&message.header.stamp);
            newest.joints = Some(stamp);
            attitude.add_joint_state(stamp, q.as_slice(), qd.as_slice())
        });
        each(&self.imu, status, |message| {
            let stamp = stamp(&message.header.stamp);
            newest.gyro = Some(stamp);
            let added = attitude.add_gyro(stamp, vector_from_msg(&message.angular_velocity));
            added.map_err(|e| e.to_string())
        });
        each(&self.star_tracker, status, |message| {
            let q = &message.quaternion;
            let R_WB = unit_quaternion(q.x, q.y, q.z, q.w)?;
            let added = attitude.add_star_tracker(stamp(&message.header.stamp), &R_WB);
            added.map(drop).map_err(|e| e.to_string())
        });
        each(&self.wheel_states, status, |message| {
            let speeds = wheel_speeds(attitude.system(), message)?;
            let stamp = stamp(&message.header.stamp);
            newest.wheels = Some(stamp);
            let added = attitude.add_wheel_speeds(stamp, &speeds);
            added.map_err(|e| e.to_string())
        });
        each(&self.target, status, |message| {
            let q = &message.quaternion;
            let R_WD = unit_quaternion(q.x, q.y, q.z, q.w)?;
            let set = attitude.set_target(stamp(&message.header.stamp), R_WD);
            set.map_err(|e| e.to_string())
        });
    }

    /// Stamp of the state to answer: that of the newest gyro sample; in lockstep only if joints and wheels have come as
    /// well.
    pub(super) fn state(&self, lockstep: bool) -> Option<Stamp> {
        let Newest {
            joints,
            wheels,
            gyro,
        } = self.newest;
        match lockstep {
            true => gyro.filter(|_| joints == gyro && wheels == gyro),
            false => gyro,
        }
    }

    /// Time since the last gyro sample, if longer than `limit`, and the topic's name.
    pub(super) fn silence(&self, limit: Duration) -> Option<(Duration, &str)> {
        let age = self.imu.age().filter(|age| *age > limit)?;
        Some((age, self.imu.topic()))
    }
}

fn stamp(stamp: &builtin_interfaces::Time) -> Stamp {
    Stamp::from_nanos(Time::from(stamp).as_nanos())
}

/// Calls `add` for every message that has arrived; what it refuses is reported.
fn each<M: crate::msg::Interface>(
    topic: &Subscription<M>,
    status: &Status,
    mut add: impl FnMut(&M) -> Result<(), String>,
) {
    while let Some(received) = topic.take() {
        if let Err(problem) = add(&received.message) {
            status.warn(format!("{}: {problem}; it is ignored", topic.topic()));
        }
    }
}

/// Speeds of the wheels in the order of the robot's parts.
fn wheel_speeds(system: &FlexibleSystem, message: &JointState) -> Result<Vec<f64>, String> {
    let speed = |name: &str| {
        let at = message.name.iter().position(|known| known == name);
        let value = at.and_then(|at| message.velocity.get(at)).copied();
        value.ok_or_else(|| format!("has no velocity for wheel '{name}'"))
    };
    system
        .wheels()
        .iter()
        .map(|wheel| speed(&wheel.name))
        .collect()
}
