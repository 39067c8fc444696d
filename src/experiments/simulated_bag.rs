//! A simulated run as a bag: the messages that the nodes would publish, stamped and recorded in simulated time, so that
//! the same scenario gives the same file.

use std::path::Path;

use super::{ClosedLoop, Moment};
use crate::{
    bag::{BagError, Recording, Topic, TopicId, Writer, WriterOptions},
    control::Stamp,
    msg::{Interface, rosgraph_msgs, std_msgs},
    nodes::{
        attitude::AttitudeMessages,
        camera,
        controller::ControllerMessages,
        dynamics::{
            FrameTree, World, appendage_states, imu, joint_states, momentum, odometry,
            star_tracker_message, wheel_states,
        },
        features::feature_frame_to_msg,
        teleop, topics,
    },
    ros::Time,
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
    appendages: Option<TopicId>,
    wheels: Option<TopicId>,
    imu: TopicId,
    tf: TopicId,
    servo: Option<ServoTopics>,
    /// Commands of an operator.
    rates: Option<TopicId>,
    attitude: Option<AttitudeTopics>,
}

/// Topics of the star tracker and of the attitude controller.
struct AttitudeTopics {
    star_tracker: TopicId,
    wheels: TopicId,
    thrusters: TopicId,
    state: TopicId,
    messages: AttitudeMessages,
}

/// Topics of camera and controller.
struct ServoTopics {
    tip_pose: TopicId,
    goal_pose: TopicId,
    /// If the camera watches a target.
    features: Option<TopicId>,
    commands: TopicId,
    state: TopicId,
    messages: Option<ControllerMessages>,
}

impl SimulatedBag {
    /// Starts a bag in the new folder `folder`.
    ///
    /// # Errors
    /// When the folder exists or cannot be written.
    pub fn create(folder: &Path, run: &ClosedLoop, description: &str) -> Result<Self, BagError> {
        let mut writer = Writer::create(folder, WriterOptions::default())?;
        let frames = FrameTree::new(&run.world.robot);
        let latched = add(&mut writer, &topics::ROBOT_DESCRIPTION)?;
        let text = std_msgs::String {
            data: description.to_owned(),
        };
        writer.write_message(latched, 0, &text)?;
        let tf_static = add(&mut writer, &topics::TF_STATIC)?;
        writer.write_message(tf_static, 0, &frames.static_transforms(&run.world.targets))?;
        for target in &run.world.targets {
            let described = topics::TARGET_DESCRIPTION.of(&target.name);
            let latched = named(&mut writer, &described, &topics::ROBOT_DESCRIPTION)?;
            let text = std_msgs::String {
                data: target.description.clone(),
            };
            writer.write_message(latched, 0, &text)?;
        }
        if let Some(image) = run.image() {
            let camera_info = add(&mut writer, &topics::CAMERA_INFO)?;
            writer.write_message(camera_info, 0, &camera::calibration(image))?;
        }
        let w = &mut writer;
        Ok(Self {
            clock: add(w, &topics::CLOCK)?,
            joint_states: add(w, &topics::JOINT_STATES)?,
            odometry: add(w, &topics::ODOMETRY)?,
            targets: (run.world.targets.iter())
                .map(|t| named(w, &topics::TARGET_ODOMETRY.of(&t.name), &topics::ODOMETRY))
                .collect::<Result<_, _>>()?,
            momentum: add(w, &topics::MOMENTUM)?,
            appendages: match appendage_states(Time::ZERO, frames.base(), &run.world) {
                Some(_) => Some(add(w, &topics::APPENDAGES)?),
                None => None,
            },
            wheels: match wheel_states(Time::ZERO, frames.base(), &run.world) {
                Some(_) => Some(add(w, &topics::WHEEL_STATES)?),
                None => None,
            },
            imu: add(w, &topics::IMU)?,
            tf: add(w, &topics::TF)?,
            servo: if run.image().is_some() {
                Some(ServoTopics {
                    tip_pose: add(w, &topics::TIP_POSE)?,
                    goal_pose: add(w, &topics::MEASURED_GOAL)?,
                    features: match run.tracks_target() {
                        true => Some(add(w, &topics::FEATURES)?),
                        false => None,
                    },
                    commands: add(w, &topics::JOINT_COMMANDS)?,
                    state: add(w, &topics::CONTROLLER_STATE)?,
                    messages: None,
                })
            } else {
                None
            },
            rates: match run.is_operated() {
                true => Some(add(w, &topics::JOINT_COMMANDS)?),
                false => None,
            },
            attitude: match run.attitude() {
                Some(attitude) => Some(AttitudeTopics {
                    star_tracker: add(w, &topics::STAR_TRACKER)?,
                    wheels: add(w, &topics::WHEEL_COMMANDS)?,
                    thrusters: add(w, &topics::THRUSTER_COMMANDS)?,
                    state: add(w, &topics::ATTITUDE_STATE)?,
                    messages: AttitudeMessages::new(attitude),
                }),
                None => None,
            },
            writer,
            frames,
        })
    }

