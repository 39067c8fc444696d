//! Plant, camera and controller in one loop, without DDS.

use super::{Drive, Operated};
use crate::{
    control::{ControlReport, Controller, Measurement, PoseError, TipMeasurement},
    dynamics::Workspace,
    model::Frame,
    nodes::{
        camera::{Watch, camera_frame, second_camera},
        controller::second_tip,
        dynamics::{World, imu},
        geometry::{told, vector_from_msg, with_matrix},
        scenario::Scenario,
        tip_frame,
    },
    ros::Time,
    spatial::Pose,
    vision::{PoseCamera, PoseFrame, Sighting},
};

/// The loop of a scenario: what its nodes do over topics, done in one thread. Each state is shown to the
/// camera, the controller answers with what the camera has delivered, and the efforts are held until the
/// next state: the order of a graph in lockstep. Where a scenario names a teleop node, a simulated operator steers.
/// A scenario that names neither camera nor controller nor teleop is a free motion, under springs and dampers alone.
pub struct ClosedLoop {
    /// The plant.
    pub world: World,
    servo: Option<Servo>,
    operated: Option<Operated>,
    duration: f64,
}

/// Camera and controller.
struct Servo {
    camera: PoseCamera,
    watch: Option<WatchedTarget>,
    sightings: Vec<Sighting>,
    controller: Controller,
    /// The goal in its frame.
    X_FD: Pose,
    /// Which of the world's targets is that frame; `None` for the world itself.
    carrier: Option<usize>,
    second: Option<SecondArm>,
    seen: Option<PoseFrame>,
    measurement_timeout: f64,
    image: (u32, u32, f64),
}

/// What the camera sees of a second arm.
struct SecondArm {
    tip: Frame,
    camera: PoseCamera,
    X_WD: Pose,
    seen: Option<TipMeasurement>,
}

/// The target that the camera tracks.
struct WatchedTarget {
    watch: Watch,
    /// Which of the world's targets.
    index: usize,
    /// The camera's frame.
    camera: Frame,
}

/// One state and how it was answered.
pub struct Moment<'a> {
    /// Frames that the camera delivered at this state.
    pub frames: &'a [PoseFrame],
    /// What the controller did, if there is one.
    pub answer: Option<Answer<'a>>,
    /// What the operator did, if there is one.
    pub drive: Option<Drive<'a>>,
}

/// What the controller did with a state.
pub struct Answer<'a> {
    /// Frames of features that the camera delivered at this state.
    pub sightings: &'a [Sighting],
    /// The kind of measurement that it acted on.
    pub report: ControlReport,
    /// Age of the measurement that it used \[s\].
    pub age: f64,
    /// True deviation of the tip from the goal.
    pub error: PoseError,
    /// The controller, with the efforts of this moment.
    pub controller: &'a Controller,
}

impl ClosedLoop {
    /// The loop that `scenario` describes.
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
        let steered = scenario.has("camera") && operated.is_none();
        let servo = if steered || scenario.has("controller") {
            Some(Servo::new(scenario, &world)?)
        } else {
            None
        };
        Ok(Self {
            world,
            servo,
            operated,
            duration: dynamics.duration,
        })
    }

    /// The duration that the scenario gives \[s\]; zero is none.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Width, height and focal length of the camera's image \[px\]; `None` in a free motion.
    pub fn image(&self) -> Option<(u32, u32, f64)> {
        self.servo.as_ref().map(|servo| servo.image)
    }

    /// Whether an operator steers.
    pub fn is_operated(&self) -> bool {
        self.operated.is_some()
    }

    /// Whether the camera tracks feature points of a target.
    pub fn watches_target(&self) -> bool {
        let watch = self.servo.as_ref().and_then(|servo| servo.watch.as_ref());
        watch.is_some()
    }

    /// Lets camera and controller answer the present state; `look` sees the moment, with the new efforts
    /// acting but time not yet gone on.
    ///
    /// # Errors
    /// Says why the controller gives no efforts, or what `look` refuses.
    pub fn answer<E: From<String>>(
        &mut self,
        frames: &mut Vec<PoseFrame>,
        look: impl FnOnce(&mut World, &Moment) -> Result<(), E>,
    ) -> Result<(), E> {
        frames.clear();
        let answer = match &mut self.servo {
            Some(servo) => Some(servo.answer(&mut self.world, frames)?),
            None => None,
        };
        let operated = self.operated.as_mut();
        let drive = operated.map(|operated| operated.answer(&mut self.world));
        let moment = Moment {
            frames,
            answer,
            drive,
        };
        look(&mut self.world, &moment)
    }

    /// Goes on to the next state.
    ///
    /// # Errors
    /// When the state is no longer finite.
    pub fn advance(&mut self) -> Result<(), String> {
        self.world.step_to_tick();
        self.world.check_finite()
    }
}

impl SecondArm {
    /// What has been seen of it last.
    fn look(&mut self, time: f64, X_WB: &Pose, workspace: &Workspace) -> Option<TipMeasurement> {
        let X_BE = workspace.X_BF(&self.tip);
        self.camera
            .show(time, &X_BE, Some(&(X_WB.inverse() * self.X_WD)));
        while let Some(PoseFrame { time, X_BE, X_BD }) = self.camera.deliver(time) {
            self.seen = X_BD.map(|X_BD| TipMeasurement::new(time, told(&X_BE), told(&X_BD)));
        }
        self.seen
    }
}

