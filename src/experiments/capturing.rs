//! A capture mission with its camera and estimator, in a single thread without DDS.

use fuyu_render::Distortion as Lens;
use nalgebra::{DVector, UnitQuaternion, Vector3};

use super::{EstimationLoop, GraspLoad};
use crate::{
    control::{
        GripperGoal,
        capture::{CaptureMission, GripWatch, Gripper, Sample},
    },
    dynamics::State,
    model::{Frame, Model},
    msg::fuyu_msgs::FeatureTracks,
    nodes::{
        camera::{TargetCamera, camera_frame, pinhole},
        dynamics::{FreeBody as _, World, imu},
        features::rectified,
        geometry::{message_round_trip, vector_from_msg, with_matrix},
        mission::{Actuators, Fingers, Grip, forecast},
        scenario::Scenario,
        tip_frame,
        topics::Topic,
    },
    ros::Time,
    spatial::Pose,
    vision::{Distortion, FeatureFrame, PoseCamera, PoseFrame},
};

/// Lens distortion as the estimator knows it; the node gets it from `CameraInfo`.
fn calibration(lens: Option<Lens>) -> Result<Option<Distortion>, String> {
    let Some((model, d)) = lens.map(|lens| lens.model()) else {
        return Ok(None);
    };
    Distortion::new(model, &d).map_err(|e| e.to_string())
}

/// A mission with its camera and estimator.
pub struct Capturing {
    mission: CaptureMission,
    grip: SimulatedGrip,
    /// Index of each joint of the arm among the robot's joints.
    joints: Vec<usize>,
    camera: PoseCamera,
    target_camera: TargetCamera,
    /// Lens distortion of the target camera, for the estimator.
    lens: Option<Distortion>,
    estimator: EstimationLoop,
    tip: Frame,
    optical: Frame,
    /// Index of the target.
    target: usize,
    X_TG: Pose,
    /// Size and focal length of the camera's image \[px\].
    pub(super) image: (u32, u32, f64),
    features: Vec<FeatureFrame>,
    predictions: Vec<crate::msg::nav_msgs::Path>,
    gripper: Gripper,
    actuators: Actuators,
    pushes: bool,
    /// How long a couple on the base acts without a new one \[s\].
    couple_timeout: f64,
    load: GraspLoad,
}

/// How the grasp is closed and opened.
enum SimulatedGrip {
    Automatic,
    Services,
    Fingers {
        /// Index among the dynamics node's grippers.
        index: usize,
        /// Index of its joint among the robot's joints.
        joint: usize,
        fingers: Fingers,
        watch: GripWatch,
    },
}

impl SimulatedGrip {
    fn new(grip: &Grip, scenario: &Scenario, robot: &Model) -> Result<Self, String> {
        let fingers = match grip {
            Grip::Automatic => return Ok(Self::Automatic),
            Grip::Services => return Ok(Self::Services),
            Grip::Fingers(fingers) => fingers.clone(),
        };
        let grippers = scenario.dynamics()?.grippers;
        let index = grippers
            .iter()
            .position(|gripper| gripper.name == fingers.name);
        let index = index.ok_or_else(|| {
            let names: Vec<_> = grippers.iter().map(|g| g.name.as_str()).collect();
            format!(
                "mission: parameter gripper is '{}'; the dynamics node's grippers are {names:?}",
                fingers.name
            )
        })?;
        if grippers[index].joint != fingers.joint {
            return Err(format!(
                "mission: parameter gripper_joint is '{}'; the joint of gripper '{}' is '{}'",
                fingers.joint, fingers.name, grippers[index].joint
            ));
        }
        let joint = robot.joint_index(&fingers.joint);
        let joint = joint.ok_or("mission: the robot lacks the joint of the gripper")?;
        Ok(Self::Fingers {
            index,
            joint,
            watch: fingers.watch(),
            fingers,
        })
    }

    /// Whether the fingers hold something, if known.
    fn see(&mut self, time: f64, state: &State) -> Option<bool> {
        match self {
            Self::Fingers { joint, watch, .. } => {
                watch.see(time, state.q[*joint], state.qd[*joint])
            }
            Self::Automatic | Self::Services => None,
        }
    }
}

