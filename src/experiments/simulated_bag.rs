//! Bag of a simulated run: the messages that the nodes would publish, stamped and recorded in simulated time, so that
//! the same scenario gives the same file.

use std::path::Path;

use super::{AttitudeAnswer, ClosedLoop, Moment, SimulatedImages};
use crate::{
    bag::{BagError, Recording, Topic, TopicId, Writer, WriterOptions},
    control::Stamp,
    msg::{
        Interface, rosgraph_msgs,
        sensor_msgs::{CameraInfo, CompressedImage, Image},
        std_msgs,
    },
    nodes::{
        attitude::AttitudeMessages,
        camera::{
            self,
            images::{Content, ImageMessage, MAIN},
        },
        controller::ControllerMessages,
        dynamics::{
            FrameTree, Target, World, appendage_states, contacts, external_impulse, imu,
            joint_states, momentum, odometry, star_tracker_message, target_joint_states,
            wheel_states, wrist_message,
        },
        features::feature_frame_to_msg,
        mission, teleop, topics,
    },
    ros::Time,
};

/// Writes the bag of one run with one or several robots.
pub struct SimulatedBag {
    writer: Writer,
    clock: TopicId,
    robots: Vec<RobotTopics>,
}

/// A robot to be recorded.
pub struct Recorded<'a> {
    /// Namespace of its topics, `/` without one.
    pub namespace: &'a str,
    /// Its closed loop.
    pub run: &'a ClosedLoop,
    /// Its URDF.
    pub description: &'a str,
    /// Images that its cameras render.
    pub images: Option<SimulatedImages>,
}

/// Topics of a robot.
struct RobotTopics {
    frames: FrameTree,
    joint_states: TopicId,
    odometry: TopicId,
    targets: Vec<TargetTopics>,
    momentum: TopicId,
    appendages: Option<TopicId>,
    wheels: Option<TopicId>,
    /// `None` unless external wrenches, thrusters or targets can act on the robot.
    external_impulse: Option<TopicId>,
    /// `None` without contact.
    contacts: Option<TopicId>,
    /// `None` without a force and torque sensor.
    wrist: Option<TopicId>,
    imu: TopicId,
    tf: TopicId,
    servo: Option<ServoTopics>,
    /// Joint rates commanded by an operator.
    rates: Option<TopicId>,
    attitude: Option<AttitudeTopics>,
    images: Option<RenderedImages>,
}

/// Rendered images and their topics.
struct RenderedImages {
    images: SimulatedImages,
    topics: Vec<TopicId>,
}

impl RenderedImages {
    /// Adds the topics, and writes the calibrations.
    fn new(w: &mut Namespaced, images: SimulatedImages) -> Result<Self, BagError> {
        let mut topics = Vec::new();
        for output in images.outputs() {
            let full = format!("{}/{}", w.namespace, output.topic);
            let topic = match output.content {
                Content::Image => Topic::of::<Image>(full, output.qos),
                Content::Compressed => Topic::of::<CompressedImage>(full, output.qos),
                Content::Info => Topic::of::<CameraInfo>(full, output.qos),
            };
            topics.push(w.writer.add_topic(topic)?);
        }
        for (i, message) in images.infos() {
            write_image(w.writer, topics[i], 0, &message)?;
        }
        Ok(Self { images, topics })
    }

    /// Whether the images include those of the main camera, with its calibration.
    fn has_main(images: &SimulatedImages) -> bool {
        let main = format!("{MAIN}/camera_info");
        images.outputs().iter().any(|output| output.topic == main)
    }
}

fn write_image(
    writer: &mut Writer,
    topic: TopicId,
    log: u64,
    message: &ImageMessage,
) -> Result<(), BagError> {
    match message {
        ImageMessage::Image(image) => writer.write_message(topic, log, image),
        ImageMessage::Compressed(image) => writer.write_message(topic, log, image),
        ImageMessage::Info(info) => writer.write_message(topic, log, info.as_ref()),
    }
}

