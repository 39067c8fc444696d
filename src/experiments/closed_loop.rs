//! Plant, camera and control loop in a single thread without DDS.

use nalgebra::{UnitQuaternion, Vector3};

use super::{
    CaptureAnswer, Capturing, Drive, Operated,
    other_bodies::{OtherBodies, Watched},
};
use crate::{
    control::{
        ControlLoop, ControlLoopConfig, Controller, ConvergenceFailure, InputError, LoopReport,
        PoseError, Stamp,
        attitude::{AttitudeInputError, AttitudeReport},
    },
    dynamics::Workspace,
    model::Frame,
    msg::fuyu_msgs::FeatureTracks,
    nodes::{
        attitude::AttitudeLoop,
        camera::{TargetCamera, camera_frame, second_camera},
        controller::second_tip,
        dynamics::{FreeBody as _, World, gyro},
        geometry::{message_round_trip, with_matrix},
        scenario::Scenario,
        tip_frame,
        topics::Topic,
    },
    ros::Time,
    spatial::Pose,
    vision::{FeatureFrame, PoseCamera, PoseFrame, StarTrackerFrame},
};

/// The closed loop of a scenario: its nodes without topics, in a single thread, in the order of a graph in lockstep.
/// The camera is exposed to each state, the control loop answers with the frames delivered so far, and its efforts are
/// held until the next state. If the scenario has a teleop node, a simulated operator steers. Without camera,
/// controller and teleop, the robot moves freely under springs and dampers. There is no estimator unless a mission node
/// needs it; the control loop gets no goal rates. Cameras that watch bodies by absolute names, of this or other robots,
/// need a [`Fleet`](super::Fleet).
pub struct ClosedLoop {
    /// The plant.
    pub world: World,
    /// Bodies that its cameras watch by absolute names.
    pub others: OtherBodies,
    servo: Option<VisualServo>,
    operated: Option<Operated>,
    capturing: Option<Box<Capturing>>,
    attitude: Option<AttitudeControl>,
    duration: f64,
}

/// Sensors and control of the base's attitude.
struct AttitudeControl {
    attitude: AttitudeLoop,
    frames: Vec<StarTrackerFrame>,
}

/// Cameras and control loop.
struct VisualServo {
    camera: PoseCamera,
    /// Kinematics of the arm as the camera knows it, for a robot with flexible parts; `None` to use the robot's own.
    kinematics: Option<Workspace>,
    target: Option<TrackedTarget>,
    feature_frames: Vec<FeatureFrame>,
    control_loop: ControlLoop,
    /// The goal in the frame of its carrier.
    X_FD: Pose,
    /// The body on which the goal is; `None` for a goal in the world.
    carrier: Option<Watched>,
    second: Option<SecondArm>,
    image: (u32, u32, f64),
    /// Whether efforts were ever clamped to the joints' limits.
    was_limited: bool,
}

/// A second arm's tip, camera and goal.
struct SecondArm {
    tip: Frame,
    camera: PoseCamera,
    X_WD: Pose,
}

/// The target whose features the camera tracks.
struct TrackedTarget {
    target_camera: TargetCamera,
    /// The tracked body.
    body: Watched,
    /// The camera's optical frame.
    camera: Frame,
}

/// One state and the answers to it.
pub struct Moment<'a> {
    /// Frames that the camera delivered at this state.
    pub frames: &'a [PoseFrame],
    /// The controller's answer, if there is one.
    pub answer: Option<Answer<'a>>,
    /// The operator's answer, if there is one.
    pub drive: Option<Drive<'a>>,
    /// The attitude controller's answer, if there is one.
    pub attitude: Option<AttitudeAnswer<'a>>,
    /// The mission's answer, if there is one.
    pub capture: Option<CaptureAnswer<'a>>,
}

/// The attitude controller's answer to a state.
pub struct AttitudeAnswer<'a> {
    /// The star tracker's measurements delivered at this state.
    pub frames: &'a [StarTrackerFrame],
    /// The controller's report, if its period has passed.
    pub report: Option<AttitudeReport>,
    /// The attitude loop, with the torques for this state.
    pub attitude: &'a AttitudeLoop,
}

impl Moment<'_> {
    /// The reason why the tip does not converge to its goal, if the controller has detected that.
    pub fn trouble(&self) -> Option<ConvergenceFailure> {
        let answer = self.answer.as_ref()?;
        answer.report.control.as_ref().ok()?.convergence_failure
    }
}

/// The controller's answer to a state.
pub struct Answer<'a> {
    /// Frames of features that the camera delivered at this state.
    pub feature_frames: &'a [FeatureFrame],
    /// The control loop's report: measurements used, and control mode.
    pub report: LoopReport,
    /// True deviation of the tip from the goal.
    pub error: PoseError,
    /// The control loop, with the efforts for this state.
    pub control_loop: &'a ControlLoop,
}

