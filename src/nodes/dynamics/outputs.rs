//! Publishers of the dynamics node.

use super::{
    contact_messages::contacts,
    imu::{imu_message, update_imu},
    messages::{
        FrameTree, external_impulse_message, joint_states, momentum_message, odometry_message,
        target_joint_states, update_external_impulse, update_joint_states, update_momentum,
        update_odometry, update_target_joint_states,
    },
    params::DynamicsParams,
    part_messages::{
        appendage_outlines, appendage_states, update_appendage_states, update_wheel_states,
        wheel_states,
    },
    star_tracker::star_tracker_message,
    target::Target,
    world::World,
    wrist::{blank_wrist_message, update_wrist_message},
};
use crate::{
    msg::{
        Interface, fuyu_msgs, geometry_msgs, nav_msgs, ros_gz_interfaces, rosgraph_msgs,
        sensor_msgs, std_msgs, tf2_msgs,
    },
    nodes::topics,
    ros::{self, Node, NodeError, Publisher, Time},
};

/// Publishes the world. Messages are kept and updated in place, since the names in them do not change.
pub struct Outputs {
    /// The node's clock, which is set here: the node does not subscribe to its own `/clock`.
    time: ros::Clock,
    frames: FrameTree,
    /// `None` if another node owns the time.
    clock: Option<Publisher<rosgraph_msgs::Clock>>,
    joint_states: Output<sensor_msgs::JointState>,
    odometry: Output<nav_msgs::Odometry>,
    /// Publishers of the targets, in the order of the world's targets.
    targets: Vec<TargetOutputs>,
    momentum: Output<fuyu_msgs::Momentum>,
    /// `None` for a robot without deformable bodies and elastic joints.
    appendages: Option<Output<fuyu_msgs::AppendageStates>>,
    /// Kept so that late joiners receive the last message; `None` for a robot without appendages.
    _appendage_outlines: Option<Publisher<fuyu_msgs::AppendageOutlines>>,
    /// `None` for a robot without wheels.
    wheels: Option<Output<sensor_msgs::JointState>>,
    /// `None` if no external wrench, thruster or contact can act on the robot.
    external_impulse: Option<Output<fuyu_msgs::ExternalImpulse>>,
    /// `None` without contact.
    contacts: Option<Publisher<ros_gz_interfaces::Contacts>>,
    imu: Output<sensor_msgs::Imu>,
    /// `None` without a force and torque sensor.
    wrist: Option<Output<geometry_msgs::WrenchStamped>>,
    /// `None` without a star tracker.
    star_tracker: Option<Publisher<geometry_msgs::QuaternionStamped>>,
    tf: Output<tf2_msgs::TFMessage>,
    tf_static: Publisher<tf2_msgs::TFMessage>,
    /// Kept so that late joiners receive the last message.
    _description: Publisher<std_msgs::String>,
    /// Whether the world was changed, other than by a step, since it was last published.
    is_outdated: bool,
    /// Number and time of the state that was published last.
    published: Option<(u64, Time)>,
}

/// A publisher with the message that it updates and sends.
struct Output<M> {
    publisher: Publisher<M>,
    message: M,
}

impl<M: Interface> Output<M> {
    /// Updates and publishes the message.
    fn publish(&mut self, update: impl FnOnce(&mut M)) {
        update(&mut self.message);
        self.publisher.publish(&self.message);
    }
}

/// Publishers of one target.
struct TargetOutputs {
    name: String,
    odometry: Output<nav_msgs::Odometry>,
    /// `None` without joints.
    joints: Option<TargetJointOutputs>,
    description: Publisher<std_msgs::String>,
    /// The description as last published.
    published_description: String,
}

/// Publishers for the joints of a target.
struct TargetJointOutputs {
    states: Output<sensor_msgs::JointState>,
    momentum: Output<fuyu_msgs::Momentum>,
}