/// Topics of the star tracker and of the attitude controller.
struct AttitudeTopics {
    star_tracker: TopicId,
    wheels: TopicId,
    thrusters: TopicId,
    state: TopicId,
    messages: AttitudeMessages,
}

impl AttitudeTopics {
    /// Writes the messages of star tracker and attitude controller at a time \[s\].
    fn write(
        &mut self,
        w: &mut Writer,
        time: f64,
        answer: &AttitudeAnswer,
    ) -> Result<(), BagError> {
        let stamp = Time::from_secs_f64(time);
        let log = log_time(stamp);
        for frame in answer.frames {
            w.write_message(self.star_tracker, log, &star_tracker_message(frame))?;
        }
        let messages = &mut self.messages;
        if let Some(report) = &answer.report {
            messages.write_report(answer.attitude, report);
            w.write_message(self.state, log, &messages.state)?;
        }
        let now = Stamp::from_nanos(stamp.as_nanos());
        if messages.write_commands(answer.attitude, now) {
            w.write_message(self.thrusters, log, &messages.thrusters)?;
        }
        w.write_message(self.wheels, log, &messages.wheels)
    }
}

/// Topics of a target.
struct TargetTopics {
    odometry: TopicId,
    /// Joint states and momentum; `None` without joints.
    joints: Option<(TopicId, TopicId)>,
}

impl TargetTopics {
    /// Adds the topics, and writes the description.
    fn new(w: &mut Namespaced, target: &Target) -> Result<Self, BagError> {
        let name = target.name.as_str();
        let described = topics::TARGET_DESCRIPTION.of(name);
        let latched = w.named(&described, &topics::ROBOT_DESCRIPTION)?;
        let text = std_msgs::String {
            data: target.description.clone(),
        };
        w.writer.write_message(latched, 0, &text)?;
        let odometry = w.named(&topics::TARGET_ODOMETRY.of(name), &topics::ODOMETRY)?;
        let joints = match target.has_joints() {
            false => None,
            true => {
                let states = topics::TARGET_JOINT_STATES.of(name);
                let momentum = topics::TARGET_MOMENTUM.of(name);
                Some((
                    w.named(&states, &topics::JOINT_STATES)?,
                    w.named(&momentum, &topics::MOMENTUM)?,
                ))
            }
        };
        Ok(Self { odometry, joints })
    }

    fn write(&self, writer: &mut Writer, stamp: Time, target: &Target) -> Result<(), BagError> {
        let log = log_time(stamp);
        let moved = odometry(stamp, &target.name, &target.body);
        writer.write_message(self.odometry, log, &moved)?;
        if let Some((states, total)) = self.joints {
            writer.write_message(states, log, &target_joint_states(stamp, target))?;
            writer.write_message(total, log, &momentum(stamp, &target.body))?;
        }
        Ok(())
    }
}

/// Topics of an estimator and a mission.
struct CaptureTopics {
    prediction: TopicId,
    wrench: TopicId,
    /// `None` unless the mission uses wheels.
    wheels: Option<TopicId>,
    thrusters: Option<TopicId>,
    state: TopicId,
    timer: mission::StateTimer,
}

/// Topics of camera and controller.
struct ServoTopics {
    tip_pose: TopicId,
    goal_pose: TopicId,
    /// `None` unless the camera tracks a target.
    features: Option<TopicId>,
    commands: TopicId,
    /// `None` without a controller.
    state: Option<TopicId>,
    capture: Option<CaptureTopics>,
    messages: Option<ControllerMessages>,
}

