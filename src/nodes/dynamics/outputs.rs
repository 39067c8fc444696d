//! What the dynamics node publishes.

use super::{
    imu::imu,
    messages::{FrameTree, joint_states, momentum, odometry},
    target::Target,
    world::World,
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
    targets: Vec<TargetOutputs>,
    momentum: Publisher<fuyu_msgs::Momentum>,
    imu: Publisher<sensor_msgs::Imu>,
    tf: Publisher<tf2_msgs::TFMessage>,
    tf_static: Publisher<tf2_msgs::TFMessage>,
    /// Kept so that late joiners find the last message.
    _description: Publisher<std_msgs::String>,
}

/// Publishers of one target.
struct TargetOutputs {
    name: String,
    odometry: Publisher<nav_msgs::Odometry>,
    description: Publisher<std_msgs::String>,
    described: String,
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
        tf_static.publish(&frames.static_transforms(&world.targets));
        Ok(Self {
            time: node.clock().clone(),
            frames,
            clock: topics::CLOCK.advertise(node)?,
            joint_states: topics::JOINT_STATES.advertise(node)?,
            odometry: topics::ODOMETRY.advertise(node)?,
            targets: (world.targets.iter())
                .map(|target| TargetOutputs::new(node, target))
                .collect::<Result<_, _>>()?,
            momentum: topics::MOMENTUM.advertise(node)?,
            imu: topics::IMU.advertise(node)?,
            tf: topics::TF.advertise(node)?,
            tf_static,
            _description: latched_description,
        })
    }

    /// No topics for targets that are not there any more.
    pub fn forget_targets(&mut self, world: &World) {
        self.targets
            .retain(|outputs| world.targets.iter().any(|t| t.name == outputs.name));
        self.publish_fixed_frames(world);
    }

    /// Topics for each target, those that are there already and new ones.
    ///
    /// # Errors
    /// When the node cannot publish.
    pub fn follow_targets(&mut self, node: &Node, world: &World) -> Result<(), NodeError> {
        let mut before = std::mem::take(&mut self.targets);
        for target in &world.targets {
            let there = before
                .iter()
                .position(|outputs| outputs.name == target.name);
            self.targets.push(match there {
                Some(i) => {
                    let mut outputs = before.swap_remove(i);
                    outputs.describe(target);
                    outputs
                }
                None => TargetOutputs::new(node, target)?,
            });
        }
        self.publish_fixed_frames(world);
        Ok(())
    }

    fn publish_fixed_frames(&self, world: &World) {
        self.tf_static
            .publish(&self.frames.static_transforms(&world.targets));
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
        for (outputs, target) in self.targets.iter().zip(&world.targets) {
            (outputs.odometry).publish(&odometry(stamp, &target.name, &target.body));
        }
        self.momentum.publish(&momentum(stamp, &world.robot));
        self.imu.publish(&imu(stamp, self.frames.base(), world));
        self.tf.publish(&self.frames.transforms(stamp, world));
        Ok(())
    }
}

impl TargetOutputs {
    fn new(node: &Node, target: &Target) -> Result<Self, NodeError> {
        let mut outputs = Self {
            name: target.name.clone(),
            odometry: node.advertise(&target.odometry_topic(), topics::ODOMETRY.qos)?,
            description: node
                .advertise(&target.description_topic(), topics::ROBOT_DESCRIPTION.qos)?,
            described: String::new(),
        };
        outputs.describe(target);
        Ok(outputs)
    }

    /// Tells what the target looks like, if that is new.
    fn describe(&mut self, target: &Target) {
        if self.described != target.description {
            self.described.clone_from(&target.description);
            self.description.publish(&std_msgs::String {
                data: target.description.clone(),
            });
        }
    }
}