/// The mission's answer to a state.
pub struct CaptureAnswer<'a> {
    /// Frames of features that the camera delivered.
    pub feature_frames: &'a [FeatureFrame],
    /// Predictions of the estimator.
    pub predictions: &'a [crate::msg::nav_msgs::Path],
    /// The mission.
    pub mission: &'a CaptureMission,
    /// Joint efforts that it commands.
    pub efforts: Vec<f64>,
    /// Couple on the base \[N m\], if it commands one.
    pub couple: Option<Vector3<f64>>,
    /// Wheels and thrusters in use.
    pub actuators: &'a Actuators,
    /// Motor torques of the wheels in use.
    pub wheel_torques: Vec<f64>,
    /// On-times of the thrusters in use, if commanded.
    pub on_times: Option<Vec<f64>>,
}

impl Capturing {
    /// The mission of a scenario with the nodes camera, estimator and mission.
    ///
    /// # Errors
    /// A line that names file, node and parameter.
    pub fn new(scenario: &Scenario, world: &World) -> Result<Self, String> {
        let at = |e: String| format!("{}: {e}", scenario.path().display());
        let (camera, params) = (scenario.camera()?, scenario.mission()?);
        let model = world.robot.model();
        let tip = tip_frame(model, &params.tip_link)
            .map_err(|e| at(format!("mission: parameter {e}")))?;
        let mission = params
            .mission(model)
            .map_err(|e| at(format!("mission: {e}")))?;
        let missing = |what: &str| {
            at(format!(
                "camera: parameter {what} is not given; a mission needs it"
            ))
        };
        let carrier = camera
            .goal_target
            .as_ref()
            .ok_or_else(|| missing("goal.frame"))?;
        let goal = camera
            .goal
            .as_ref()
            .ok_or_else(|| missing("goal.position"))?;
        let features = camera
            .features
            .as_ref()
            .ok_or_else(|| missing("features.target"))?;
        let target = world
            .target_index(carrier)
            .map_err(|e| at(format!("camera: parameter goal.frame: {e}")))?;
        let optical = camera_frame(model).map_err(at)?.clone();
        let lens = camera.lens();
        let R_BC = UnitQuaternion::from_rotation_matrix(&world.robot.X_BF(&optical).rotation);
        Ok(Self {
            grip: SimulatedGrip::new(&params.grip, scenario, model).map_err(at)?,
            joints: (mission.model().joints().iter())
                .filter_map(|joint| model.joint_index(&joint.name))
                .collect(),
            mission,
            target_camera: TargetCamera::new(features).with_lens(lens),
            lens: calibration(lens).map_err(at)?,
            estimator: EstimationLoop::new(
                scenario.estimator()?,
                pinhole(camera.image),
                &model.frames()[0].name,
                R_BC,
            ),
            X_TG: with_matrix(goal),
            image: camera.image,
            camera: PoseCamera::new(camera.quality),
            tip,
            optical,
            target,
            features: Vec::new(),
            predictions: Vec::new(),
            gripper: Gripper::Open,
            actuators: params.actuators,
            pushes: false,
            couple_timeout: scenario.dynamics()?.motions.wrench_timeout,
            load: GraspLoad::default(),
        })
    }

    /// The mission.
    pub fn mission(&self) -> &CaptureMission {
        &self.mission
    }

    /// Wheels and thrusters in use.
    pub fn actuators(&self) -> &Actuators {
        &self.actuators
    }

    /// Index of the target among those of the world.
    pub fn target(&self) -> usize {
        self.target
    }

    /// Topic on which the camera publishes features.
    pub fn topic_of_features(&self) -> Topic<FeatureTracks> {
        self.target_camera.topic()
    }

    /// The load on the grasp.
    pub fn load(&self) -> &GraspLoad {
        &self.load
    }

