//! A servicer tracks a grasp point on a tumbling body, with a camera of configurable latency, rate and noise.
//!
//! The robot is that of Masutani 1995 Fig. 5.2 with the gains of its chapter 5. The target is that of chapter 3; it
//! rotates at 3 deg/s about an axis that is not a principal axis, and its grasp point moves at 5 cm/s relative to the servicer's
//! centre of mass. The servicer has linear and angular momentum. `config/tracking.yaml` is the same run as a scenario.

use nalgebra::{DVector, Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use crate::control::prediction::{GoalMotionConfig, Prediction};
use crate::control::{
    Controller, ControllerConfig, Gains, LawConfig, LawKind, Measurement, PoseError, Saturation,
    Shaping, StraightPathConfig, TipMeasurement,
};
use crate::dynamics::{Floating, IntegrationMethod, State, Workspace};
use crate::experiments::masutani_ch5::K_V;
use crate::model::{Frame, Model};
use crate::spatial::{Pose, Twist};
use crate::vision::{PoseCamera, PoseCameraConfig, PoseFrame};

/// Period at which the law is sampled \[s\].
pub const PERIOD: f64 = 0.01;

/// The run's conditions.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The control law.
    pub law: LawKind,
    /// Latency compensation.
    pub prediction: Prediction,
    /// Quality of the camera.
    pub camera: PoseCameraConfig,
    /// Settings of the goal filter.
    pub goal: GoalMotionConfig,
    /// Standard deviation of each component of the gyro \[rad/s\].
    pub gyro_noise: f64,
    /// The controller's model of the robot, if it differs from the truth.
    pub known_robot: Option<Model>,
    /// Whether the target moves and the servicer has momentum.
    pub moving: bool,
}

impl Setup {
    /// An ideal camera: every state, without latency and noise.
    pub fn ideal(prediction: Prediction) -> Self {
        Self {
            law: LawKind::TransposeJacobian,
            prediction,
            camera: PoseCameraConfig::default(),
            goal: GoalMotionConfig {
                position_noise: 1e-4,
                attitude_noise: 1e-4,
                ..GoalMotionConfig::default()
            },
            gyro_noise: 0.0,
            known_robot: None,
            moving: true,
        }
    }

    /// The camera [`late_camera`].
    pub fn late(prediction: Prediction) -> Self {
        let camera = late_camera();
        Self {
            goal: GoalMotionConfig {
                position_noise: camera.position_noise,
                attitude_noise: camera.attitude_noise,
                ..GoalMotionConfig::default()
            },
            camera,
            ..Self::ideal(prediction)
        }
    }
}

/// Initial joint angles \[deg\], from which the arm avoids singularities for a minute.
pub const START: [f64; 6] = [80.0, 90.0, -90.0, 0.0, 30.0, 0.0];

/// A camera with 10 Hz, 150 ms latency and noise of 1 px: the noise of [`PoseAccuracy`](crate::vision::PoseAccuracy)
/// for 20 points on a body of 1 m at the goal's distance, with a focal length of 1024 px; the noise of the worst axis
/// is used for all axes.
pub fn late_camera() -> PoseCameraConfig {
    PoseCameraConfig {
        rate: 10.0,
        latency: 0.15,
        position_noise: 7e-3,
        attitude_noise: 2e-3,
        ..PoseCameraConfig::default()
    }
}

/// Latencies that [`latency_margin`] tries \[s\].
pub const LATENCIES: [f64; 10] = [0.0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4];

/// Largest angle \[rad\] between tip and a goal at rest from 38 s to 40 s, for a camera of `rate` \[Hz\] (zero: every
/// state) with `latency` \[s\]; infinite if the motion diverges.
pub fn angle_left(prediction: Prediction, law: LawKind, rate: f64, latency: f64) -> f64 {
    let camera = PoseCameraConfig {
        rate,
        latency,
        ..PoseCameraConfig::default()
    };
    let setup = Setup {
        law,
        camera,
        moving: false,
        ..Setup::ideal(prediction)
    };
    let moments = Run::new(setup).moments(40.0);
    if moments.len() < 4001 {
        return f64::INFINITY;
    }
    moments[3800..]
        .iter()
        .map(|m| m.error.angle)
        .fold(0.0, f64::max)
}