impl ClosedLoop {
    /// The closed loop that `scenario` describes.
    ///
    /// # Errors
    /// A line that names file, node and parameter.
    pub fn new(scenario: &Scenario) -> Result<Self, String> {
        let dynamics = scenario.dynamics()?;
        let at = |e: String| format!("{}: {e}", scenario.path().display());
        let world = World::new(&dynamics).map_err(at)?;
        let operated = match scenario.has("teleop") {
            true => Some(Operated::new(scenario, &world)?),
            false => None,
        };
        let capturing = match scenario.has("mission") {
            true => Some(Box::new(Capturing::new(scenario, &world)?)),
            false => None,
        };
        let steered = scenario.has("camera") && operated.is_none() && capturing.is_none();
        let mut others = OtherBodies::default();
        let servo = if steered || scenario.has("controller") {
            Some(VisualServo::new(scenario, &world, &mut others)?)
        } else {
            None
        };
        let attitude = match scenario.has("attitude") {
            true => Some(AttitudeControl {
                attitude: AttitudeLoop::new(&scenario.attitude()?, world.robot.model())
                    .map_err(at)?,
                frames: Vec::new(),
            }),
            false => None,
        };
        Ok(Self {
            world,
            others,
            servo,
            operated,
            capturing,
            attitude,
            duration: dynamics.duration,
        })
    }

    /// The scenario's duration \[s\]; zero if it has none.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Width, height and focal length of the camera's image \[px\]; `None` without a camera.
    pub fn image(&self) -> Option<(u32, u32, f64)> {
        let of_servo = self.servo.as_ref().map(|servo| servo.image);
        of_servo.or(self.capturing.as_ref().map(|capturing| capturing.image))
    }

    /// Whether the controller's efforts were ever clamped to the joints' limits.
    pub fn was_limited(&self) -> bool {
        self.servo.as_ref().is_some_and(|servo| servo.was_limited)
    }

    /// The attitude loop of the base, if there is one.
    pub fn attitude(&self) -> Option<&AttitudeLoop> {
        self.attitude.as_ref().map(|control| &control.attitude)
    }

    /// The capture mission with its camera and estimator, if there is one.
    pub fn capturing(&self) -> Option<&Capturing> {
        self.capturing.as_deref()
    }

    /// Whether a simulated operator steers.
    pub fn is_operated(&self) -> bool {
        self.operated.is_some()
    }

    /// Topic on which the camera publishes feature points, if it tracks a target.
    pub fn topic_of_features(&self) -> Option<Topic<FeatureTracks>> {
        if let Some(capturing) = &self.capturing {
            return Some(capturing.topic_of_features());
        }
        let target = self.servo.as_ref()?.target.as_ref()?;
        Some(target.target_camera.topic())
    }

    /// Lets camera and controllers answer the current state, then calls `observe`: the new efforts are set, but time
    /// has not advanced.
    ///
    /// # Errors
    /// If the controller gives no efforts, or `observe` fails.
    pub fn answer<E: From<String>>(
        &mut self,
        frames: &mut Vec<PoseFrame>,
        observe: impl FnOnce(&mut World, &Moment) -> Result<(), E>,
    ) -> Result<(), E> {
        frames.clear();
        let answer = match &mut self.servo {
            Some(servo) => Some(servo.answer(&mut self.world, &self.others, frames)?),
            None => None,
        };
        let operated = self.operated.as_mut();
        let drive = operated.map(|operated| operated.answer(&mut self.world));
        let attitude = match &mut self.attitude {
            Some(attitude) => Some(attitude.answer(&mut self.world)?),
            None => None,
        };
        let capture = match &mut self.capturing {
            Some(capturing) => Some(capturing.answer(&mut self.world, frames)?),
            None => None,
        };
        let moment = Moment {
            frames,
            answer,
            drive,
            attitude,
            capture,
        };
        observe(&mut self.world, &moment)
    }

    /// Advances to the next state.
    ///
    /// # Errors
    /// If the motion has diverged.
    pub fn advance(&mut self) -> Result<(), String> {
        self.world.step_to_tick();
        self.check()
    }

    /// Checks the state after a step.
    ///
    /// # Errors
    /// If the motion has diverged.
    pub(super) fn check(&mut self) -> Result<(), String> {
        self.world.check_grasps()?;
        self.world.check_contacts()?;
        self.world.check_divergence()
    }
}

