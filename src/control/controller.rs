//! A tip controller as a node or an experiment runs it: one of the laws, its state, its output.

use nalgebra::DVector;

use super::{
    GainError, Gains, IkError, JacobianKind, JointPd, Measurement, PoseError, TransposeJacobian,
    check_joint_gains, inverse_kinematics,
};
use crate::dynamics::Workspace;
use crate::model::{Frame, Model};
use crate::spatial::Pose;

/// Which law drives the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawKind {
    /// Transpose-Jacobian control, [`TransposeJacobian`].
    TransposeJacobian,
    /// Joint PD towards joint positions found by inverse kinematics when it starts, [`JointPd`].
    JointPd,
}

impl LawKind {
    /// All laws by name.
    pub const NAMES: [(&'static str, Self); 2] = [
        ("transpose_jacobian", Self::TransposeJacobian),
        ("joint_pd", Self::JointPd),
    ];
}

/// Settings of a [`Controller`].
#[derive(Debug, Clone, PartialEq)]
pub struct ControllerConfig {
    /// Which law.
    pub law: LawKind,
    /// Which Jacobian the transpose-Jacobian law uses.
    pub jacobian: JacobianKind,
    /// Gains of the transpose-Jacobian law; `k_v` damps the joints under every law.
    pub gains: Gains,
    /// Position gains of the joint PD \[N m/rad or N/m\], one per joint.
    pub joint_k_p: Vec<f64>,
}

impl ControllerConfig {
    /// Refuses settings that do not fit a robot with `joints` joints.
    ///
    /// # Errors
    /// [`GainError`] naming the gain.
    pub fn check(&self, joints: usize) -> Result<(), GainError> {
        self.gains.check(joints)?;
        match self.law {
            LawKind::TransposeJacobian => Ok(()),
            LawKind::JointPd => check_joint_gains("joint_k_p", &self.joint_k_p, joints),
        }
    }
}

/// What the controller did at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acted {
    /// Deviation that it acted on; `None` while no camera measurement was given.
    pub error: Option<PoseError>,
    /// Whether the position error was saturated.
    pub position_saturated: bool,
    /// Whether the orientation error was saturated.
    pub orientation_saturated: bool,
}

/// Joint states and base-frame measurements in, joint efforts out.
#[derive(Debug, Clone)]
pub struct Controller {
    model: Model,
    tip: Frame,
    config: ControllerConfig,
    workspace: Workspace,
    transpose_jacobian: TransposeJacobian,
    joint_pd: Option<JointPd>,
    /// A goal for which the joint PD found no joint positions, and why.
    out_of_reach: Option<(Pose, IkError)>,
    efforts: DVector<f64>,
}

impl Controller {
    /// A controller for `model` with its tip at the frame `tip`.
    ///
    /// # Errors
    /// [`GainError`] when the settings do not fit the robot.
    pub fn new(model: Model, tip: Frame, config: ControllerConfig) -> Result<Self, GainError> {
        config.check(model.dof())?;
        let gains = config.gains.clone();
        Ok(Self {
            workspace: Workspace::new(&model),
            transpose_jacobian: TransposeJacobian::new(&model, &tip, gains, config.jacobian)?,
            joint_pd: None,
            out_of_reach: None,
            efforts: DVector::zeros(model.dof()),
            model,
            tip,
            config,
        })
    }

