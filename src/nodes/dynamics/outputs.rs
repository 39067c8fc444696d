//! What the dynamics node publishes.

use super::{
    imu::imu,
    messages::{FrameTree, joint_states, momentum, odometry},
    world::{Target, World},
};
use crate::{
    msg::{fuyu_msgs, nav_msgs, rosgraph_msgs, sensor_msgs, std_msgs, tf2_msgs},
    nodes::topics,
    ros::{self, Node, NodeError, Publisher, Time},
};

/// Publishers of the dynamics node.
pub struct Outputs {
    /// The node's own clock: it does not hear its own `/clock`.
    time: ros::Clock,
    frames: FrameTree,
    clock: Publisher<rosgraph_msgs::Clock>,
    joint_states: Publisher<sensor_msgs::JointState>,
    odometry: Publisher<nav_msgs::Odometry>,
    /// One for each target, in their order.
    targets: Vec<(String, Publisher<nav_msgs::Odometry>)>,
    momentum: Publisher<fuyu_msgs::Momentum>,
    imu: Publisher<sensor_msgs::Imu>,
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
        let latched_description = topics::ROBOT_DESCRIPTION.advertise(node)?;
        latched_description.publish(&std_msgs::String {
            data: description.to_owned(),
        });
        let tf_static = topics::TF_STATIC.advertise(node)?;
        tf_static.publish(&frames.static_transforms());
        Ok(Self {
            time: node.clock().clone(),
            frames,
            clock: topics::CLOCK.advertise(node)?,
            joint_states: topics::JOINT_STATES.advertise(node)?,
            odometry: topics::ODOMETRY.advertise(node)?,
            targets: (world.targets.iter())
                .map(|target| target_topic(node, target))
                .collect::<Result<_, _>>()?,
            momentum: topics::MOMENTUM.advertise(node)?,
            imu: topics::IMU.advertise(node)?,
            tf: topics::TF.advertise(node)?,
            _latched: (latched_description, tf_static),
        })
    }

    /// No topics for targets that are not there any more.
    pub fn forget_targets(&mut self, world: &World) {
        self.targets
            .retain(|(name, _)| world.targets.iter().any(|t| t.name == *name));
    }

    /// A topic for each target, those that are there already and new ones.
    ///
    /// # Errors
    /// When the node cannot publish.
    pub fn follow_targets(&mut self, node: &Node, world: &World) -> Result<(), NodeError> {
        let mut before = std::mem::take(&mut self.targets);
        for target in &world.targets {
            let there = before.iter().position(|(name, _)| *name == target.name);
            self.targets.push(match there {
                Some(i) => before.swap_remove(i),
                None => target_topic(node, target)?,
            });
        }
        Ok(())
    }

    /// Publishes the world as it is. A state that is not finite is not published: it is an error.
    ///
    /// # Errors
    /// Says when the numbers were lost and what helps.
    pub fn publish(&self, world: &mut World) -> Result<(), NodeError> {
        world.check_finite().map_err(NodeError::Failed)?;
        let stamp = Time::from_secs_f64(world.time());
        self.time.drive(stamp);
        self.clock.publish(&rosgraph_msgs::Clock {
            clock: stamp.into(),
        });
        self.joint_states
            .publish(&joint_states(stamp, self.frames.base(), world));
        self.odometry
            .publish(&odometry(stamp, self.frames.base(), &world.robot));
        for ((_, publisher), target) in self.targets.iter().zip(&world.targets) {
            publisher.publish(&odometry(stamp, &target.name, &target.body));
        }
        self.momentum.publish(&momentum(stamp, &world.robot));
        self.imu.publish(&imu(stamp, self.frames.base(), world));
        self.tf.publish(&self.frames.transforms(stamp, world));
        Ok(())
    }
}

fn target_topic(
    node: &Node,
    target: &Target,
) -> Result<(String, Publisher<nav_msgs::Odometry>), NodeError> {
    let publisher = node.advertise(&target.odometry_topic(), topics::ODOMETRY.qos)?;
    Ok((target.name.clone(), publisher))
}