impl Servo {
    fn new(scenario: &Scenario, world: &World) -> Result<Self, String> {
        let model = world.robot.model();
        let (camera, controller) = (scenario.camera()?, scenario.controller()?);
        let at = |e: String| format!("{}: {e}", scenario.path().display());
        let tip = tip_frame(model, &controller.tip_link)
            .map_err(|e| at(format!("controller: parameter {e}")))?;
        let seen_tip =
            tip_frame(model, &camera.tip_link).map_err(|e| at(format!("camera: parameter {e}")))?;
        if seen_tip.name != tip.name {
            return Err(at(format!(
                "the camera's tip_link is '{}' but the controller's is '{}'; they must be the same",
                seen_tip.name, tip.name
            )));
        }
        let goal = camera.goal.ok_or_else(|| {
            at(
                "camera: parameter goal.position is not given; a simulation needs a goal"
                    .to_owned(),
            )
        })?;
        let watch = match &camera.features {
            None => None,
            Some(features) => Some(WatchedTarget {
                watch: Watch::new(features),
                index: (world.target_index(&features.target))
                    .map_err(|e| at(format!("camera: parameter features.target: {e}")))?,
                camera: camera_frame(model).map_err(at)?.clone(),
            }),
        };
        let config = controller.config.clone();
        let carrier = (camera.goal_target.as_ref())
            .map(|target| world.target_index(target))
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
                seen: None,
            }),
            (Some(_), None) => {
                return Err(at(
                    "camera: parameter second_goal.position is not given; a simulation needs a goal"
                        .to_owned(),
                ));
            }
            (None, _) => None,
        };
        Ok(Self {
            controller: Controller::with_tips(model.clone(), tip, more_tips, config)
                .map_err(|e| at(format!("controller: parameter {e}")))?,
            carrier,
            second,
            camera: PoseCamera::new(camera.quality),
            watch,
            sightings: Vec::new(),
            X_FD: with_matrix(&goal),
            seen: None,
            measurement_timeout: controller.measurement_timeout,
            image: camera.image,
        })
    }

    fn answer(
        &mut self,
        world: &mut World,
        frames: &mut Vec<PoseFrame>,
    ) -> Result<Answer<'_>, String> {
        // As stamps and messages tell it in a graph, noise and all, so that a run there in lockstep is this one.
        let time = Time::from_secs_f64(world.time()).as_secs_f64();
        let gyro = imu(Time::from_secs_f64(time), "", world).angular_velocity;
        let w_WB_B = vector_from_msg(&gyro);
        let robot = &world.robot;
        let X_BE = robot.workspace().X_BF(self.controller.tip());
        let X_WB = told(&robot.state().X_WB(robot.workspace()));
        let of_target = |index: usize| {
            let target = &world.targets[index].body;
            told(&target.state().X_WB(target.workspace()))
        };
        let X_WF = self.carrier.map_or_else(Pose::identity, of_target);
        let X_BD = X_WB.inverse() * (X_WF * self.X_FD);
        self.camera.show(time, &X_BE, Some(&X_BD));
        while let Some(frame) = self.camera.deliver(time) {
            frames.push(PoseFrame {
                X_BE: told(&frame.X_BE),
                X_BD: frame.X_BD.as_ref().map(told),
                ..frame
            });
        }
        self.sightings.clear();
        if let Some(watched) = &mut self.watch {
            let X_WC = X_WB * robot.workspace().X_BF(&watched.camera);
            watched.watch.show(time, &X_WC, &of_target(watched.index));
            while let Some(sighting) = watched.watch.deliver(time) {
                self.sightings.push(sighting);
            }
        }
        self.seen = frames.last().copied().or(self.seen);
        let age = self
            .seen
            .as_ref()
            .map_or(f64::INFINITY, |frame| time - frame.time);
        let young = self
            .seen
            .as_ref()
            .filter(|_| age <= self.measurement_timeout);
        let sight =
            young.and_then(|frame| Some(TipMeasurement::new(frame.time, frame.X_BE, frame.X_BD?)));
        let more_tips = [(self.second.as_mut())
            .and_then(|second| second.look(time, &X_WB, robot.workspace()))
            .filter(|sight| time - sight.time <= self.measurement_timeout)];
        let state = robot.state();
        let seen = Measurement {
            more_tips: &more_tips,
            ..Measurement::new(time, &state.q, &state.qd)
        };
        let seen = seen.with_tip(sight.as_ref()).with_gyro(Some(&w_WB_B));
        let report = (self.controller.update(&seen)).map_err(|e| format!("at {time:.2} s: {e}"))?;
        let efforts = self.controller.efforts().as_slice();
        world.robot.hold_efforts(efforts);
        Ok(Answer {
            sightings: &self.sightings,
            report,
            age,
            error: PoseError::between(&X_BE, &X_BD),
            controller: &self.controller,
        })
    }
}
