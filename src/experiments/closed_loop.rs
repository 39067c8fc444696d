//! Plant, camera and controller in one loop, without DDS.

use crate::{
    control::{Acted, Controller, PoseError},
    model::Frame,
    nodes::{
        camera::{Watch, camera_frame},
        dynamics::World,
        geometry::with_matrix,
        scenario::Scenario,
        tip_frame,
    },
    spatial::Pose,
    vision::{PoseCamera, PoseFrame, Sighting},
};

/// The loop of a scenario: what its nodes do over topics, done in one thread. Each state is shown to the
/// camera, the controller answers with what the camera has delivered, and the efforts are held until the
/// next state: the order of a graph in lockstep.
pub struct ClosedLoop {
    /// The plant.
    pub world: World,
    camera: PoseCamera,
    watch: Option<WatchedTarget>,
    sightings: Vec<Sighting>,
    controller: Controller,
    X_WD: Pose,
    seen: Option<PoseFrame>,
    measurement_timeout: f64,
    duration: f64,
    image: (u32, u32, f64),
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
    /// Frames of features that the camera delivered at this state.
    pub sightings: &'a [Sighting],
    /// What the controller did.
    pub acted: Acted,
    /// Age of the measurement that the controller used \[s\].
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
        let (dynamics, camera) = (scenario.dynamics()?, scenario.camera()?);
        let controller = scenario.controller()?;
        let at = |e: String| format!("{}: {e}", scenario.path().display());
        let world = World::new(&dynamics).map_err(at)?;
        let model = world.robot.model();
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
        Ok(Self {
            controller: Controller::new(model.clone(), tip, config)
                .map_err(|e| at(format!("controller: parameter {e}")))?,
            camera: PoseCamera::new(camera.quality),
            watch,
            sightings: Vec::new(),
            X_WD: with_matrix(&goal),
            seen: None,
            measurement_timeout: controller.measurement_timeout,
            duration: dynamics.duration,
            image: camera.image,
            world,
        })
    }

    /// The duration that the scenario gives \[s\]; zero is none.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Width, height and focal length of the camera's image \[px\].
    pub fn image(&self) -> (u32, u32, f64) {
        self.image
    }

    /// The goal in the world.
    pub fn X_WD(&self) -> &Pose {
        &self.X_WD
    }

    /// Pose of the tip in the base frame.
    pub fn X_BE(&self) -> Pose {
        self.world.robot.workspace().X_BF(self.controller.tip())
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
        let time = self.world.time();
        let robot = &self.world.robot;
        let X_BE = self.X_BE();
        let X_WB = robot.state().X_WB(robot.workspace());
        let X_BD = X_WB.inverse() * self.X_WD;
        self.camera.show(time, &X_BE, Some(&X_BD));
        frames.clear();
        while let Some(frame) = self.camera.deliver(time) {
            frames.push(frame);
        }
        self.sightings.clear();
        if let Some(watched) = &mut self.watch {
            let X_WC = X_WB * robot.workspace().X_BF(&watched.camera);
            let target = &self.world.targets[watched.index].body;
            let X_WT = target.state().X_WB(target.workspace());
            watched.watch.show(time, &X_WC, &X_WT);
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
        let pair = young.and_then(|frame| Some((&frame.X_BE, frame.X_BD.as_ref()?)));
        let state = robot.state();
        let acted = (self.controller.update(&state.q, &state.qd, pair))
            .map_err(|e| format!("at {time:.2} s: {e}"))?;
        self.world
            .robot
            .hold_efforts(self.controller.efforts().as_slice());
        let error = PoseError::between(&X_BE, &X_BD);
        let moment = Moment {
            frames,
            sightings: &self.sightings,
            acted,
            age,
            error,
            controller: &self.controller,
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
