//! Transpose-Jacobian control.

use nalgebra::{DVector, Matrix6xX, Vector3};

use super::{Law, LawConfig, LawError, LawInput, LawStatus, Manipulator};
use crate::dynamics::Workspace;
use crate::model::Frame;

/// Which Jacobian turns the tip's wrench into joint efforts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum JacobianKind {
    /// The generalized Jacobian, eqs. (4.36), (4.37): asymptotically stable.
    #[default]
    Generalized,
    /// The fixed-base Jacobian as an approximation (chapter 6): cheaper, and unstable in a part of the
    /// workspace when the base is light.
    FixedBase,
}

impl JacobianKind {
    /// All Jacobians by name.
    pub const NAMES: [(&'static str, Self); 2] = [
        ("generalized", Self::Generalized),
        ("fixed_base", Self::FixedBase),
    ];

    /// Writes the Jacobian of `tip` at the positions that `workspace` holds (6 × n, linear rows first, base
    /// axes).
    pub fn write(self, workspace: &mut Workspace, tip: &Frame, out: &mut Matrix6xX<f64>) {
        match self {
            Self::Generalized => workspace.generalized_jacobian(tip, out),
            Self::FixedBase => workspace.fixed_base_jacobian(tip, out),
        }
    }
}

/// Settings of [`TransposeJacobian`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TransposeJacobianConfig {
    /// Which Jacobian turns the wrench on the tip into joint efforts.
    pub jacobian: JacobianKind,
}

/// The law `τ = k_p Ĵ_Lᵀ ē_p + k_o Ĵ_Aᵀ ē_o - K_V q̇`, Masutani 1995 eq. (5.3) with the saturated errors of
/// eqs. (5.25), (5.26).
#[derive(Debug, Clone)]
pub struct TransposeJacobian {
    config: TransposeJacobianConfig,
    jacobian: Matrix6xX<f64>,
}

impl TransposeJacobian {
    /// The law for a robot.
    pub fn new(config: TransposeJacobianConfig, manipulator: &Manipulator) -> Self {
        Self {
            config,
            jacobian: Matrix6xX::zeros(manipulator.model.dof()),
        }
    }
}

impl Law for TransposeJacobian {
    fn efforts(
        &mut self,
        input: &LawInput<'_>,
        manipulator: &mut Manipulator,
        efforts: &mut DVector<f64>,
    ) -> Result<LawStatus, LawError> {
        let Some(error) = &input.error else {
            return Ok(LawStatus::Inactive);
        };
        let Manipulator { workspace, tip, .. } = manipulator;
        (self.config.jacobian).write(workspace, tip, &mut self.jacobian);
        let force = error.position * input.gains.k_p;
        let torque = error.orientation * input.gains.k_o;
        transpose_times(&self.jacobian, &force, &torque, efforts);
        Ok(LawStatus::TipFeedback)
    }

    fn configure(&mut self, config: &LawConfig) -> bool {
        let LawConfig::TransposeJacobian(config) = config else {
            return false;
        };
        self.config = *config;
        true
    }

    fn monitors_convergence(&self) -> bool {
        true
    }

    fn feeds_forward(&self) -> bool {
        true
    }
}

/// Joint efforts of a force and a torque on the tip: the transpose of a Jacobian times the wrench.
pub(super) fn transpose_times(
    jacobian: &Matrix6xX<f64>,
    force: &Vector3<f64>,
    torque: &Vector3<f64>,
    efforts: &mut DVector<f64>,
) {
    for (j, column) in jacobian.column_iter().enumerate() {
        efforts[j] = column.fixed_rows::<3>(0).dot(force) + column.fixed_rows::<3>(3).dot(torque);
    }
}