impl RobotTopics {
    /// Adds the topics, and writes the constant messages.
    fn new(writer: &mut Writer, robot: Recorded) -> Result<Self, BagError> {
        let run = robot.run;
        let has_main = robot.images.as_ref().is_some_and(RenderedImages::has_main);
        let frames = FrameTree::new(&run.world.robot);
        let mut w = Namespaced {
            writer,
            namespace: robot.namespace.trim_end_matches('/'),
        };
        let latched = w.add(&topics::ROBOT_DESCRIPTION)?;
        let text = std_msgs::String {
            data: robot.description.to_owned(),
        };
        w.writer.write_message(latched, 0, &text)?;
        let tf_static = w.add(&topics::TF_STATIC)?;
        let fixed = frames.static_transforms(&run.world.targets);
        w.writer.write_message(tf_static, 0, &fixed)?;
        if let Some(image) = run.image().filter(|_| !has_main) {
            let camera_info = w.add(&topics::CAMERA_INFO)?;
            let calibration = camera::calibration(image);
            w.writer.write_message(camera_info, 0, &calibration)?;
        }
        Ok(Self {
            joint_states: w.add(&topics::JOINT_STATES)?,
            odometry: w.add(&topics::ODOMETRY)?,
            targets: (run.world.targets.iter())
                .map(|target| TargetTopics::new(&mut w, target))
                .collect::<Result<_, _>>()?,
            momentum: w.add(&topics::MOMENTUM)?,
            appendages: match appendage_states(Time::ZERO, frames.base(), &run.world) {
                Some(_) => Some(w.add(&topics::APPENDAGES)?),
                None => None,
            },
            wheels: match wheel_states(Time::ZERO, frames.base(), &run.world) {
                Some(_) => Some(w.add(&topics::WHEEL_STATES)?),
                None => None,
            },
            external_impulse: match run.world.is_acted_on()
                || run.capturing().is_some()
                || run.world.has_contact()
                || run.world.coupled_targets().next().is_some()
            {
                true => Some(w.add(&topics::EXTERNAL_IMPULSE)?),
                false => None,
            },
            contacts: match run.world.has_contact() {
                true => Some(w.add(&topics::CONTACTS)?),
                false => None,
            },
            wrist: match run.world.wrist_frame() {
                Some(_) => Some(w.add(&topics::WRIST_WRENCH)?),
                None => None,
            },
            imu: w.add(&topics::IMU)?,
            tf: w.add(&topics::TF)?,
            servo: if run.image().is_some() {
                Some(ServoTopics {
                    tip_pose: w.add(&topics::TIP_POSE)?,
                    goal_pose: w.add(&topics::MEASURED_GOAL)?,
                    features: match run.topic_of_features() {
                        Some(topic) => Some(w.add(&topic)?),
                        None => None,
                    },
                    commands: w.add(&topics::JOINT_COMMANDS)?,
                    state: match run.capturing() {
                        Some(_) => None,
                        None => Some(w.add(&topics::CONTROLLER_STATE)?),
                    },
                    capture: match run.capturing() {
                        Some(capturing) => Some(CaptureTopics {
                            prediction: w.add(&topics::PREDICTION)?,
                            wrench: w.add(&topics::WRENCH)?,
                            wheels: (capturing.actuators().has_wheels())
                                .then(|| w.add(&topics::WHEEL_COMMANDS))
                                .transpose()?,
                            thrusters: (capturing.actuators().has_thrusters())
                                .then(|| w.add(&topics::THRUSTER_COMMANDS))
                                .transpose()?,
                            state: w.add(&topics::MISSION_STATE)?,
                            timer: mission::StateTimer::default(),
                        }),
                        None => None,
                    },
                    messages: None,
                })
            } else {
                None
            },
            rates: match run.is_operated() {
                true => Some(w.add(&topics::JOINT_COMMANDS)?),
                false => None,
            },
            attitude: match run.attitude() {
                Some(attitude) => Some(AttitudeTopics {
                    star_tracker: w.add(&topics::STAR_TRACKER)?,
                    wheels: w.add(&topics::WHEEL_COMMANDS)?,
                    thrusters: w.add(&topics::THRUSTER_COMMANDS)?,
                    state: w.add(&topics::ATTITUDE_STATE)?,
                    messages: AttitudeMessages::new(attitude),
                }),
                None => None,
            },
            images: match robot.images {
                Some(images) => Some(RenderedImages::new(&mut w, images)?),
                None => None,
            },
            frames,
        })
    }
}