    /// Writes the messages that the dynamics node publishes for a state.
    ///
    /// # Errors
    /// When the bag cannot be written.
    pub fn state(&mut self, world: &mut World) -> Result<(), BagError> {
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
        if let (Some(topic), Some(message)) =
            (self.appendages, appendage_states(stamp, &base, world))
        {
            w.write_message(topic, log, &message)?;
        }
        if let (Some(topic), Some(message)) = (self.wheels, wheel_states(stamp, &base, world)) {
            w.write_message(topic, log, &message)?;
        }
        w.write_message(self.imu, log, &imu(stamp, &base, world))?;
        w.write_message(self.tf, log, &self.frames.transforms(stamp, world))
    }

    /// Writes the messages that camera and controller, or an operator, publish in response to a state.
    ///
    /// # Errors
    /// When the bag cannot be written.
    pub fn moment(&mut self, time: f64, moment: &Moment) -> Result<(), BagError> {
        if let (Some(rates), Some(drive)) = (self.rates, &moment.drive) {
            let stamp = Time::from_secs_f64(time);
            let header = std_msgs::Header {
                stamp: stamp.into(),
                frame_id: self.frames.base().to_owned(),
            };
            let command = teleop::message(drive.steering, header);
            (self.writer).write_message(rates, log_time(stamp), &command)?;
        }
        if let (Some(topics), Some(answer)) = (&mut self.attitude, &moment.attitude) {
            let stamp = Time::from_secs_f64(time);
            let log = log_time(stamp);
            let w = &mut self.writer;
            for frame in answer.frames {
                w.write_message(topics.star_tracker, log, &star_tracker_message(frame))?;
            }
            let messages = &mut topics.messages;
            if let Some(report) = &answer.report {
                messages.write_report(answer.attitude, report);
                w.write_message(topics.state, log, &messages.state)?;
            }
            let now = Stamp::from_nanos(stamp.as_nanos());
            if messages.write_commands(answer.attitude, now) {
                w.write_message(topics.thrusters, log, &messages.thrusters)?;
            }
            w.write_message(topics.wheels, log, &messages.wheels)?;
        }
        let (Some(servo), Some(answer)) = (&mut self.servo, &moment.answer) else {
            return Ok(());
        };
        let stamp = Time::from_secs_f64(time);
        let log = log_time(stamp);
        let base = self.frames.base().to_owned();
        let w = &mut self.writer;
        for frame in moment.frames {
            let tip = camera::pose_message(frame.time, &base, &frame.X_BE);
            w.write_message(servo.tip_pose, log, &tip)?;
            if let Some(X_BD) = &frame.X_BD {
                let goal = camera::pose_message(frame.time, &base, X_BD);
                w.write_message(servo.goal_pose, log, &goal)?;
            }
        }
        for frame in answer.feature_frames {
            if let Some(features) = servo.features {
                let message = feature_frame_to_msg(frame, camera::CAMERA_FRAME);
                w.write_message(features, log, &message)?;
            }
        }
        let messages = servo
            .messages
            .get_or_insert_with(|| ControllerMessages::new(answer.control_loop.controller()));
        messages.write(answer.control_loop, &answer.report);
        w.write_message(servo.commands, log, &messages.command)?;
        w.write_message(servo.state, log, &messages.state)
    }

    /// Closes the bag.
    ///
    /// # Errors
    /// When the bag cannot be written.
    pub fn finish(self) -> Result<Recording, BagError> {
        self.writer.finish()
    }
}

fn add<M: Interface>(writer: &mut Writer, topic: &topics::Topic<M>) -> Result<TopicId, BagError> {
    named(writer, topic.name, topic)
}

fn named<M: Interface>(
    writer: &mut Writer,
    name: &str,
    topic: &topics::Topic<M>,
) -> Result<TopicId, BagError> {
    let full = format!("/{}", name.trim_start_matches('/'));
    writer.add_topic(Topic::of::<M>(full, topic.qos))
}

fn log_time(stamp: Time) -> u64 {
    u64::try_from(stamp.as_nanos()).unwrap_or(0)
}
