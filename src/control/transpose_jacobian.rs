//! Transpose-Jacobian control.

use nalgebra::{DVector, Matrix6xX};

use super::{GainError, Measurement, PoseError, Saturation, check_joint_gains, check_positive};
use crate::dynamics::Workspace;
use crate::model::{Frame, Model};

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
}

/// Gains of the law.
#[derive(Debug, Clone, PartialEq)]
pub struct Gains {
    /// Position gain `k_p` \[N/m\] (the thesis prints N).
    pub k_p: f64,
    /// Orientation gain `k_o` \[N m\].
    pub k_o: f64,
    /// Diagonal of the velocity gain `K_V` \[N m s/rad or N s/m\], one per joint.
    pub k_v: Vec<f64>,
    /// Saturation of the errors.
    pub saturation: Saturation,
}

impl Gains {
    /// Refuses gains that break the law's stability proof.
    ///
    /// # Errors
    /// [`GainError`] when a gain is not positive or `k_v` does not have one value per joint.
    pub fn check(&self, joints: usize) -> Result<(), GainError> {
        check_positive("k_p", self.k_p)?;
        check_positive("k_o", self.k_o)?;
        check_joint_gains("k_v", &self.k_v, joints)?;
        self.saturation.check()
    }
}

/// The law `τ = k_p Ĵ_Lᵀ ē_p + k_o Ĵ_Aᵀ ē_o - K_V q̇`, Masutani 1995 eq. (5.3) with the saturated errors of
/// eqs. (5.25), (5.26).
#[derive(Debug, Clone)]
pub struct TransposeJacobian {
    /// Gains; may change between calls.
    pub gains: Gains,
    /// Which Jacobian; may change between calls.
    pub jacobian: JacobianKind,
    tip: Frame,
    matrix: Matrix6xX<f64>,
}

impl TransposeJacobian {
    /// The law for `model` with its tip at `tip`.
    ///
    /// # Errors
    /// [`GainError`] as in [`Gains::check`].
    pub fn new(
        model: &Model,
        tip: &Frame,
        gains: Gains,
        jacobian: JacobianKind,
    ) -> Result<Self, GainError> {
        gains.check(model.dof())?;
        let matrix = Matrix6xX::zeros(model.dof());
        Ok(Self {
            gains,
            jacobian,
            tip: tip.clone(),
            matrix,
        })
    }

    /// Writes joint efforts \[N m or N\] for `seen` and returns the deviation acted on. `workspace` is
    /// scratch: its positions are set here from the encoders.
    pub fn efforts(
        &mut self,
        model: &Model,
        workspace: &mut Workspace,
        seen: &Measurement,
        efforts: &mut DVector<f64>,
    ) -> PoseError {
        let error = PoseError::between(seen.X_BE, seen.X_BD);
        let saturation = &self.gains.saturation;
        let force = saturation.position_error(&error).0 * self.gains.k_p;
        let torque = saturation.orientation_error(&error).0 * self.gains.k_o;
        workspace.set_positions(model, seen.q);
        match self.jacobian {
            JacobianKind::Generalized => {
                workspace.generalized_jacobian(&self.tip, &mut self.matrix);
            }
            JacobianKind::FixedBase => {
                workspace.fixed_base_jacobian(&self.tip, &mut self.matrix);
            }
        }
        for (j, column) in self.matrix.column_iter().enumerate() {
            efforts[j] = column.fixed_rows::<3>(0).dot(&force)
                + column.fixed_rows::<3>(3).dot(&torque)
                - self.gains.k_v[j] * seen.qd[j];
        }
        error
    }
}
