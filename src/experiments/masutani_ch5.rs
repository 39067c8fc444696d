//! The positioning runs of Masutani 1995, chapter 5: the servicer of Fig. 5.2 brings its tip to a goal at rest in the
//! world.
//!
//! The thesis prints gains and limits, but not geometry, start and goal; these are recovered so that the runs
//! agree with the text. `config/positioning.yaml` is the same run as a scenario.

use nalgebra::{DVector, Vector3};

use crate::control::{
    Controller, ControllerConfig, Gains, JacobianKind, JointPdConfig, LawConfig, LawKind,
    Measurement, PoseError, Saturation, StraightPathConfig, TipMeasurement,
    TransposeJacobianConfig,
};
use crate::dynamics::{Floating, IntegrationMethod, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::Pose;

/// Joint angles at the start \[deg\].
pub const START: [f64; 6] = [65.0, 99.0, -95.0, -22.0, 3.0, -42.0];

/// Joint angles \[deg\] at which a fixed base would hold the tip at the goal.
pub const GOAL: [f64; 6] = [87.0, 62.0, -41.0, 51.0, 28.0, 68.0];

/// Period at which the nodes sample the law \[s\].
pub const PERIOD: f64 = 0.01;

/// `K_V` \[N m s/rad\].
pub const K_V: [f64; 6] = [400.0, 100.0, 200.0, 10.0, 2.0, 2.0];

/// Stiffness of joint PD control per [`K_V`] \[1/s\]; not printed.
pub const JOINT_STIFFNESS: f64 = 0.2;

/// The robot of Fig. 5.2.
pub fn model() -> Model {
    let xml = include_str!("../../urdf/servicer.urdf");
    Model::from_urdf(xml, "urdf/servicer.urdf").expect("the servicer is well formed")
}

/// The printed gains, for one of the laws.
pub fn config(law: LawKind, jacobian: JacobianKind) -> ControllerConfig {
    let gains = Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: K_V.to_vec(),
        saturation: Saturation {
            position: 0.2,
            orientation: 0.1,
        },
    };
    let law = match law {
        LawKind::TransposeJacobian => TransposeJacobianConfig { jacobian }.into(),
        LawKind::StraightPath => StraightPathConfig {
            jacobian,
            ..StraightPathConfig::default()
        }
        .into(),
        LawKind::JointPd => {
            let k_p = K_V.iter().map(|k| JOINT_STIFFNESS * k).collect();
            JointPdConfig { k_p }.into()
        }
        LawKind::OperationalSpace | LawKind::ComputedTorque => LawConfig::from(law),
    };
    ControllerConfig::new(law, gains)
}

/// A run with a sampled law, whose efforts are held between samples.
pub struct Run {
    robot: Floating,
    controller: Controller,
    tip: Frame,
    X_WD: Pose,
    period: f64,
    steps: u32,
}

/// A sample of a run, with accelerations under the new efforts.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// Time \[s\].
    pub time: f64,
    /// Joint angles \[rad\].
    pub q: DVector<f64>,
    /// Pose of the base; its origin is its centre of mass.
    pub X_WB: Pose,
    /// Position of the tip in the world \[m\].
    pub p_WE: Vector3<f64>,
    /// Deviation of the tip from the goal.
    pub error: PoseError,
    /// Speed of the tip in the world \[m/s\].
    pub tip_speed: f64,
    /// Acceleration of the tip in the world, under the new efforts \[m/s²\].
    pub tip_acceleration: f64,
    /// Angular acceleration of the base under the new efforts, base axes \[rad/s²\].
    pub alpha_WB_B: Vector3<f64>,
    /// Moment on the base about its centre of mass that gives this acceleration, base axes \[N m\].
    pub base_moment_B: Vector3<f64>,
}

impl Run {
    /// A run that begins at rest at [`START`].
    pub fn new(law: LawKind, jacobian: JacobianKind, period: f64) -> Self {
        let model = model();
        let tip = model.frame("tool0").expect("the servicer's tip").clone();
        let mut workspace = Workspace::new(&model);
        workspace.set_positions(&radians(&GOAL));
        let start = State::at_rest_with(&model, &radians(&START));
        let controller = Controller::new(model.clone(), tip.clone(), config(law, jacobian));
        Self {
            X_WD: workspace.X_BF(&tip),
            controller: controller.expect("gains for six joints"),
            robot: Floating::new(model, start, IntegrationMethod::Rk4),
            tip,
            period,
            steps: 0,
        }
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        self.robot.model()
    }

    /// Goal of the tip in the world.
    pub fn X_WD(&self) -> &Pose {
        &self.X_WD
    }

    /// Evaluates the law; its efforts act until the next sample.
    pub fn answer(&mut self) -> Moment {
        let robot = &mut self.robot;
        let X_WB = robot.state().X_WB(robot.workspace());
        let X_BE = robot.workspace().X_BF(&self.tip);
        let X_BD = X_WB.inverse() * self.X_WD;
        let (q, qd) = (robot.state().q.clone(), robot.state().qd.clone());
        let time = f64::from(self.steps) * self.period;
        let tip = TipMeasurement::new(time, X_BE, X_BD);
        let measurement = Measurement::new(time, &q, &qd).with_tip(Some(&tip));
        let report = self.controller.update(&measurement);
        report.expect("the goal is within reach");
        robot.hold_efforts(self.controller.efforts().as_slice());
        robot.accelerations();
        let (model, workspace) = (robot.model(), robot.workspace());
        let base = &model.frames()[0];
        let (w, alpha) = (workspace.V_WB_B().angular, workspace.A_WF_B(base).angular);
        let inertia = model.bodies()[0].inertia.about_com;
        Moment {
            time,
            X_WB,
            p_WE: (X_WB * X_BE).translation.vector,
            error: PoseError::between(&X_BE, &X_BD),
            tip_speed: workspace.V_WF_B(&self.tip).linear.norm(),
            tip_acceleration: workspace.A_WF_B(&self.tip).linear.norm(),
            alpha_WB_B: alpha,
            base_moment_B: inertia * alpha + w.cross(&(inertia * w)),
            q,
        }
    }

    /// Advances to the next sample.
    pub fn advance(&mut self) {
        self.robot.step(self.period, 1);
        self.steps += 1;
    }

    /// All samples from now on, up to and including `duration` \[s\].
    pub fn moments(mut self, duration: f64) -> Vec<Moment> {
        let last = (duration / self.period).round() as u32;
        let mut moments = Vec::with_capacity(last as usize + 1);
        loop {
            moments.push(self.answer());
            if self.steps >= last {
                return moments;
            }
            self.advance();
        }
    }
}

fn radians(degrees: &[f64; 6]) -> DVector<f64> {
    DVector::from_iterator(6, degrees.iter().map(|x| x.to_radians()))
}