    /// Passes the current state to camera, estimator and mission.
    ///
    /// # Errors
    /// A line with the time.
    pub fn answer(
        &mut self,
        world: &mut World,
        frames: &mut Vec<PoseFrame>,
    ) -> Result<CaptureAnswer<'_>, String> {
        let is_closed = self.gripper == Gripper::Close;
        self.load.see(world, self.target, &self.tip, is_closed);
        let stamp = Time::from_secs_f64(world.time());
        let time = stamp.as_secs_f64();
        let at = |e: String| format!("at {time:.2} s: mission: {e}");
        let base = world.robot.model().frames()[0].name.clone();
        let imu = imu(stamp, &base, world);
        let w_B = vector_from_msg(&imu.angular_velocity);
        let X_WB = message_round_trip(&world.robot.X_WB());
        let X_WT = message_round_trip(&world.targets[self.target].body.X_WB());
        let X_BE = world.robot.X_BF(&self.tip);
        self.camera
            .show(time, &X_BE, Some(&(X_WB.inverse() * X_WT * self.X_TG)));
        while let Some(frame) = self.camera.deliver(time) {
            if let Some(X_BG) = &frame.X_BD {
                self.mission
                    .add_grasp_pose(frame.time, message_round_trip(X_BG));
            }
            frames.push(frame);
        }
        self.estimator.add_imu(&imu).map_err(at)?;
        self.features.clear();
        self.predictions.clear();
        let X_WC = X_WB * world.robot.X_BF(&self.optical);
        self.target_camera.show(time, &X_WC, &X_WT);
        while let Some(frame) = self.target_camera.deliver(time) {
            // A held target no longer moves freely.
            if self.mission.payload().is_none()
                && let Some(path) = self.estimator.add_frame(rectified(
                    frame.clone(),
                    &pinhole(self.image),
                    self.lens.as_ref(),
                ))
            {
                self.mission.add_forecast(forecast(&path).map_err(at)?);
                self.predictions.push(path);
            }
            self.features.push(frame);
        }
        let state = world.robot.state();
        let of = |values: &DVector<f64>| self.joints.iter().map(|j| values[*j]).collect();
        let (q, qd): (Vec<f64>, Vec<f64>) = (of(&state.q), of(&state.qd));
        if self.gripper == Gripper::Close
            && let Some(holds) = self.grip.see(time, state)
        {
            self.mission.set_grip(Some(holds));
        }
        let wheel_speeds = match world.robot.flexible() {
            Some(robot) if self.actuators.has_wheels() => robot.state().wheel_speeds(),
            _ => &[],
        };
        let sample = Sample {
            time,
            q: &q,
            qd: &qd,
            w_B,
            wheel_speeds,
        };
        let command = self.mission.step(&sample).map_err(|e| at(e.to_string()))?;
        let (efforts, couple) = (command.efforts.to_vec(), command.couple);
        let wheel_torques = command.wheel_torques.to_vec();
        let on_times = command.on_times.map(<[f64]>::to_vec);
        let gripper = command.gripper;
        world.hold_efforts(self.joints.iter().copied().zip(efforts.iter().copied()));
        if self.actuators.has_wheels() {
            world.hold_wheel_torques(wheel_torques.iter().copied().enumerate());
        }
        if let Some(on_times) = &on_times {
            world.fire(on_times.iter().copied().enumerate());
        }
        let pushes = couple.norm() > 0.0 && !self.actuators.has_thrusters();
        let couple = (pushes || self.pushes).then_some(couple);
        self.pushes = pushes;
        if let Some(couple) = couple {
            world.hold_couple(couple, self.couple_timeout).map_err(at)?;
        }
        if gripper != self.gripper {
            self.gripper = gripper;
            self.follow_gripper(world);
        }
        Ok(CaptureAnswer {
            feature_frames: &self.features,
            predictions: &self.predictions,
            mission: &self.mission,
            efforts,
            couple,
            actuators: &self.actuators,
            wheel_torques,
            on_times,
        })
    }

    /// Executes the gripper command, unless the grasp latches automatically.
    fn follow_gripper(&mut self, world: &mut World) {
        let is_closing = self.gripper == Gripper::Close;
        self.mission.set_grip(None);
        match &mut self.grip {
            SimulatedGrip::Fingers {
                index,
                fingers,
                watch,
                ..
            } => {
                watch.restart();
                let max_effort = match fingers.effort {
                    0.0 => f64::INFINITY,
                    effort => effort,
                };
                let position = fingers.position(self.gripper);
                world.set_gripper_goal(
                    *index,
                    GripperGoal {
                        max_effort,
                        ..GripperGoal::at(position)
                    },
                );
            }
            SimulatedGrip::Services if is_closing => {
                let holds = world.attach().is_ok();
                self.mission.set_grip(Some(holds));
            }
            SimulatedGrip::Automatic if is_closing => {}
            SimulatedGrip::Services | SimulatedGrip::Automatic => {
                // Fails if nothing is held.
                let _ = world.detach();
            }
        }
    }
}