impl Outputs {
    /// Advertises all topics, including `/clock` if the node `owns_time`, and publishes the data that never change.
    ///
    /// # Errors
    /// When the node cannot publish.
    pub fn new(
        node: &Node,
        world: &World,
        params: &DynamicsParams,
        owns_time: bool,
    ) -> Result<Self, NodeError> {
        let frames = FrameTree::new(&world.robot);
        let latched_description = topics::ROBOT_DESCRIPTION.advertise(node)?;
        latched_description.publish(&std_msgs::String {
            data: params.robot.xml.clone(),
        });
        let tf_static = topics::TF_STATIC.advertise(node)?;
        tf_static.publish(&frames.static_transforms(&world.targets));
        let (base, stamp) = (frames.base(), Time::ZERO);
        let appendage_outlines = match appendage_outlines(base, &params.flexible.appendages) {
            Some(message) => {
                let publisher = topics::APPENDAGE_OUTLINES.advertise(node)?;
                publisher.publish(&message);
                Some(publisher)
            }
            None => None,
        };
        Ok(Self {
            _appendage_outlines: appendage_outlines,
            time: node.clock().clone(),
            clock: match owns_time {
                true => Some(topics::CLOCK.advertise(node)?),
                false => None,
            },
            joint_states: Output {
                publisher: topics::JOINT_STATES.advertise(node)?,
                message: joint_states(stamp, base, world),
            },
            odometry: Output {
                publisher: topics::ODOMETRY.advertise(node)?,
                message: odometry_message(base),
            },
            targets: (world.targets.iter())
                .map(|target| TargetOutputs::new(node, target))
                .collect::<Result<_, _>>()?,
            momentum: Output {
                publisher: topics::MOMENTUM.advertise(node)?,
                message: momentum_message(),
            },
            appendages: match appendage_states(stamp, base, world) {
                Some(message) => Some(Output {
                    publisher: topics::APPENDAGES.advertise(node)?,
                    message,
                }),
                None => None,
            },
            wheels: match wheel_states(stamp, base, world) {
                Some(message) => Some(Output {
                    publisher: topics::WHEEL_STATES.advertise(node)?,
                    message,
                }),
                None => None,
            },
            external_impulse: match params.motions.interfaces
                || world.is_acted_on()
                || world.has_contact()
            {
                true => Some(Output {
                    publisher: topics::EXTERNAL_IMPULSE.advertise(node)?,
                    message: external_impulse_message(),
                }),
                false => None,
            },
            contacts: match world.has_contact() {
                true => Some(topics::CONTACTS.advertise(node)?),
                false => None,
            },
            wrist: match blank_wrist_message(world) {
                Some(message) => Some(Output {
                    publisher: topics::WRIST_WRENCH.advertise(node)?,
                    message,
                }),
                None => None,
            },
            imu: Output {
                publisher: topics::IMU.advertise(node)?,
                message: imu_message(base, world.imu()),
            },
            star_tracker: match world.has_star_tracker() {
                true => Some(topics::STAR_TRACKER.advertise(node)?),
                false => None,
            },
            tf: Output {
                publisher: topics::TF.advertise(node)?,
                message: frames.transforms(stamp, world),
            },
            frames,
            tf_static,
            _description: latched_description,
            is_outdated: false,
            published: None,
        })
    }

    /// Marks the world as changed other than by a step: it has to be published.
    pub fn invalidate(&mut self) {
        self.is_outdated = true;
    }

    /// Whether the world was changed, other than by a step, since it was last published.
    pub fn is_outdated(&self) -> bool {
        self.is_outdated
    }

    /// Removes the publishers of targets that no longer exist.
    pub fn remove_targets(&mut self, world: &World) {
        self.targets
            .retain(|outputs| world.targets.iter().any(|t| t.name == outputs.name));
        self.update_frames(world);
    }

    /// Adds publishers for new targets, and removes those of targets that no longer exist.
    ///
    /// # Errors
    /// When the node cannot publish.
    pub fn replace_targets(&mut self, node: &Node, world: &World) -> Result<(), NodeError> {
        let mut before = std::mem::take(&mut self.targets);
        for target in &world.targets {
            let known = before
                .iter()
                .position(|outputs| outputs.name == target.name);
            self.targets.push(match known {
                Some(i) => {
                    let mut outputs = before.swap_remove(i);
                    outputs.describe(node, target)?;
                    outputs
                }
                None => TargetOutputs::new(node, target)?,
            });
        }
        self.update_frames(world);
        Ok(())
    }

    /// Updates the frames after the targets have changed.
    fn update_frames(&mut self, world: &World) {
        self.tf.message = self.frames.transforms(Time::ZERO, world);
        self.tf_static
            .publish(&self.frames.static_transforms(&world.targets));
    }

