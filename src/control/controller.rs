//! A tip controller as a node or an experiment runs it: one of the laws, its state, its output.

use nalgebra::DVector;
use serde::{Deserialize, Serialize};

use super::{
    GainError, Gains, IkError, JacobianKind, JointPd, Measurement, PoseError, TransposeJacobian,
    check_joint_gains, inverse_kinematics,
};
use crate::dynamics::Workspace;
use crate::model::{Frame, Model};
use crate::spatial::Pose;

/// Which law drives the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LawKind {
    /// Transpose-Jacobian control, [`TransposeJacobian`].
    TransposeJacobian,
    /// Joint PD towards joint positions found by inverse kinematics when it starts, [`JointPd`].
    JointPd,
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
    /// frame that is young enough; without it the joints are only damped.
    ///
    /// # Errors
    /// [`IkError`] when the joint PD finds no joint positions for its goal; the efforts are then zero.
    pub fn update(
        &mut self,
        q: &DVector<f64>,
        qd: &DVector<f64>,
        seen: Option<(&Pose, &Pose)>,
    ) -> Result<Acted, IkError> {
        let Some((X_BE, X_BD)) = seen else {
            for (effort, (k, rate)) in self
                .efforts
                .iter_mut()
                .zip(self.config.gains.k_v.iter().zip(qd))
            {
                *effort = -k * rate;
            }
            let saturated = false;
            return Ok(Acted {
                error: None,
                position_saturated: saturated,
                orientation_saturated: saturated,
            });
        };
        match self.config.law {
            LawKind::TransposeJacobian => {
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
                Ok(Acted {
                    error: Some(error),
                    position_saturated: saturation.position_error(&error).1,
                    orientation_saturated: saturation.orientation_error(&error).1,
                })
            }
            LawKind::JointPd => {
                if self.joint_pd.is_none() {
                    self.efforts.fill(0.0);
                    self.joint_pd = Some(JointPd {
                        k_p: self.config.joint_k_p.clone(),
                        k_v: self.config.gains.k_v.clone(),
                        goal: inverse_kinematics(&self.model, &self.tip, X_BD, q)?,
                    });
                }
                if let Some(pd) = &self.joint_pd {
                    pd.efforts(q, qd, &mut self.efforts);
                }
                Ok(Acted {
                    error: Some(PoseError::between(X_BE, X_BD)),
                    position_saturated: false,
                    orientation_saturated: false,
                })
            }
        }
    }
}
