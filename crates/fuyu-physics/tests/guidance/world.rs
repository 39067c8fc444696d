//! A servicer and a free target with what its sensors measure: the plant of the missions.

use fuyu_physics::control::capture::{Command, Gripper, RotationForecast, Sample};
use fuyu_physics::dynamics::capture::{Captured, Grasp, JointReaction, Latch};
use fuyu_physics::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu_physics::estimation::free_body::FreeRotation;
use fuyu_physics::model::{Frame, Model, ModelBuilder};
use fuyu_physics::spatial::{Pose, RigidInertia, Twist, exp_so3};
use nalgebra::{DVector, Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

pub const METHOD: IntegrationMethod = IntegrationMethod::Dop8;
pub const PERIOD: f64 = 0.01;

pub fn servicer() -> (Model, Frame, Frame) {
    let xml = include_str!("../../../../urdf/servicer.urdf");
    let model = Model::from_urdf(xml, "servicer").unwrap();
    let tip = model.frame("tool0").unwrap().clone();
    let camera = model.frame("camera_optical_frame").unwrap().clone();
    (model, tip, camera)
}

/// The posture from which missions start.
pub fn posture() -> DVector<f64> {
    DVector::from_row_slice(&[1.396, 1.571, -1.571, 0.0, 0.524, 0.0])
}

/// A target with its grasp frame.
#[derive(Debug, Clone)]
pub struct Target {
    pub body: RigidInertia,
    /// Grasp frame in the body's.
    pub X_TG: Pose,
    /// Pose in the world at the start.
    pub X_WT: Pose,
    /// Twist of the body's origin there, body axes.
    pub V_WT_T: Twist,
}

/// Noise and delays of the sensors.
#[derive(Debug, Clone, Copy)]
pub struct Sensors {
    pub position_noise: f64,
    pub attitude_noise: f64,
    pub latency: f64,
    pub gyro_noise: f64,
    /// Error of forecasts \[rad/s\], which fades within 10 s.
    pub forecast_drift: f64,
}

pub const SENSORS: Sensors = Sensors {
    position_noise: 7e-3,
    attitude_noise: 2e-3,
    latency: 0.15,
    gyro_noise: 1e-4,
    forecast_drift: 2e-4,
};

pub struct World {
    pub robot: Floating,
    pub target: Floating,
    pub held: Option<Captured>,
    pub tip: Frame,
    camera: Frame,
    X_TG: Pose,
    /// Grasp frames in the body's, and the one that is held.
    pub grasps: Vec<Pose>,
    X_TK: Pose,
    body: RigidInertia,
    rotation: FreeRotation,
    sensors: Sensors,
    random: StdRng,
    tick: u64,
    frames: Vec<(f64, Pose)>,
    couple: Vector3<f64>,
    /// Largest force and torque at the grasp since it holds, by the change of the target's momentum.
    pub grasp: (f64, f64),
    momentum: Option<(Vector3<f64>, Vector3<f64>, Vector3<f64>)>,
    pub latch_works: bool,
    pub target_is_visible: bool,
    /// Momentum that the couple has added.
    pub given: Vector3<f64>,
}

impl World {
    pub fn new(target: &Target, sensors: Sensors, seed: u64) -> Self {
        let (model, tip, camera) = servicer();
        let mut state = State::at_rest_with(&model, &posture());
        let base = Twist::new(
            Vector3::new(0.002, -0.001, 0.002),
            Vector3::new(0.003, 0.001, -0.002),
        );
        state.set_base(&mut Workspace::new(&model), &Isometry3::identity(), &base);
        let satellite = ModelBuilder::new("client", "client", target.body).build();
        let mut of_target = State::at_rest(&satellite);
        let X_WT = Isometry3::from_parts(
            target.X_WT.translation,
            UnitQuaternion::from_rotation_matrix(&target.X_WT.rotation),
        );
        of_target.set_base(&mut Workspace::new(&satellite), &X_WT, &target.V_WT_T);
        let rotation = FreeRotation::new(
            &target.body.about_com,
            X_WT.rotation,
            &target.V_WT_T.angular,
            0.0,
        );
        Self {
            robot: Floating::new(model, state, METHOD),
            target: Floating::new(satellite, of_target, METHOD),
            held: None,
            tip,
            camera,
            X_TG: target.X_TG,
            grasps: vec![target.X_TG],
            X_TK: target.X_TG,
            body: target.body,
            rotation: rotation.unwrap(),
            sensors,
            random: StdRng::seed_from_u64(seed),
            tick: 0,
            frames: Vec::new(),
            couple: Vector3::zeros(),
            grasp: (0.0, 0.0),
            momentum: None,
            latch_works: true,
            target_is_visible: true,
            given: Vector3::zeros(),
        }
    }

    pub fn time(&self) -> f64 {
        self.tick as f64 * PERIOD
    }

    fn noise(&mut self, sd: f64) -> Vector3<f64> {
        let v: [f64; 3] = std::array::from_fn(|_| StandardNormal.sample(&mut self.random));
        Vector3::from(v) * sd
    }

    pub fn X_WB(&self) -> Pose {
        self.robot.state().X_WB(self.robot.workspace())
    }

    pub fn X_WG(&self) -> Pose {
        self.target.state().X_WB(self.target.workspace()) * self.X_TG
    }

    /// Twist of a frame's origin, world axes.
    pub fn twist_of(body: &Floating, frame: &Frame) -> Twist {
        let V = body.workspace().V_WF_B(frame);
        let R = body.state().R_WB;
        Twist::new(R * V.angular, R * V.linear)
    }

    /// Pose in the tip's frame of the point `offset` \[m\] before the grasp frame `X_GK` (in the measured one), and its twist
    /// relative to the tip's in world axes.
    pub fn relative(&self, X_GK: &Pose, offset: f64) -> (Pose, Twist) {
        let X_TG = self.X_TG
            * X_GK
            * Pose::from_parts(
                Translation3::new(-offset, 0.0, 0.0),
                nalgebra::Rotation3::identity(),
            );
        let frame = Frame {
            name: "grasp".to_owned(),
            body: 0,
            parent: None,
            X_BF: X_TG,
        };
        let X_WE = self.X_WB() * self.robot.workspace().X_BF(&self.tip);
        let X_WG = self.target.state().X_WB(self.target.workspace()) * X_TG;
        let (a, b) = (
            Self::twist_of(&self.robot, &self.tip),
            Self::twist_of(&self.target, &frame),
        );
        let V = Twist::new(b.angular - a.angular, b.linear - a.linear);
        (X_WE.inverse() * X_WG, V)
    }

    pub fn sample(&mut self) -> (f64, Vec<f64>, Vec<f64>, Vector3<f64>) {
        let noise = self.noise(self.sensors.gyro_noise);
        let state = self.robot.state();
        let w = self.robot.workspace().V_WB_B().angular + noise;
        (
            self.time(),
            state.q.iter().copied().collect(),
            state.qd.iter().copied().collect(),
            w,
        )
    }

    /// A measured grasp pose that arrives now, with its time of exposure.
    pub fn grasp_pose(&mut self) -> Option<(f64, Pose)> {
        if self.tick.is_multiple_of(10) && self.target_is_visible {
            let X_BG = self.X_WB().inverse() * self.X_WG();
            let p = X_BG.translation.vector + self.noise(self.sensors.position_noise);
            let turn = exp_so3(&self.noise(self.sensors.attitude_noise));
            let R = X_BG.rotation * turn.to_rotation_matrix();
            self.frames
                .push((self.time(), Pose::from_parts(p.into(), R)));
        }
        let (time, _) = *self.frames.first()?;
        (self.time() >= time + self.sensors.latency - 1e-9).then(|| self.frames.remove(0))
    }

    /// Forecast that arrives now, in the camera's axes at its start.
    pub fn forecast(&mut self) -> Option<RotationForecast> {
        if self.held.is_some()
            || !self.tick.is_multiple_of(100)
            || self.tick < 500
            || !self.target_is_visible
        {
            return None;
        }
        let start = self.time();
        let R_WC = self.X_WB().rotation * self.robot.workspace().X_BF(&self.camera).rotation;
        let R_CW = UnitQuaternion::from_rotation_matrix(&R_WC).inverse();
        let age = (-(start - 5.0) / 10.0).exp();
        let drift = self.noise(self.sensors.forecast_drift * (0.1 + age));
        let attitudes = (0..=240).map(|k| {
            let after = 0.25 * f64::from(k);
            R_CW * exp_so3(&(drift * after)) * self.rotation.attitude(start + after)
        });
        Some(RotationForecast {
            start,
            period: 0.25,
            attitudes: attitudes.collect(),
        })
    }

    /// Applies a command for one period.
    pub fn apply(&mut self, efforts: &[f64], couple: Vector3<f64>, gripper: Gripper) {
        if gripper == Gripper::Close && self.held.is_none() && self.latch_works {
            self.latch();
        }
        if gripper == Gripper::Open
            && let Some(held) = self.held.take()
        {
            let released = held.release(None);
            self.robot.set_state(released.robot);
            self.target.set_state(released.target);
        }
        self.couple = couple;
        self.robot.hold_efforts(efforts);
        self.robot.input_mut().wrenches[0].torque = couple;
        self.given += self.robot.state().R_WB * couple * PERIOD;
        match &mut self.held {
            Some(held) => {
                held.hold_robot_input(self.robot.input());
                held.step(PERIOD, 1);
                held.copy_robot_to(&mut self.robot);
                held.copy_target_to(&mut self.target);
            }
            None => {
                self.robot.step(PERIOD, 1);
                self.target.step(PERIOD, 1);
            }
        }
        self.tick += 1;
        self.measure_grasp();
    }

    /// Closes on the grasp frame at the tip, if there is one.
    fn latch(&mut self) {
        for X_BF in self.grasps.clone() {
            let grasp = Grasp {
                robot: self.tip.clone(),
                target: Frame {
                    name: "client".to_owned(),
                    body: 0,
                    parent: None,
                    X_BF,
                },
                latch: Latch::Weld,
                joints: JointReaction::Free,
            };
            if grasp
                .check_separation(&self.robot, &self.target, 0.03, 0.06)
                .is_ok()
            {
                let (held, _) = Captured::new(&self.robot, &self.target, &grasp, METHOD).unwrap();
                held.copy_robot_to(&mut self.robot);
                held.copy_target_to(&mut self.target);
                self.held = Some(held);
                self.X_TK = X_BF;
                return;
            }
        }
    }

    /// Force and torque at the grasp from the change of the target's momentum over a period.
    fn measure_grasp(&mut self) {
        let state = self.target.state();
        let momentum = &state.momentum_W;
        let X_WK = state.X_WB(self.target.workspace()) * self.X_TK;
        let at = X_WK.translation.vector - state.p_WC;
        let now = (momentum.linear, momentum.angular, at);
        if let (Some(before), Some(_)) = (self.momentum, &self.held) {
            let force = (now.0 - before.0) / PERIOD;
            let couple = (now.1 - before.1) / PERIOD;
            let torque = couple - (at + before.2).scale(0.5).cross(&force);
            self.grasp = (
                self.grasp.0.max(force.norm()),
                self.grasp.1.max(torque.norm()),
            );
        }
        self.momentum = self.held.as_ref().map(|_| now);
    }

    /// Mass, centre of mass and inertia of the target in the grasp frame.
    pub fn target_in_grasp_frame(&self) -> RigidInertia {
        self.body.expressed_in(&self.X_TK.inverse())
    }

    /// Feeds a mission for a period.
    pub fn answer(&mut self, mission: &mut fuyu_physics::control::capture::CaptureMission) {
        while let Some((time, X_BG)) = self.grasp_pose() {
            mission.add_grasp_pose(time, X_BG);
        }
        if let Some(forecast) = self.forecast() {
            mission.add_forecast(forecast);
        }
        let (time, q, qd, w_B) = self.sample();
        let sample = Sample {
            time,
            q: &q,
            qd: &qd,
            w_B,
            wheel_speeds: &[],
        };
        let Command {
            efforts,
            couple,
            gripper,
            ..
        } = mission.step(&sample).unwrap();
        let efforts = efforts.to_vec();
        self.apply(&efforts, couple, gripper);
    }
}

/// A satellite whose grasp frame is in reach of the servicer: `mass` \[kg\], tumbling at `rate` \[rad/s\] about `axis` of
/// the body.
pub fn client(mass: f64, rate: f64, axis: Vector3<f64>) -> Target {
    let size = (mass / 300.0).cbrt();
    let inertia = nalgebra::Matrix3::new(110.0, 3.0, -2.0, 3.0, 150.0, 5.0, -2.0, 5.0, 170.0);
    let body = RigidInertia {
        mass,
        com: Vector3::new(0.02, -0.03, 0.01),
        about_com: inertia * (mass / 300.0) * size * size,
    };
    // The approach is along the grasp frame's x, into the body.
    let X_TG = Pose::from_parts(
        Translation3::new(-0.75, 0.1, 0.05),
        nalgebra::Rotation3::identity(),
    );
    // Ahead of the shoulder; the grasp frame is on the side of the robot.
    let place = Translation3::new(-0.8, 5.2, 0.0);
    let turn = UnitQuaternion::from_euler_angles(0.2, -0.15, 0.1 + std::f64::consts::FRAC_PI_2);
    let w = axis.normalize() * rate;
    Target {
        body,
        X_TG,
        X_WT: Pose::from_parts(place, turn.to_rotation_matrix()),
        V_WT_T: Twist::new(w, Vector3::new(0.004, -0.003, 0.002)),
    }
}

/// Grasp frames in the middle of the six sides of a cube of 1.5 m, in the body's; the first is the measured one of [`client`].
pub fn sides(target: &Target) -> Vec<Pose> {
    let mut all = vec![target.X_TG];
    for n in [
        Vector3::x(),
        Vector3::y(),
        -Vector3::y(),
        Vector3::z(),
        -Vector3::z(),
    ] {
        let turn = nalgebra::Rotation3::rotation_between(&Vector3::x(), &-n).unwrap_or_else(|| {
            nalgebra::Rotation3::from_euler_angles(0.0, 0.0, std::f64::consts::PI)
        });
        all.push(Pose::from_parts(Translation3::from(n * 0.75), turn));
    }
    all
}