    /// Publishes the time of the last state on `/clock` again.
    pub fn repeat_time(&self) {
        if let Some(clock) = &self.clock {
            clock.publish(&rosgraph_msgs::Clock {
                clock: self.time.now().into(),
            });
        }
    }

    /// Publishes the current state of the world.
    pub fn publish(&mut self, world: &mut World) {
        ros::publish_together(|| self.publish_state(world));
    }

    fn publish_state(&mut self, world: &mut World) {
        let stamp = Time::from_secs_f64(world.time());
        let state = Some((world.ticks(), stamp));
        // Commands received meanwhile change the accelerations; a state that is published again keeps its measurements.
        let is_repeated = self.published == state && !self.is_outdated;
        self.published = state;
        self.is_outdated = false;
        self.time.drive(stamp);
        if let Some(clock) = &self.clock {
            clock.publish(&rosgraph_msgs::Clock {
                clock: stamp.into(),
            });
        }
        // Published first, so that a node that answers the state has the attitudes delivered by then.
        if let Some(publisher) = &self.star_tracker {
            world.expose_star_tracker();
            while let Some(frame) = world.next_star_tracker_frame() {
                publisher.publish(&star_tracker_message(&frame));
            }
        }
        self.joint_states
            .publish(|message| update_joint_states(message, stamp, world));
        self.odometry
            .publish(|message| update_odometry(message, stamp, &world.robot));
        for (outputs, target) in self.targets.iter_mut().zip(&world.targets) {
            outputs.publish(stamp, target);
        }
        self.momentum
            .publish(|message| update_momentum(message, stamp, &world.robot));
        if let Some(output) = &mut self.appendages {
            output.publish(|message| update_appendage_states(message, stamp, world));
        }
        if let Some(output) = &mut self.wheels {
            output.publish(|message| update_wheel_states(message, stamp, world));
        }
        if let (Some(output), Some(change)) =
            (&mut self.external_impulse, world.change_from_outside())
        {
            output.publish(|message| update_external_impulse(message, stamp, &change));
        }
        if let Some(publisher) = &self.contacts {
            publisher.publish(&contacts(stamp, world));
        }
        if let Some(output) = &mut self.wrist {
            output.publish(|message| {
                if !is_repeated {
                    update_wrist_message(message, stamp, world);
                }
            });
        }
        self.imu.publish(|message| {
            if !is_repeated {
                update_imu(message, stamp, world);
            }
        });
        self.tf
            .publish(|message| self.frames.update_transforms(message, stamp, world));
    }
}

impl TargetOutputs {
    fn new(node: &Node, target: &Target) -> Result<Self, NodeError> {
        let mut outputs = Self {
            name: target.name.clone(),
            odometry: Output {
                publisher: topics::TARGET_ODOMETRY.advertise(node, &target.name)?,
                message: odometry_message(&target.name),
            },
            joints: None,
            description: topics::TARGET_DESCRIPTION.advertise(node, &target.name)?,
            published_description: String::new(),
        };
        outputs.describe(node, target)?;
        Ok(outputs)
    }

    /// Publishes the target's description if it has changed, and creates the publishers for its joints.
    fn describe(&mut self, node: &Node, target: &Target) -> Result<(), NodeError> {
        if self.published_description == target.description {
            return Ok(());
        }
        self.published_description.clone_from(&target.description);
        self.description.publish(&std_msgs::String {
            data: target.description.clone(),
        });
        // Drops the old publisher first: a topic has one publisher at a time.
        self.joints = None;
        if target.has_joints() {
            self.joints = Some(TargetJointOutputs::new(node, target)?);
        }
        Ok(())
    }

    fn publish(&mut self, stamp: Time, target: &Target) {
        (self.odometry).publish(|message| update_odometry(message, stamp, &target.body));
        if let Some(TargetJointOutputs { states, momentum }) = &mut self.joints {
            states.publish(|message| update_target_joint_states(message, stamp, target));
            momentum.publish(|message| update_momentum(message, stamp, &target.body));
        }
    }
}

impl TargetJointOutputs {
    fn new(node: &Node, target: &Target) -> Result<Self, NodeError> {
        Ok(Self {
            states: Output {
                publisher: topics::TARGET_JOINT_STATES.advertise(node, &target.name)?,
                message: target_joint_states(Time::ZERO, target),
            },
            momentum: Output {
                publisher: topics::TARGET_MOMENTUM.advertise(node, &target.name)?,
                message: momentum_message(),
            },
        })
    }
}
