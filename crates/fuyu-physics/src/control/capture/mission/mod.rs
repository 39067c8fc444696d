//! The mission: a state machine from measurements to joint efforts, couple and gripper.

mod approach;
mod command;
mod config;
mod grasp;
mod joints;
mod measuring;
mod report;
mod search;
mod stabilise;

pub use command::{Command, Gripper, MissionError, Sample};
pub use config::CaptureConfig;
pub use report::{Phase, PhaseFigure, PhaseReport};

use std::collections::VecDeque;

use nalgebra::{DVector, UnitQuaternion, Vector3};

use super::Clearance;
use super::FrameMotion;
use super::detumble::Detumbler;
use super::own_motion::OwnMotion;
use super::payload::with_payload;
use super::plan::Plan;
use super::rendezvous::RendezvousPlanner;
use super::rotation_forecast::RotationForecast;
use super::target_track::TargetTrack;
use super::thruster_pulses::ThrusterPulses;
use super::tip_impedance::TipImpedance;
use crate::control::attitude::WheelAllocator;
use crate::control::commander::{JointPoint, JointServo, JointSpline};
use crate::control::gains::ConfigError;
use crate::dynamics::Workspace;
use crate::model::{Frame, Model};
use crate::spatial::{InertiaError, Pose, RigidInertia};

/// Longest time between two samples that counts as waiting time \[s\].
const LONGEST_PERIOD: f64 = 0.5;

/// Robot and target after the grasp.
#[derive(Debug, Clone)]
pub(super) struct Held {
    pub payload: RigidInertia,
    pub is_identified: bool,
    pub servo: JointServo,
    pub workspace: Workspace,
    /// Measured pose of the grasp frame in the tip's frame when it was grasped.
    pub X_EG: Option<Pose>,
}

/// The present activity.
#[derive(Debug, Clone)]
pub(super) enum Stage {
    Observe,
    Plan(Box<search::Search>),
    Approach {
        plan: Box<Plan>,
        /// Time of the last planning \[s\].
        planned: f64,
    },
    /// The tip moves along the approach axis, in the frame of the target.
    Close(grasp::Closing),
    /// Test pull, to check whether the target is held.
    Pull(grasp::Pull),
    /// Joints come to rest; then the next activity starts.
    Stop(Box<JointSpline>, AfterStop),
    Detumble(stabilise::Detumbling),
    Identify(stabilise::Identifying),
    /// Joints are held at the reference.
    Rest,
}

/// Activity after the joints have stopped.
#[derive(Debug, Clone)]
pub(super) enum AfterStop {
    /// Plan again, for this reason.
    Plan(String),
    Abort(String),
}

/// Captures a target. The mission has no clock: every [`CaptureMission::step`] receives time and measurements.
#[derive(Debug, Clone)]
pub struct CaptureMission {
    config: CaptureConfig,
    model: Model,
    tip: Frame,
    /// Attitude of the camera in the base frame.
    R_BC: UnitQuaternion<f64>,
    own: OwnMotion,
    track: TargetTrack,
    planner: RendezvousPlanner,
    servo: JointServo,
    impedance: TipImpedance,
    held: Option<Held>,
    /// Index of the chosen grasp frame.
    grasp: usize,
    stage: Stage,
    reports: Vec<PhaseReport>,
    reference: Vec<JointPoint>,
    /// Forecasts (in the camera's axes at their start) that wait for the base's attitude at that time.
    forecasts: VecDeque<RotationForecast>,
    /// Measured grasp poses (in the base frame) that wait for the base's pose at that time.
    poses: VecDeque<(f64, Pose)>,
    /// Measured poses of the grasp frame in the tip's frame.
    relative: VecDeque<(f64, Pose)>,
    is_paused: bool,
    skips: bool,
    abort_requested: bool,
    /// Whether the operator has ended observation before the prediction was accurate enough, and accepts the risk.
    accepts_uncertainty: bool,
    /// Whether the gripper holds the target, if it reports that.
    grip: Option<bool>,
    attempt: u32,
    /// Time of the last sample \[s\].
    last: Option<f64>,
    /// Time waited for a prediction and a plan, without pauses \[s\].
    waited: f64,
    /// Number of interruptions of the approach, not counting pauses.
    interruptions: u32,
    detumbler: Detumbler,
    thrusters: Option<ThrusterPulses>,
    /// Speeds of the wheels \[rad/s\].
    wheel_speeds: Vec<f64>,
    /// The condition for which the mission waits.
    note: String,
    efforts: DVector<f64>,
    /// External couple on the base, base axes \[N m\].
    couple: Vector3<f64>,
    /// Common centre of mass of robot and target, base axes \[m\], while a couple acts.
    p_BC: Vector3<f64>,
    gripper: Gripper,
}

