//! What the dynamics node publishes.

use super::{
    messages::{FrameTree, joint_states, momentum, odometry},
    world::World,
};
use crate::{
    msg::{fuyu_msgs, nav_msgs, rosgraph_msgs, sensor_msgs, std_msgs, tf2_msgs},
    ros::{Node, NodeError, Publisher, Qos, Time},
};

/// Publishers of the dynamics node.
pub struct Outputs {
    frames: FrameTree,
    clock: Publisher<rosgraph_msgs::Clock>,
    joint_states: Publisher<sensor_msgs::JointState>,
    odometry: Publisher<nav_msgs::Odometry>,
    targets: Vec<Publisher<nav_msgs::Odometry>>,
    momentum: Publisher<fuyu_msgs::Momentum>,
    tf: Publisher<tf2_msgs::TFMessage>,
    /// Kept so that late joiners find the last message.
    _latched: (Publisher<std_msgs::String>, Publisher<tf2_msgs::TFMessage>),
}

impl Outputs {
    /// Advertises everything, and publishes what never changes.
    ///
    /// # Errors
    /// When the node cannot publish.
    pub fn new(node: &Node, world: &World, description: &str) -> Result<Self, NodeError> {
        let frames = FrameTree::new(world.robot.model());
        let latched_description = node.advertise("robot_description", Qos::LATCHED)?;
        latched_description.publish(&std_msgs::String {
            data: description.to_owned(),
        });
        let tf_static = node.advertise("/tf_static", Qos::TF_STATIC)?;
        tf_static.publish(&frames.static_transforms());
        let truth = |name: &str| node.advertise(name, Qos::RELIABLE);
        Ok(Self {
            frames,
            clock: node.advertise("/clock", Qos::CLOCK)?,
            joint_states: node.advertise("joint_states", Qos::RELIABLE)?,
            odometry: truth("ground_truth/odom")?,
            targets: (world.targets.iter())
                .map(|t| truth(&t.odometry_topic()))
                .collect::<Result<_, _>>()?,
            momentum: node.advertise("ground_truth/momentum", Qos::RELIABLE)?,
            tf: node.advertise("/tf", Qos::TF)?,
            _latched: (latched_description, tf_static),
        })
    }

    /// Publishes the world as it is. A state that is not finite is not published: it is an error.
    ///
    /// # Errors
    /// Says when the numbers were lost and what helps.
    pub fn publish(&self, world: &World) -> Result<(), NodeError> {
        world.check_finite().map_err(NodeError::Failed)?;
        let stamp = Time::from_secs_f64(world.time());
        self.clock.publish(&rosgraph_msgs::Clock {
            clock: stamp.into(),
        });
        self.joint_states
            .publish(&joint_states(stamp, self.frames.base(), world));
        self.odometry
            .publish(&odometry(stamp, self.frames.base(), &world.robot));
        for (publisher, target) in self.targets.iter().zip(&world.targets) {
            publisher.publish(&odometry(stamp, &target.name, &target.body));
        }
        self.momentum.publish(&momentum(stamp, &world.robot));
        self.tf.publish(&self.frames.transforms(stamp, world));
        Ok(())
    }
}