impl SimulatedBag {
    /// Starts a bag in the new folder `folder`.
    ///
    /// # Errors
    /// If the folder exists or cannot be written.
    pub fn create(folder: &Path, robots: Vec<Recorded>) -> Result<Self, BagError> {
        let mut writer = Writer::create(folder, WriterOptions::default())?;
        let clock =
            Topic::of::<rosgraph_msgs::Clock>(topics::CLOCK.name.to_owned(), topics::CLOCK.qos);
        let clock = writer.add_topic(clock)?;
        let robots = robots.into_iter();
        let robots = robots.map(|robot| RobotTopics::new(&mut writer, robot));
        Ok(Self {
            clock,
            robots: robots.collect::<Result<_, _>>()?,
            writer,
        })
    }

    /// Writes `/clock`.
    ///
    /// # Errors
    /// When the bag cannot be written.
    pub fn time(&mut self, time: f64) -> Result<(), BagError> {
        let stamp = Time::from_secs_f64(time);
        let clock = rosgraph_msgs::Clock {
            clock: stamp.into(),
        };
        (self.writer).write_message(self.clock, log_time(stamp), &clock)
    }

    /// Writes the messages that the dynamics node of a robot publishes for a state.
    ///
    /// # Errors
    /// When the bag cannot be written.
    pub fn state(&mut self, robot: usize, world: &mut World) -> Result<(), BagError> {
        let stamp = Time::from_secs_f64(world.time());
        let log = log_time(stamp);
        let (w, t) = (&mut self.writer, &self.robots[robot]);
        let base = t.frames.base();
        w.write_message(t.joint_states, log, &joint_states(stamp, base, world))?;
        w.write_message(t.odometry, log, &odometry(stamp, base, &world.robot))?;
        for (topics, target) in t.targets.iter().zip(&world.targets) {
            topics.write(w, stamp, target)?;
        }
        w.write_message(t.momentum, log, &momentum(stamp, &world.robot))?;
        let change = world.change_from_outside();
        if let (Some(topic), Some(change)) = (t.external_impulse, change) {
            w.write_message(topic, log, &external_impulse(stamp, &change))?;
        }
        if let (Some(topic), Some(message)) = (t.appendages, appendage_states(stamp, base, world)) {
            w.write_message(topic, log, &message)?;
        }
        if let (Some(topic), Some(message)) = (t.wheels, wheel_states(stamp, base, world)) {
            w.write_message(topic, log, &message)?;
        }
        if let Some(topic) = t.contacts {
            w.write_message(topic, log, &contacts(stamp, world))?;
        }
        if let (Some(topic), Some(message)) = (t.wrist, wrist_message(stamp, world)) {
            w.write_message(topic, log, &message)?;
        }
        w.write_message(t.imu, log, &imu(stamp, base, world))?;
        w.write_message(t.tf, log, &t.frames.transforms(stamp, world))
    }

    /// Renders the images that are due at the current state of a robot, and writes those whose latency has passed.
    ///
    /// # Errors
    /// If the state is not finite, or the bag cannot be written.
    pub fn images<E>(&mut self, robot: usize, world: &World) -> Result<(), E>
    where
        E: From<String> + From<BagError>,
    {
        let log = log_time(Time::from_secs_f64(world.time()));
        let Some(rendered) = &mut self.robots[robot].images else {
            return Ok(());
        };
        for (i, message) in rendered.images.show(world)? {
            write_image(&mut self.writer, rendered.topics[i], log, &message)?;
        }
        Ok(())
    }