impl CaptureMission {
    /// A mission for a robot with its tip; `camera` is the frame in whose axes forecasts are given.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn new(
        model: &Model,
        tip: &Frame,
        camera: &Frame,
        config: CaptureConfig,
    ) -> Result<Self, ConfigError> {
        let n = model.dof();
        config.check(n)?;
        let clearance = Clearance::new(model, tip, config.clearance);
        let mut workspace = Workspace::new(model);
        workspace.set_positions(&DVector::zeros(n));
        let X_BC = workspace.X_BF(camera);
        Ok(Self {
            R_BC: UnitQuaternion::from_rotation_matrix(&X_BC.rotation),
            own: OwnMotion::new(model, tip),
            track: TargetTrack::new(config.track),
            planner: RendezvousPlanner::new(model, tip, clearance, config.limits)
                .with_objective(config.objective, &config.approach_axis),
            servo: JointServo::new(model, config.joint_bandwidth),
            impedance: TipImpedance::new(model, tip, config.tip_law),
            held: None,
            grasp: 0,
            stage: Stage::Observe,
            reports: Vec::new(),
            reference: Vec::new(),
            forecasts: VecDeque::new(),
            poses: VecDeque::new(),
            relative: VecDeque::new(),
            is_paused: false,
            skips: false,
            abort_requested: false,
            accepts_uncertainty: false,
            grip: None,
            attempt: 0,
            last: None,
            waited: 0.0,
            interruptions: 0,
            detumbler: Detumbler::new(config.detumble, stabilise::TIME_CONSTANT),
            thrusters: None,
            wheel_speeds: Vec::new(),
            note: String::new(),
            efforts: DVector::zeros(n),
            couple: Vector3::zeros(),
            p_BC: Vector3::zeros(),
            gripper: Gripper::Open,
            model: model.clone(),
            tip: tip.clone(),
            config,
        })
    }

    /// Adds wheels of the base, which take as much momentum of robot and target as they can.
    pub fn with_wheels(mut self, wheels: WheelAllocator) -> Self {
        self.wheel_speeds = vec![0.0; wheels.wheels().len()];
        self.detumbler = self.detumbler.with_wheels(wheels);
        self
    }

    /// Adds thrusters of the base, whose pulses give the external couple.
    pub fn with_thrusters(mut self, thrusters: ThrusterPulses) -> Self {
        self.thrusters = Some(thrusters);
        self
    }

    /// The settings.
    pub fn config(&self) -> &CaptureConfig {
        &self.config
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Motion of the target, as far as known.
    pub fn track(&self) -> &TargetTrack {
        &self.track
    }

    /// Pose of the chosen grasp frame in the measured grasp frame.
    pub fn X_GK(&self) -> &Pose {
        &self.config.grasps[self.grasp]
    }

    /// Predicted motion of the chosen grasp frame in I.
    fn goal(&self, time: f64) -> Option<FrameMotion> {
        Some(self.track.at(time)?.of_fixed(self.X_GK()))
    }

    /// Chooses a grasp frame.
    fn choose(&mut self, grasp: usize) {
        if grasp != self.grasp {
            self.grasp = grasp;
            self.relative.clear();
        }
    }

    /// The present phase; observation before the first step.
    pub fn phase(&self) -> Phase {
        self.reports.last().map_or(Phase::Observe, |r| r.phase)
    }

    /// Reports of all phases so far, the present one last.
    pub fn reports(&self) -> &[PhaseReport] {
        &self.reports
    }

    /// End of the mission \[s\], if it is over.
    pub fn ended(&self) -> Option<f64> {
        let last = self.reports.last()?;
        last.phase.is_over().then_some(last.start)
    }

    /// Whether [`CaptureMission::abort`] has been called.
    pub fn is_aborted_on_request(&self) -> bool {
        self.abort_requested
    }

    /// Reason of the abort, if the mission was aborted.
    pub fn abort_reason(&self) -> Option<&str> {
        let last = self.reports.last()?;
        (last.phase == Phase::Aborted).then_some(last.outcome.as_str())
    }

    /// The condition for which the mission waits, as a line; empty if it does not wait.
    pub fn waits_for(&self) -> &str {
        match self.stage {
            Stage::Observe | Stage::Plan(_) => &self.note,
            _ => "",
        }
    }

    /// Whether an operator has paused the mission.
    pub fn is_paused(&self) -> bool {
        self.is_paused
    }

    /// The target's mass, centre of mass and inertia in the tip's frame: assumed or identified; `None` before the
    /// grasp.
    pub fn payload(&self) -> Option<&RigidInertia> {
        self.held.as_ref().map(|held| &held.payload)
    }

    /// Whether the payload is the identified one.
    pub fn is_identified(&self) -> bool {
        self.held.as_ref().is_some_and(|held| held.is_identified)
    }

    /// The plan that is being followed.
    pub fn plan(&self) -> Option<&Plan> {
        match &self.stage {
            Stage::Approach { plan, .. } => Some(plan),
            _ => None,
        }
    }

    /// Progress of the present phase, from 0 to 1.
    pub fn progress(&self) -> f64 {
        let time = self.own.state().time;
        let share = match &self.stage {
            Stage::Observe => self.track.span() / self.config.observe_time,
            Stage::Plan(_) | Stage::Stop(..) => 0.0,
            Stage::Approach { plan, .. } => {
                // A plan starts where it was last replanned.
                let start = self
                    .reports
                    .last()
                    .map_or(plan.start, |report| report.start);
                (time - start) / (plan.arrival - start)
            }
            Stage::Close(closing) => 0.7 * closing.progress(),
            Stage::Pull(pull) => 0.7 + 0.3 * pull.progress(time),
            Stage::Detumble(detumbling) => detumbling.progress(),
            Stage::Identify(identifying) => identifying.progress(time),
            Stage::Rest => 1.0,
        };
        share.clamp(0.0, 1.0)
    }

    /// Adds a measured pose of the grasp frame in the base frame, exposed at `time` \[s\].
    pub fn add_grasp_pose(&mut self, time: f64, X_BG: Pose) {
        self.poses.push_back((time, X_BG));
        if self.poses.len() > 1000 {
            self.poses.pop_front();
        }
    }

    /// Adds a forecast of attitudes in the camera's axes at its start.
    pub fn add_forecast(&mut self, forecast: RotationForecast) {
        self.forecasts.push_back(forecast);
        if self.forecasts.len() > 10 {
            self.forecasts.pop_front();
        }
    }

    /// Sets the gripper's report whether it holds the target. Without a report the arm tests the grasp by pulling.
    pub fn set_grip(&mut self, holds: Option<bool>) {
        self.grip = holds;
    }

    /// Pauses the mission: the arm stops, or keeps its distance from the target; no couple acts.
    ///
    /// # Errors
    /// [`MissionError::Over`].
    pub fn hold(&mut self) -> Result<(), MissionError> {
        self.check_not_over()?;
        self.is_paused = true;
        Ok(())
    }

    /// Ends a pause.
    ///
    /// # Errors
    /// [`MissionError::Over`].
    pub fn resume(&mut self) -> Result<(), MissionError> {
        self.check_not_over()?;
        self.is_paused = false;
        Ok(())
    }

    /// Ends the present phase early: observation (the arm then approaches although the prediction is uncertain),
    /// detumbling or identification.
    ///
    /// # Errors
    /// [`MissionError`].
    pub fn skip(&mut self) -> Result<(), MissionError> {
        self.check_not_over()?;
        match self.phase() {
            Phase::Observe | Phase::Detumble | Phase::Identify => {
                self.skips = true;
                Ok(())
            }
            phase => Err(MissionError::NotSkippable(phase.name())),
        }
    }

    /// Aborts the mission: the tip retreats if it is close to the target, then the joints stop. A held target remains
    /// held.
    ///
    /// # Errors
    /// [`MissionError::Over`].
    pub fn abort(&mut self, reason: &str) -> Result<(), MissionError> {
        self.check_not_over()?;
        self.abort_requested = true;
        self.is_paused = false;
        let reason = reason.to_owned();
        self.stage = match std::mem::replace(&mut self.stage, Stage::Rest) {
            Stage::Close(closing) => Stage::Close(closing.retreat(&self.config, Some(reason))),
            Stage::Pull(pull) => {
                let time = self.last.unwrap_or_default();
                Stage::Close(pull.retreat(&self.config, time, Some(reason)))
            }
            _ => self.stop(AfterStop::Abort(reason)),
        };
        Ok(())
    }

    fn check_not_over(&self) -> Result<(), MissionError> {
        match self.phase() {
            phase if phase.is_over() => Err(MissionError::Over(phase.name())),
            _ => Ok(()),
        }
    }

    /// Processes a sample and returns the commands.
    ///
    /// # Errors
    /// [`MissionError::Sample`].
    pub fn step(&mut self, sample: &Sample) -> Result<Command<'_>, MissionError> {
        let n = self.model.dof();
        let wheels = self.wheel_speeds.len();
        let refuse = |problem| MissionError::Sample {
            joints: n,
            wheels,
            problem,
        };
        if sample.q.len() != n || sample.qd.len() != n {
            return Err(refuse("another number of joints"));
        }
        if sample.wheel_speeds.len() != wheels {
            return Err(refuse("another number of wheels"));
        }
        let values = sample.q.iter().chain(sample.qd).chain(sample.w_B.iter());
        let values = values.chain(sample.wheel_speeds);
        if !values.chain([&sample.time]).all(|x| x.is_finite()) {
            return Err(refuse("a value is not finite"));
        }
        let Sample { time, q, qd, .. } = *sample;
        self.wheel_speeds.copy_from_slice(sample.wheel_speeds);
        let restarted = self.own.add(time, q, qd, &sample.w_B);
        let before = self.last.replace(time);
        let waits = matches!(self.stage, Stage::Observe | Stage::Plan(_)) && !self.is_paused;
        if waits && let Some(before) = before {
            self.waited += (time - before).clamp(0.0, LONGEST_PERIOD);
        }
        if before.is_none() {
            self.reports = vec![PhaseReport::begin(Phase::Observe, time)];
            self.hold_here();
        } else if restarted {
            self.track.clear();
            self.relative.clear();
        }
        self.take_measurements(time);
        self.couple = Vector3::zeros();
        self.detumbler.release();
        let stage = std::mem::replace(&mut self.stage, Stage::Rest);
        self.stage = match stage {
            Stage::Observe => self.observe(time),
            Stage::Plan(search) => self.search(time, search),
            Stage::Approach { plan, planned } => self.approach(time, plan, planned),
            Stage::Close(closing) => self.close_in(time, closing),
            Stage::Pull(pull) => self.pull(time, pull),
            Stage::Stop(spline, then) => self.come_to_rest(time, spline, then),
            Stage::Detumble(detumbling) => self.detumble(time, detumbling),
            Stage::Identify(identifying) => self.identify(time, identifying),
            Stage::Rest => {
                self.track_reference();
                Stage::Rest
            }
        };
        if !self.efforts.iter().all(|x| x.is_finite()) {
            self.efforts.fill(0.0);
        }
        let (couple, p_BC) = (&self.couple, &self.p_BC);
        let thrusters = self.thrusters.as_mut();
        Ok(Command {
            efforts: self.efforts.as_slice(),
            couple: *couple,
            wheel_torques: self.detumbler.wheel_torques(),
            on_times: thrusters.and_then(|pulses| pulses.follow(time, couple, p_BC)),
            gripper: self.gripper,
        })
    }

    /// Ends the present phase and begins another.
    fn enter(&mut self, time: f64, phase: Phase, outcome: &str) {
        if let Some(report) = self.reports.last_mut() {
            report.end = Some(time);
            outcome.clone_into(&mut report.outcome);
        }
        self.skips = false;
        let mut report = PhaseReport::begin(phase, time);
        if phase.is_over() {
            report.end = Some(time);
            outcome.clone_into(&mut report.outcome);
        }
        self.reports.push(report);
    }

    /// The report of the present phase.
    fn report(&mut self) -> &mut PhaseReport {
        if self.reports.is_empty() {
            self.reports.push(PhaseReport::begin(Phase::Observe, 0.0));
        }
        let last = self.reports.len() - 1;
        &mut self.reports[last]
    }

    /// Sets the payload, assumed or identified, that the robot holds from now on.
    fn take(&mut self, payload: RigidInertia, is_identified: bool) -> Result<(), InertiaError> {
        let model = with_payload(&self.model, &self.tip, &payload)?;
        let X_EG = self.held.as_ref().and_then(|held| held.X_EG);
        // Until the payload is identified, the target may be the heaviest.
        let largest = match is_identified {
            true => payload,
            false => self.heaviest(&payload.com),
        };
        let servo = JointServo::new(&model, self.config.joint_bandwidth);
        self.held = Some(Held {
            servo: match self.config.grip_frequency(&largest) {
                Some(frequency) => servo.with_compliance(frequency),
                None => servo,
            },
            workspace: Workspace::new(&model),
            payload,
            is_identified,
            X_EG,
        });
        Ok(())
    }
}
