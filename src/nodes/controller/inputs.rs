//! Subscriptions of the controller node, which feed its control loop.

use std::time::Duration;

use super::super::{
    geometry::{pose_from_msg, vector_from_msg, with_matrix},
    joint_vectors, topics,
};
use crate::{
    control::{ControlLoop, InputError, Stamp},
    msg::{
        builtin_interfaces,
        geometry_msgs::{PoseStamped, Vector3Stamped},
        sensor_msgs::{Imu, JointState},
        std_msgs::Float64,
    },
    ros::{Node, NodeError, Status, Subscription, Time},
    spatial::Pose,
};

pub(super) struct Inputs {
    joint_states: Subscription<JointState>,
    /// Camera measurements of each tip.
    tips: Vec<TipTopics>,
    imu: Subscription<Imu>,
    target_rate: Subscription<Vector3Stamped>,
    /// `None` if delays are not compensated.
    command_delay: Option<Subscription<Float64>>,
}

/// Pose of a tip and pose of its goal, in the base frame.
struct TipTopics {
    tip: Subscription<PoseStamped>,
    goal: Subscription<PoseStamped>,
}

impl Inputs {
    pub(super) fn new(
        node: &Node,
        two_arms: bool,
        compensates_delay: bool,
    ) -> Result<Self, NodeError> {
        let mut tips = vec![TipTopics {
            tip: topics::TIP_POSE.subscribe(node)?,
            goal: topics::MEASURED_GOAL.subscribe(node)?,
        }];
        if two_arms {
            tips.push(TipTopics {
                tip: topics::SECOND_TIP_POSE.subscribe(node)?,
                goal: topics::SECOND_MEASURED_GOAL.subscribe(node)?,
            });
        }
        Ok(Self {
            joint_states: topics::JOINT_STATES.subscribe(node)?,
            tips,
            imu: topics::IMU.subscribe(node)?,
            target_rate: topics::TARGET_RATE.subscribe(node)?,
            command_delay: match compensates_delay {
                true => Some(topics::COMMAND_DELAY.subscribe(node)?),
                false => None,
            },
        })
    }

    /// Passes received messages to the control loop. Joint states come first: they start a new run when time jumps
    /// back, and limit how far in the future other stamps may be. Inputs that the loop refuses are reported in
    /// `status`.
    pub(super) fn feed(&self, control_loop: &mut ControlLoop, status: &Status) {
        while let Some(received) = self.joint_states.take() {
            let message = received.message;
            let model = control_loop.controller().model();
            let vectors = joint_vectors::positions(model, &message)
                .and_then(|q| Ok((q, joint_vectors::velocities(model, &message)?)));
            let added = vectors.and_then(|(q, qd)| {
                let stamp = stamp(&message.header.stamp);
                let added = control_loop.add_joint_state(stamp, q.as_slice(), qd.as_slice());
                added.map_err(|e| e.to_string())
            });
            if let Err(problem) = added {
                status.warn(format!("{}: {problem}", self.joint_states.topic()));
            }
        }
        if let Some(command_delay) = &self.command_delay {
            while let Some(received) = command_delay.take() {
                let added = control_loop.add_command_delay(received.message.data);
                warn_if_refused(added, command_delay.topic(), status);
            }
        }
        for (k, topics) in self.tips.iter().enumerate() {
            each_pose(&topics.tip, status, |stamp, pose| {
                control_loop.add_tip_pose(k, stamp, pose)
            });
            each_pose(&topics.goal, status, |stamp, pose| {
                control_loop.add_goal_pose(k, stamp, pose)
            });
        }
        while let Some(received) = self.imu.take() {
            let stamp = stamp(&received.message.header.stamp);
            let w_WB_B = vector_from_msg(&received.message.angular_velocity);
            warn_if_refused(
                control_loop.add_gyro(stamp, w_WB_B),
                self.imu.topic(),
                status,
            );
        }
        while let Some(received) = self.target_rate.take() {
            let header = &received.message.header;
            // The rate is given in camera axes, whose attitude in the base is known only for a camera on the base.
            let model = control_loop.controller().model();
            let camera = model.frame(&header.frame_id).filter(|f| f.body == 0);
            if let Some(R_BC) = camera.map(|camera| camera.X_BF.rotation) {
                let w_WD_B = R_BC * vector_from_msg(&received.message.vector);
                let added = control_loop.add_goal_rate(stamp(&header.stamp), w_WD_B);
                warn_if_refused(added, self.target_rate.topic(), status);
            }
        }
    }

    /// Topic of the delays; empty if they are not compensated.
    pub(super) fn delay_topic(&self) -> &str {
        self.command_delay.as_ref().map_or("", |s| s.topic())
    }

    /// Time since the last joint state and the name of its topic, if the time is longer than `limit`.
    pub(super) fn silence(&self, limit: Duration) -> Option<(Duration, &str)> {
        let age = self.joint_states.age().filter(|age| *age > limit)?;
        Some((age, self.joint_states.topic()))
    }
}

fn stamp(stamp: &builtin_interfaces::Time) -> Stamp {
    Stamp::from_nanos(Time::from(stamp).as_nanos())
}

fn warn_if_refused(added: Result<(), InputError>, topic: &str, status: &Status) {
    if let Err(problem) = added {
        status.warn(format!("{topic}: {problem}; it is ignored"));
    }
}

/// Calls `add` for every valid pose received; invalid ones are reported.
fn each_pose(
    topic: &Subscription<PoseStamped>,
    status: &Status,
    mut add: impl FnMut(Stamp, Pose) -> Result<(), InputError>,
) {
    while let Some(received) = topic.take() {
        let message = received.message;
        match pose_from_msg(&message.pose) {
            Ok(pose) => {
                let added = add(stamp(&message.header.stamp), with_matrix(&pose));
                warn_if_refused(added, topic.topic(), status);
            }
            Err(problem) => status.warn(format!("{}: {problem}; it is ignored", topic.topic())),
        }
    }
}