impl AttitudeControl {
    /// Processes a state as the attitude node processes its messages, in the same order.
    fn answer(&mut self, world: &mut World) -> Result<AttitudeAnswer<'_>, String> {
        let Self { attitude, frames } = self;
        let stamp = Time::from_secs_f64(world.time());
        let at = |e: String| format!("at {:.2} s: attitude: {e}", stamp.as_secs_f64());
        let gyro = gyro(world);
        let now = Stamp::from_nanos(stamp.as_nanos());
        world.expose_star_tracker();
        frames.clear();
        while let Some(frame) = world.next_star_tracker_frame() {
            frames.push(frame);
        }
        let state = world.robot.state();
        attitude
            .add_joint_state(now, state.q.as_slice(), state.qd.as_slice())
            .map_err(at)?;
        let refused = |e: AttitudeInputError| at(e.to_string());
        attitude.add_gyro(now, gyro).map_err(refused)?;
        for frame in frames.iter() {
            let exposed = Stamp::from_nanos(Time::from_secs_f64(frame.time).as_nanos());
            // As if passed through a message.
            let R_WB = UnitQuaternion::new_normalize(frame.R_WB.into_inner());
            attitude.add_star_tracker(exposed, &R_WB).map_err(refused)?;
        }
        if let Some(robot) = world.robot.flexible() {
            attitude
                .add_wheel_speeds(now, robot.state().wheel_speeds())
                .map_err(refused)?;
        }
        let report = attitude.step(now);
        world.hold_wheel_torques(attitude.wheel_torques().iter().copied().enumerate());
        if let Some(on_times) = attitude.on_times() {
            world.fire(on_times.iter().copied().enumerate());
        }
        Ok(AttitudeAnswer {
            frames,
            report,
            attitude,
        })
    }
}

impl SecondArm {
    /// Exposes the camera to the current state, and passes its delivered measurements to the control loop.
    fn measure(
        &mut self,
        time: f64,
        X_WB: &Pose,
        X_BE: &Pose,
        control_loop: &mut ControlLoop,
    ) -> Result<(), InputError> {
        self.camera
            .show(time, X_BE, Some(&(X_WB.inverse() * self.X_WD)));
        while let Some(frame) = self.camera.deliver(time) {
            add_frame(control_loop, 1, &through_message(&frame))?;
        }
        Ok(())
    }
}

/// A frame as it is after its poses have passed through messages.
fn through_message(frame: &PoseFrame) -> PoseFrame {
    PoseFrame {
        X_BE: message_round_trip(&frame.X_BE),
        X_BD: frame.X_BD.as_ref().map(message_round_trip),
        ..*frame
    }
}

fn add_frame(
    control_loop: &mut ControlLoop,
    tip: usize,
    frame: &PoseFrame,
) -> Result<(), InputError> {
    let stamp = Stamp::from_secs_f64(frame.time);
    control_loop.add_tip_pose(tip, stamp, frame.X_BE)?;
    match frame.X_BD {
        Some(X_BD) => control_loop.add_goal_pose(tip, stamp, X_BD),
        None => Ok(()),
    }
}

impl VisualServo {
    fn new(scenario: &Scenario, world: &World, others: &mut OtherBodies) -> Result<Self, String> {
        let model = world.robot.model();
        let (camera, controller) = (scenario.camera()?, scenario.controller()?);
        let at = |e: String| format!("{}: {e}", scenario.path().display());
        let tip = tip_frame(model, &controller.tip_link)
            .map_err(|e| at(format!("controller: parameter {e}")))?;
        let camera_tip =
            tip_frame(model, &camera.tip_link).map_err(|e| at(format!("camera: parameter {e}")))?;
        if camera_tip.name != tip.name {
            return Err(at(format!(
                "the camera's tip_link is '{}' but the controller's is '{}'; they must be the same",
                camera_tip.name, tip.name
            )));
        }
        let goal = camera.goal.ok_or_else(|| {
            at(
                "camera: parameter goal.position is not given; a simulation needs a goal"
                    .to_owned(),
            )
        })?;
        let target = match &camera.features {
            None => None,
            Some(features) => Some(TrackedTarget {
                target_camera: TargetCamera::new(features).with_lens(camera.lens()),
                body: (others.find(world, &features.target))
                    .map_err(|e| at(format!("camera: parameter features.target: {e}")))?,
                camera: camera_frame(model).map_err(at)?.clone(),
            }),
        };
        let config = (controller.complete(controller.config.clone(), model, &tip))
            .map_err(|e| at(format!("controller: parameter {e}")))?;
        let carrier = (camera.goal_target.as_ref())
            .map(|body| others.find(world, body))
            .transpose()
            .map_err(|e| at(format!("camera: parameter goal.frame: {e}")))?;
        let more_tips = second_tip(model, &controller.second_tip_link)
            .map_err(|e| at(format!("controller: parameter {e}")))?;
        if camera.second_tip_link != controller.second_tip_link {
            return Err(at(format!(
                "the camera's second_tip_link is '{}' but the controller's is '{}'; they must be the same",
                camera.second_tip_link, controller.second_tip_link
            )));
        }
        let second = match (more_tips.first(), camera.second_goal) {
            (Some(tip), Some(goal)) => Some(SecondArm {
                tip: tip.clone(),
                camera: PoseCamera::new(second_camera(camera.quality.clone())),
                X_WD: with_matrix(&goal),
            }),
            (Some(_), None) => {
                return Err(at(
                    "camera: parameter second_goal.position is not given; a simulation needs a goal"
                        .to_owned(),
                ));
            }
            (None, _) => None,
        };
        let loop_config = ControlLoopConfig {
            timeout: controller.measurement_timeout,
            // Every state is answered at once, regardless of the age of the camera's frames.
            lockstep: false,
            compensates_delay: false,
        };
        let controller = Controller::with_tips(model.clone(), tip, more_tips, config)
            .map_err(|e| at(format!("controller: parameter {e}")))?;
        Ok(Self {
            control_loop: ControlLoop::new(controller, loop_config),
            carrier,
            second,
            camera: PoseCamera::new(camera.quality),
            kinematics: (world.robot.flexible()).map(|_| Workspace::new(model)),
            target,
            feature_frames: Vec::new(),
            X_FD: with_matrix(&goal),
            image: camera.image,
            was_limited: false,
        })
    }