    /// Writes the messages that the other nodes of a robot publish in response to a state.
    ///
    /// # Errors
    /// When the bag cannot be written.
    pub fn moment(&mut self, robot: usize, time: f64, moment: &Moment) -> Result<(), BagError> {
        let topics = &mut self.robots[robot];
        if let (Some(rates), Some(drive)) = (topics.rates, &moment.drive) {
            let stamp = Time::from_secs_f64(time);
            let header = std_msgs::Header {
                stamp: stamp.into(),
                frame_id: topics.frames.base().to_owned(),
            };
            let command = teleop::message(drive.steering, header);
            (self.writer).write_message(rates, log_time(stamp), &command)?;
        }
        if let (Some(topics), Some(answer)) = (&mut topics.attitude, &moment.attitude) {
            topics.write(&mut self.writer, time, answer)?;
        }
        let Some(servo) = &mut topics.servo else {
            return Ok(());
        };
        let stamp = Time::from_secs_f64(time);
        let log = log_time(stamp);
        let base = topics.frames.base();
        let w = &mut self.writer;
        for frame in moment.frames {
            let tip = camera::pose_message(frame.time, base, &frame.X_BE);
            w.write_message(servo.tip_pose, log, &tip)?;
            if let Some(X_BD) = &frame.X_BD {
                let goal = camera::pose_message(frame.time, base, X_BD);
                w.write_message(servo.goal_pose, log, &goal)?;
            }
        }
        let features = match (&moment.answer, &moment.capture) {
            (Some(answer), _) => answer.feature_frames,
            (None, Some(capture)) => capture.feature_frames,
            (None, None) => &[],
        };
        for frame in features {
            if let Some(features) = servo.features {
                let message = feature_frame_to_msg(frame, camera::CAMERA_FRAME);
                w.write_message(features, log, &message)?;
            }
        }
        if let (Some(topics), Some(capture)) = (&mut servo.capture, &moment.capture) {
            let header = std_msgs::Header {
                stamp: stamp.into(),
                frame_id: base.to_owned(),
            };
            for path in capture.predictions {
                w.write_message(topics.prediction, log, path)?;
            }
            if let Some(couple) = &capture.couple {
                let message = mission::couple(header.clone(), couple);
                w.write_message(topics.wrench, log, &message)?;
            }
            let used = capture.actuators;
            if let (Some(topic), Some(times)) = (topics.thrusters, &capture.on_times) {
                let message = mission::on_times(used.thrusters(), header.clone(), times);
                w.write_message(topic, log, &message)?;
            }
            if let Some(topic) = topics.wheels {
                let torques = &capture.wheel_torques;
                let message = mission::efforts(used.wheels(), header.clone(), torques);
                w.write_message(topic, log, &message)?;
            }
            if topics.timer.is_due(capture.mission, time) {
                let state = mission::state(capture.mission, header.clone());
                w.write_message(topics.state, log, &state)?;
            }
            let joints = capture.mission.model().joints().iter();
            let names = joints.map(|joint| joint.name.as_str());
            let message = mission::efforts(names, header, &capture.efforts);
            w.write_message(servo.commands, log, &message)?;
        }
        let (Some(answer), Some(state)) = (&moment.answer, servo.state) else {
            return Ok(());
        };
        let messages = servo
            .messages
            .get_or_insert_with(|| ControllerMessages::new(answer.control_loop.controller()));
        messages.write(answer.control_loop, &answer.report);
        w.write_message(servo.commands, log, &messages.command)?;
        w.write_message(state, log, &messages.state)
    }

    /// Closes the bag.
    ///
    /// # Errors
    /// When the bag cannot be written.
    pub fn finish(self) -> Result<Recording, BagError> {
        self.writer.finish()
    }
}

/// Adds topics in the namespace of a robot.
struct Namespaced<'a> {
    writer: &'a mut Writer,
    /// The namespace, without a slash at its end.
    namespace: &'a str,
}

impl Namespaced<'_> {
    fn add<M: Interface>(&mut self, topic: &topics::Topic<M>) -> Result<TopicId, BagError> {
        self.named(topic.name, topic)
    }

    fn named<M: Interface>(
        &mut self,
        name: &str,
        topic: &topics::Topic<M>,
    ) -> Result<TopicId, BagError> {
        let full = format!("{}/{}", self.namespace, name.trim_start_matches('/'));
        self.writer.add_topic(Topic::of::<M>(full, topic.qos))
    }
}

fn log_time(stamp: Time) -> u64 {
    u64::try_from(stamp.as_nanos()).unwrap_or(0)
}