/// The smallest of [`LATENCIES`] for which the tip does not settle at a goal at rest, that is, is still a degree away
/// after 40 s; `None` if it settles for all of them.
pub fn latency_margin(prediction: Prediction, law: LawKind, rate: f64) -> Option<f64> {
    let settles = |latency| angle_left(prediction, law, rate, latency) < 1f64.to_radians();
    LATENCIES.into_iter().find(|latency| !settles(*latency))
}

/// A run.
pub struct Run {
    robot: Floating,
    target: Floating,
    tip: Frame,
    X_TD: Pose,
    camera: PoseCamera,
    gyro: StdRng,
    setup: Setup,
    controller: Controller,
    seen: Option<TipMeasurement>,
    steps: u32,
}

/// One state of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// Time \[s\].
    pub time: f64,
    /// True deviation of the tip from the goal.
    pub error: PoseError,
    /// Speed of the goal relative to the servicer's centre of mass \[m/s\].
    pub goal_speed: f64,
    /// Commanded efforts \[N m\].
    pub efforts: DVector<f64>,
}

fn model(xml: &str, name: &str) -> Model {
    Model::from_urdf(xml, name).expect("a robot of fuyu's own is well formed")
}

/// Angular velocity of the target in its principal axes \[rad/s\]: 3 deg/s, 15 degrees off its axis of largest
/// inertia.
pub fn target_rate() -> Vector3<f64> {
    Vector3::new(0.966, 0.22, 0.136).normalize() * 3f64.to_radians()
}

/// Pose of the hand at the grasp point, in the target's principal axes.
pub fn grasp() -> Pose {
    Pose::from_parts(
        Translation3::new(0.15, 0.95, 0.0),
        Rotation3::from_euler_angles(0.0, 0.1, 0.0),
    )
}

impl Run {
    /// Initial servicer and target: the tip 0.3 m and about 10 degrees away from the grasp point.
    pub fn new(setup: Setup) -> Self {
        let servicer = model(
            include_str!("../../urdf/servicer.urdf"),
            "urdf/servicer.urdf",
        );
        let tip = servicer.frame("tool0").expect("the servicer's tip").clone();
        let q = DVector::from_iterator(6, START.iter().map(|x| x.to_radians()));
        let mut state = State::at_rest_with(&servicer, &q);
        let mut workspace = Workspace::new(&servicer);
        workspace.set_positions(&q);
        let X_WE = workspace.X_BF(&tip);
        if setup.moving {
            let drift = Twist::new(
                Vector3::new(0.002, -0.001, 0.002),
                Vector3::new(0.003, 0.001, -0.002),
            );
            state.set_base(&mut workspace, &Isometry3::identity(), &drift);
        }
        let X_WD = Pose::from_parts(
            Translation3::from(X_WE.translation.vector + Vector3::new(0.2, 0.15, -0.15)),
            Rotation3::from_euler_angles(0.1, -0.1, 0.1) * X_WE.rotation,
        );
        let body = model(include_str!("../../urdf/target.urdf"), "urdf/target.urdf");
        let X_WT = X_WD * grasp().inverse();
        let mut target = State::at_rest(&body);
        let (mut rate, mut velocity) = (target_rate(), Vector3::new(0.004, -0.003, 0.002));
        if !setup.moving {
            (rate, velocity) = (Vector3::zeros(), Vector3::zeros());
        }
        let X_WT = Isometry3::from_parts(X_WT.translation, UnitQuaternion::from(X_WT.rotation));
        let V = Twist::new(rate, X_WT.rotation.inverse() * velocity);
        target.set_base(&mut Workspace::new(&body), &X_WT, &V);
        let gains = Gains {
            k_p: 75.0,
            k_o: 100.0,
            k_v: K_V.to_vec(),
            saturation: Saturation {
                position: 0.2,
                orientation: 0.1,
            },
        };
        let law = match setup.law {
            LawKind::StraightPath => LawConfig::from(StraightPathConfig {
                shaping: Shaping::Damping,
                d_along: 225.0,
                period: PERIOD,
                ..StraightPathConfig::default()
            }),
            law => law.into(),
        };
        let config = ControllerConfig {
            prediction: setup.prediction,
            goal: setup.goal,
            ..ControllerConfig::new(law, gains)
        };
        let known = setup.known_robot.as_ref().unwrap_or(&servicer).clone();
        let controller = Controller::new(known, tip.clone(), config);
        Self {
            controller: controller.expect("gains for six joints"),
            camera: PoseCamera::new(setup.camera.clone()),
            gyro: StdRng::seed_from_u64(7),
            robot: Floating::new(servicer, state, IntegrationMethod::Rk4),
            target: Floating::new(body, target, IntegrationMethod::Rk4),
            tip,
            X_TD: grasp(),
            setup,
            seen: None,
            steps: 0,
        }
    }