    fn answer(
        &mut self,
        world: &mut World,
        others: &OtherBodies,
        frames: &mut Vec<PoseFrame>,
    ) -> Result<Answer<'_>, String> {
        // Values are rounded as by stamps and messages, noise included, so that a graph in lockstep gives an identical
        // run.
        let stamp = Time::from_secs_f64(world.time());
        let time = stamp.as_secs_f64();
        let gyro = gyro(world);
        let stamp = Stamp::from_nanos(stamp.as_nanos());
        let robot = &world.robot;
        // Like the camera node, the camera knows only the arm's kinematics and joint positions.
        if let Some(kinematics) = &mut self.kinematics {
            kinematics.set_positions(&robot.state().q);
        }
        let tip = self.control_loop.controller().tip();
        let true_X_BE = robot.X_BF(tip);
        let X_BE = (self.kinematics.as_ref()).map_or(true_X_BE, |arm| arm.X_BF(tip));
        let X_WB = message_round_trip(&robot.X_WB());
        let at = |e: String| format!("at {time:.2} s: {e}");
        let of_target = |body: Watched| {
            let X_WT = others.pose(world, body).map_err(at)?;
            Ok::<_, String>(message_round_trip(&X_WT))
        };
        let X_WF = self.carrier.map(of_target).transpose()?;
        let X_WD = X_WF.map_or(self.X_FD, |X_WF| X_WF * self.X_FD);
        let X_BD = X_WB.inverse() * X_WD;
        self.camera.show(time, &X_BE, Some(&X_BD));
        while let Some(frame) = self.camera.deliver(time) {
            frames.push(through_message(&frame));
        }
        self.feature_frames.clear();
        if let Some(tracked) = &mut self.target {
            let X_WC = X_WB * robot.X_BF(&tracked.camera);
            tracked
                .target_camera
                .show(time, &X_WC, &of_target(tracked.body)?);
            while let Some(frame) = tracked.target_camera.deliver(time) {
                self.feature_frames.push(frame);
            }
        }
        (self.feed(world, stamp, &X_WB, &gyro, frames)).map_err(|e| at(e.to_string()))?;
        let report = self.control_loop.step();
        let report = report.ok_or_else(|| at("no joint state is due".to_owned()))?;
        if let Err(e) = &report.control {
            return Err(at(e.to_string()));
        }
        let efforts = self.control_loop.efforts().as_slice();
        self.was_limited |= world.robot.hold_efforts(efforts);
        Ok(Answer {
            feature_frames: &self.feature_frames,
            report,
            error: PoseError::between(&true_X_BE, &X_BD),
            control_loop: &self.control_loop,
        })
    }

    /// Passes the current joint state, delivered camera frames and the gyro sample to the control loop.
    fn feed(
        &mut self,
        world: &World,
        stamp: Stamp,
        X_WB: &Pose,
        w_WB_B: &Vector3<f64>,
        frames: &[PoseFrame],
    ) -> Result<(), InputError> {
        let robot = &world.robot;
        let (q, qd) = (&robot.state().q, &robot.state().qd);
        let control_loop = &mut self.control_loop;
        control_loop.add_joint_state(stamp, q.as_slice(), qd.as_slice())?;
        for frame in frames {
            add_frame(control_loop, 0, frame)?;
        }
        if let Some(second) = &mut self.second {
            let time = stamp.as_secs_f64();
            let arm = self.kinematics.as_ref();
            let X_BE = arm.map_or_else(|| robot.X_BF(&second.tip), |arm| arm.X_BF(&second.tip));
            second.measure(time, X_WB, &X_BE, control_loop)?;
        }
        control_loop.add_gyro(stamp, *w_WB_B)
    }
}
