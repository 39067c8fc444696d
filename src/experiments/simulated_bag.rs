//! A simulated run as a bag: the messages that the nodes would have published, stamped and logged in
//! simulated time, so that the same scenario gives the same file.

use std::path::Path;

use super::{ClosedLoop, Moment};
use crate::{
    bag::{BagError, Recording, Topic, TopicId, Writer, WriterOptions},
    msg::{
        Interface, fuyu_msgs, geometry_msgs, nav_msgs, rosgraph_msgs, sensor_msgs, std_msgs,
        tf2_msgs,
    },
    nodes::{
        camera, controller,
        dynamics::{FrameTree, World, joint_states, momentum, odometry},
    },
    ros::{Qos, Time},
};

/// Writes the bag of one run.
pub struct SimulatedBag {
    writer: Writer,
    frames: FrameTree,
    clock: TopicId,
    joint_states: TopicId,
    odometry: TopicId,
    targets: Vec<TopicId>,
    momentum: TopicId,
    tf: TopicId,
    tip_pose: TopicId,
    goal_pose: TopicId,
    commands: TopicId,
    state: TopicId,
}

impl SimulatedBag {
    /// Starts a bag in the new folder `folder`.
    ///
    /// # Errors
    /// When the folder exists or cannot be written.
    pub fn create(folder: &Path, run: &ClosedLoop, description: &str) -> Result<Self, BagError> {
        let mut writer = Writer::create(folder, WriterOptions::default())?;
        let frames = FrameTree::new(run.world.robot.model());
        let latched = topic::<std_msgs::String>(&mut writer, "robot_description", Qos::LATCHED)?;
        let text = std_msgs::String {
            data: description.to_owned(),
        };
        writer.write_message(latched, 0, &text)?;
        let tf_static = topic::<tf2_msgs::TFMessage>(&mut writer, "tf_static", Qos::TF_STATIC)?;
        writer.write_message(tf_static, 0, &frames.static_transforms())?;
        let w = &mut writer;
        Ok(Self {
            clock: topic::<rosgraph_msgs::Clock>(w, "clock", Qos::CLOCK)?,
            joint_states: topic::<sensor_msgs::JointState>(w, "joint_states", Qos::RELIABLE)?,
            odometry: topic::<nav_msgs::Odometry>(w, "ground_truth/odom", Qos::RELIABLE)?,
            targets: (run.world.targets.iter())
                .map(|t| topic::<nav_msgs::Odometry>(w, &t.odometry_topic(), Qos::RELIABLE))
                .collect::<Result<_, _>>()?,
            momentum: topic::<fuyu_msgs::Momentum>(w, "ground_truth/momentum", Qos::RELIABLE)?,
            tf: topic::<tf2_msgs::TFMessage>(w, "tf", Qos::TF)?,
            tip_pose: topic::<geometry_msgs::PoseStamped>(w, "camera/tip_pose", Qos::RELIABLE)?,
            goal_pose: topic::<geometry_msgs::PoseStamped>(w, "camera/goal_pose", Qos::RELIABLE)?,
            commands: topic::<sensor_msgs::JointState>(w, "joint_commands", Qos::RELIABLE)?,
            state: topic::<fuyu_msgs::ControllerState>(w, "controller/state", Qos::RELIABLE)?,
            writer,
            frames,
        })
    }

    /// Writes what the dynamics node publishes of a state.
    ///
    /// # Errors
    /// When the bag cannot be written.
    pub fn state(&mut self, world: &World) -> Result<(), BagError> {
        let stamp = Time::from_secs_f64(world.time());
        let log = log_time(stamp);
        let base = self.frames.base().to_owned();
        let w = &mut self.writer;
        w.write_message(
            self.clock,
            log,
            &rosgraph_msgs::Clock {
                clock: stamp.into(),
            },
        )?;
        w.write_message(self.joint_states, log, &joint_states(stamp, &base, world))?;
        w.write_message(self.odometry, log, &odometry(stamp, &base, &world.robot))?;
        for (topic, target) in self.targets.iter().zip(&world.targets) {
            w.write_message(*topic, log, &odometry(stamp, &target.name, &target.body))?;
        }
        w.write_message(self.momentum, log, &momentum(stamp, &world.robot))?;
        w.write_message(self.tf, log, &self.frames.transforms(stamp, world))
    }

    /// Writes what camera and controller publish in answer to a state.
    ///
    /// # Errors
    /// When the bag cannot be written.
    pub fn moment(&mut self, time: f64, moment: &Moment) -> Result<(), BagError> {
        let stamp = Time::from_secs_f64(time);
        let log = log_time(stamp);
        let base = self.frames.base().to_owned();
        let w = &mut self.writer;
        for frame in moment.frames {
            w.write_message(
                self.tip_pose,
                log,
                &camera::seen(frame.time, &base, &frame.X_BE),
            )?;
            if let Some(X_BD) = &frame.X_BD {
                w.write_message(self.goal_pose, log, &camera::seen(frame.time, &base, X_BD))?;
            }
        }
        let header = std_msgs::Header {
            stamp: stamp.into(),
            frame_id: base,
        };
        w.write_message(
            self.commands,
            log,
            &controller::command(moment.controller, &header),
        )?;
        let age = moment.age.min(1e9);
        let state = controller::report(moment.controller, &header, &moment.acted, age);
        w.write_message(self.state, log, &state)
    }

    /// Closes the bag.
    ///
    /// # Errors
    /// When the bag cannot be written.
    pub fn finish(self) -> Result<Recording, BagError> {
        self.writer.finish()
    }
}

fn topic<M: Interface>(writer: &mut Writer, name: &str, qos: Qos) -> Result<TopicId, BagError> {
    writer.add_topic(Topic::of::<M>(format!("/{name}"), qos))
}

fn log_time(stamp: Time) -> u64 {
    u64::try_from(stamp.as_nanos()).unwrap_or(0)
}