    /// The controller; its settings may be changed during the run.
    pub fn controller_mut(&mut self) -> &mut Controller {
        &mut self.controller
    }

    /// Evaluates the law; its efforts act until the next call.
    pub fn answer(&mut self) -> Moment {
        let time = f64::from(self.steps) * PERIOD;
        let robot = &self.robot;
        let X_WB = robot.state().X_WB(robot.workspace());
        let X_BE = robot.workspace().X_BF(&self.tip);
        let X_WT = self.target.state().X_WB(self.target.workspace());
        let X_BD = X_WB.inverse() * X_WT * self.X_TD;
        self.camera.show(time, &X_BE, Some(&X_BD));
        while let Some(PoseFrame { time, X_BE, X_BD }) = self.camera.deliver(time) {
            self.seen = X_BD.map(|X_BD| TipMeasurement::new(time, X_BE, X_BD));
        }
        // The available measurements: encoders, gyro, camera frames.
        let mut noise = || self.gyro.sample::<f64, _>(StandardNormal) * self.setup.gyro_noise;
        let w = robot.workspace().V_WB_B().angular + Vector3::new(noise(), noise(), noise());
        let state = robot.state();
        let seen = Measurement::new(time, &state.q, &state.qd)
            .with_tip(self.seen.as_ref())
            .with_gyro(Some(&w));
        (self.controller.update(&seen)).expect("the laws of this run need no joint positions");
        self.robot
            .hold_efforts(self.controller.efforts().as_slice());
        let v_WC = self.robot.state().momentum_W.linear / self.robot.model().total_mass();
        let V_WT = self.target.workspace().V_WB_B();
        let arm = self.X_TD.translation.vector;
        let v_WD = X_WT.rotation * (V_WT.linear + V_WT.angular.cross(&arm));
        Moment {
            time,
            error: PoseError::between(&X_BE, &X_BD),
            goal_speed: (v_WD - v_WC).norm(),
            efforts: self.controller.efforts().clone(),
        }
    }

    /// Advances to the next sample.
    pub fn advance(&mut self) {
        self.robot.step(PERIOD, 1);
        self.target.step(PERIOD, 1);
        self.steps += 1;
    }

    /// Whether the servicer's state is still finite.
    pub fn is_finite(&self) -> bool {
        self.robot.state().is_finite()
    }

    /// All following samples, up to and including `duration` \[s\], or until the motion diverges.
    pub fn moments(mut self, duration: f64) -> Vec<Moment> {
        let last = (duration / PERIOD).round() as u32;
        let mut moments = Vec::with_capacity(last as usize + 1);
        loop {
            moments.push(self.answer());
            if self.steps >= last || !self.is_finite() {
                return moments;
            }
            self.advance();
        }
    }
}
