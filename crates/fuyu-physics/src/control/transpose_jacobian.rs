//! Transpose-Jacobian control.

use nalgebra::{DVector, Matrix6xX, Vector3};

use super::{ControlReport, ControllerConfig, Gains, Law, LawError, Manipulator, Measurement};
use crate::dynamics::Workspace;
use crate::model::Frame;

/// Which Jacobian turns the tip's wrench into joint efforts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JacobianKind {
    /// The generalized Jacobian, eqs. (4.36), (4.37): asymptotically stable.
    Generalized,
    /// The fixed-base Jacobian as an approximation (chapter 6): cheaper, and unstable in a part of the
    /// work space when the base is light.
    FixedBase,
}

impl JacobianKind {
    /// All Jacobians by name.
    pub const NAMES: [(&'static str, Self); 2] = [
        ("generalized", Self::Generalized),
        ("fixed_base", Self::FixedBase),
    ];

    /// Writes the Jacobian of `tip` for the positions that `workspace` holds (6 × n, linear rows first, base
    /// axes).
    pub fn write(self, workspace: &mut Workspace, tip: &Frame, out: &mut Matrix6xX<f64>) {
        match self {
            Self::Generalized => workspace.generalized_jacobian(tip, out),
            Self::FixedBase => workspace.fixed_base_jacobian(tip, out),
        }
    }
}

/// The law `τ = k_p Ĵ_Lᵀ ē_p + k_o Ĵ_Aᵀ ē_o - K_V q̇`, Masutani 1995 eq. (5.3) with the saturated errors of
/// eqs. (5.25), (5.26).
#[derive(Debug, Clone)]
pub struct TransposeJacobian {
    gains: Gains,
    jacobian: JacobianKind,
    matrix: Matrix6xX<f64>,
}

impl TransposeJacobian {
    /// The law for an arm with so many joints.
    pub fn new(config: &ControllerConfig, joints: usize) -> Self {
        Self {
            gains: config.gains.clone(),
            jacobian: config.jacobian,
            matrix: Matrix6xX::zeros(joints),
        }
    }
}

impl Law for TransposeJacobian {
    fn configure(&mut self, config: &ControllerConfig) {
        self.gains.clone_from(&config.gains);
        self.jacobian = config.jacobian;
    }

    fn feeds_forward(&self) -> bool {
        true
    }

    fn efforts(
        &mut self,
        arm: &mut Manipulator,
        seen: &Measurement<'_>,
        pull: &mut DVector<f64>,
    ) -> Result<ControlReport, LawError> {
        let mut report = ControlReport::on(seen);
        let Some((e_p, e_o)) = report.saturate(&self.gains.saturation) else {
            return Ok(report);
        };
        (self.jacobian).write(&mut arm.workspace, &arm.tip, &mut self.matrix);
        let (force, torque) = (e_p * self.gains.k_p, e_o * self.gains.k_o);
        transpose_times(&self.matrix, &force, &torque, pull);
        Ok(report)
    }
}

/// Joint efforts of a force and a torque on the tip, through the transpose of a Jacobian.
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