    /// Settings in force.
    pub fn config(&self) -> &ControllerConfig {
        &self.config
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The tip's frame.
    pub fn tip(&self) -> &Frame {
        &self.tip
    }

    /// Changes the settings; the joint PD forgets its joint goal when the law changes.
    ///
    /// # Errors
    /// [`GainError`] when they do not fit the robot; nothing has changed then.
    pub fn set_config(&mut self, config: ControllerConfig) -> Result<(), GainError> {
        config.check(self.model.dof())?;
        self.transpose_jacobian.gains = config.gains.clone();
        self.transpose_jacobian.jacobian = config.jacobian;
        if config.law != self.config.law || config.law == LawKind::TransposeJacobian {
            self.joint_pd = None;
            self.out_of_reach = None;
        } else if let Some(pd) = &mut self.joint_pd {
            pd.k_p.clone_from(&config.joint_k_p);
            pd.k_v.clone_from(&config.gains.k_v);
        }
        self.config = config;
        Ok(())
    }

    /// Efforts of the last update \[N m or N\].
    pub fn efforts(&self) -> &DVector<f64> {
        &self.efforts
    }

    /// One control step. `seen` is the pair of tip and goal poses (`X_BE`, `X_BD`) of the latest camera
    /// frame that is young enough. Without it the joints are only damped, unless the law has all that it
    /// needs: the joint PD looks at the camera when it starts and never again.
    ///
    /// # Errors
    /// [`IkError`] when the joint PD finds no joint positions for its goal; the joints are then damped.
    pub fn update(
        &mut self,
        q: &DVector<f64>,
        qd: &DVector<f64>,
        seen: Option<(&Pose, &Pose)>,
    ) -> Result<Acted, IkError> {
        let error = seen.map(|(X_BE, X_BD)| PoseError::between(X_BE, X_BD));
        let mut acted = Acted {
            error,
            position_saturated: false,
            orientation_saturated: false,
        };
        match (self.config.law, seen) {
            (LawKind::TransposeJacobian, Some((X_BE, X_BD))) => {
                let measurement = Measurement { q, qd, X_BE, X_BD };
                let Self {
                    model,
                    workspace,
                    transpose_jacobian,
                    efforts,
                    ..
                } = self;
                let error = transpose_jacobian.efforts(model, workspace, &measurement, efforts);
                let saturation = &transpose_jacobian.gains.saturation;
                acted.position_saturated = saturation.position_error(&error).1;
                acted.orientation_saturated = saturation.orientation_error(&error).1;
            }
            (LawKind::JointPd, _) => {
                if let (None, Some((_, X_BD))) = (&self.joint_pd, seen) {
                    self.damp(qd);
                    self.joint_pd = Some(self.start_joint_pd(X_BD, q)?);
                }
                match &self.joint_pd {
                    Some(pd) => pd.efforts(q, qd, &mut self.efforts),
                    None => self.damp(qd),
                }
            }
            (LawKind::TransposeJacobian, None) => self.damp(qd),
        }
        Ok(acted)
    }

    fn damp(&mut self, qd: &DVector<f64>) {
        for ((effort, k), rate) in self.efforts.iter_mut().zip(&self.config.gains.k_v).zip(qd) {
            *effort = -k * rate;
        }
    }

    fn start_joint_pd(&mut self, X_BD: &Pose, q: &DVector<f64>) -> Result<JointPd, IkError> {
        // The search is long where it fails: it is not made again for the same goal.
        if let Some((goal, error)) = &self.out_of_reach {
            let moved = PoseError::between(goal, X_BD);
            if moved.position.norm() < 1e-3 && moved.angle < 1e-3 {
                return Err(error.clone());
            }
        }
        let goal = inverse_kinematics(&self.model, &self.tip, X_BD, q)
            .inspect_err(|error| self.out_of_reach = Some((*X_BD, error.clone())))?;
        Ok(JointPd {
            k_p: self.config.joint_k_p.clone(),
            k_v: self.config.gains.k_v.clone(),
            goal,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Saturation;
    use nalgebra::Translation3;

    fn planar(law: LawKind) -> Controller {
        let xml = include_str!("../../urdf/planar_two_link.urdf");
        let model = Model::from_urdf(xml, "planar_two_link.urdf").unwrap();
        let tip = model.frame("tool0").unwrap().clone();
        Controller::new(model, tip, config(law)).unwrap()
    }

    fn config(law: LawKind) -> ControllerConfig {
        ControllerConfig {
            law,
            jacobian: JacobianKind::Generalized,
            gains: Gains {
                k_p: 100.0,
                k_o: 1.0,
                k_v: vec![200.0, 1000.0],
                saturation: Saturation::NONE,
            },
            joint_k_p: vec![40.0, 200.0],
        }
    }

    fn poses(controller: &Controller, q: [f64; 2], goal: [f64; 2]) -> (DVector<f64>, Pose, Pose) {
        let mut workspace = Workspace::new(controller.model());
        let mut pose = |q: &DVector<f64>| {
            workspace.set_positions(controller.model(), q);
            workspace.X_BF(controller.tip())
        };
        let q = DVector::from_row_slice(&q);
        let tip = pose(&q);
        let goal = pose(&DVector::from_row_slice(&goal));
        (q, tip, goal)
    }

    #[test]
    fn without_a_measurement_the_joints_are_damped() {
        let mut controller = planar(LawKind::TransposeJacobian);
        let (q, tip, goal) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
        let qd = DVector::from_row_slice(&[0.1, -0.2]);
        controller.update(&q, &qd, None).unwrap();
        assert_eq!(controller.efforts().as_slice(), [-20.0, 200.0]);
        let acted = controller.update(&q, &qd, Some((&tip, &goal))).unwrap();
        assert!(acted.error.is_some());
        assert_ne!(controller.efforts().as_slice(), [-20.0, 200.0]);
    }

    #[test]
    fn joint_pd_pulls_to_the_joint_goal_of_its_start_and_needs_no_camera_after() {
        let mut controller = planar(LawKind::JointPd);
        let (q, tip, goal) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
        let rest = DVector::zeros(2);
        controller.update(&q, &rest, Some((&tip, &goal))).unwrap();
        let pulled = controller.efforts().clone();
        assert!((pulled[0] - 40.0 * 0.2).abs() < 1e-6 && (pulled[1] + 200.0 * 0.2).abs() < 1e-6);
        controller.update(&q, &rest, None).unwrap();
        assert_eq!(controller.efforts(), &pulled);
    }

    #[test]
    fn a_goal_out_of_reach_is_an_error_and_leaves_damping() {
        let mut controller = planar(LawKind::JointPd);
        let (q, tip, _) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
        let far = Pose::from_parts(Translation3::new(20.0, 0.0, 0.0), tip.rotation);
        let qd = DVector::from_row_slice(&[0.1, 0.0]);
        for _ in 0..2 {
            let refused = controller.update(&q, &qd, Some((&tip, &far)));
            assert!(matches!(refused, Err(IkError::NotFound { .. })));
            assert_eq!(controller.efforts().as_slice(), [-20.0, 0.0]);
        }
    }

    #[test]
    fn settings_that_do_not_fit_change_nothing() {
        let mut controller = planar(LawKind::TransposeJacobian);
        let before = controller.config().clone();
        for broken in [
            ControllerConfig {
                gains: Gains {
                    k_p: -1.0,
                    ..before.gains.clone()
                },
                ..before.clone()
            },
            ControllerConfig {
                gains: Gains {
                    k_v: vec![1.0],
                    ..before.gains.clone()
                },
                ..before.clone()
            },
            ControllerConfig {
                gains: Gains {
                    saturation: Saturation {
                        position: f64::NAN,
                        orientation: 1.0,
                    },
                    ..before.gains.clone()
                },
                ..before.clone()
            },
            ControllerConfig {
                law: LawKind::JointPd,
                joint_k_p: vec![],
                ..before.clone()
            },
        ] {
            assert!(controller.set_config(broken).is_err());
            assert_eq!(controller.config(), &before);
        }
    }
}
