//! Resolved-rate control: joint rates for a commanded twist of the tip, Masutani 1995 section 8.3.

mod damped_inverse;
mod limits;

pub(super) use damped_inverse::Principal;
pub use limits::{Limited, RateLimits, limit_twist};

use nalgebra::{DVector, Matrix6xX, Vector6};

use super::JacobianKind;
use crate::{
    dynamics::Workspace,
    model::{Frame, Model},
    spatial::Twist,
};

/// Method that resolves a twist of the tip into joint rates: the four of Masutani 1995 section 8.3.
///
/// With a generalized Jacobian the command is the tip's motion in inertial space, with a fixed-base Jacobian its motion
/// relative to the base. Inverses move the tip as commanded. Transposes only give its velocity a positive component
/// along the command, but are defined in singular postures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resolution {
    /// `q̇ = Ĵ⁻¹ v`: the tip moves as commanded in inertial space.
    InverseGeneralized,
    /// `q̇ = J⁻¹ v`: the tip moves as commanded relative to the base.
    InverseFixedBase,
    /// `q̇ = k Ĵᵀ v`.
    TransposeGeneralized,
    /// `q̇ = k Jᵀ v`.
    TransposeFixedBase,
}

impl Resolution {
    /// All of them by name, in the order of the thesis.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("inverse_generalized", Self::InverseGeneralized),
        ("inverse_fixed_base", Self::InverseFixedBase),
        ("transpose_generalized", Self::TransposeGeneralized),
        ("transpose_fixed_base", Self::TransposeFixedBase),
    ];

    /// The Jacobian of the method.
    pub fn jacobian(self) -> JacobianKind {
        match self {
            Self::InverseGeneralized | Self::TransposeGeneralized => JacobianKind::Generalized,
            Self::InverseFixedBase | Self::TransposeFixedBase => JacobianKind::FixedBase,
        }
    }

    /// Whether the method inverts its Jacobian.
    pub fn inverts(self) -> bool {
        matches!(self, Self::InverseGeneralized | Self::InverseFixedBase)
    }
}

/// Settings of a resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResolvedRateConfig {
    /// The method.
    pub method: Resolution,
    /// Which of the tip's x, y, z, roll, pitch, yaw rates are commanded; the others are free.
    pub components: [bool; 6],
    /// Length that weights angular rates against velocities \[m\].
    pub characteristic_length: f64,
    /// Singular value of the (scaled) Jacobian below which a direction is damped \[m\].
    pub damping_threshold: f64,
    /// Gain `k` of the transposes \[1/m²\]; 1 in the thesis.
    pub transpose_gain: f64,
}

impl Default for ResolvedRateConfig {
    fn default() -> Self {
        Self {
            method: Resolution::InverseGeneralized,
            components: [true; 6],
            characteristic_length: 1.0,
            damping_threshold: 0.1,
            transpose_gain: 1.0,
        }
    }
}

/// Condition of the posture in which a twist was resolved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resolved {
    /// Smallest singular value of the Jacobian, restricted to the commanded components \[m\].
    pub smallest_singular_value: f64,
    /// Whether a direction was damped, so that the tip does not move exactly as commanded. Never with a transpose.
    pub damped: bool,
}

/// Resolves twists of one tip.
///
/// Inverses are `q̇ = Jᵀ (J Jᵀ + Λ)⁻¹ v` with the Jacobian's commanded rows, the angular ones multiplied by
/// [`ResolvedRateConfig::characteristic_length`]. This is the least-norm solution for redundant joints and the
/// least-squares solution for too few. `Λ` damps each principal direction separately: by zero if its singular value `σ`
/// is above the threshold `ε`, otherwise by `λ² = (ε² - σ²)/4`. So directions far from singular are exact, rates change
/// continuously, and their norm is at most `2/√3 |v|/ε`.
#[derive(Debug, Clone)]
pub struct ResolvedRate {
    /// Settings; may change between calls.
    pub config: ResolvedRateConfig,
    tip: Frame,
    matrix: Matrix6xX<f64>,
}

impl ResolvedRate {
    /// A resolver for `model` with its tip at `tip`.
    pub fn new(model: &Model, tip: &Frame, config: ResolvedRateConfig) -> Self {
        Self {
            config,
            tip: tip.clone(),
            matrix: Matrix6xX::zeros(model.dof()),
        }
    }

    /// The tip.
    pub fn tip(&self) -> &Frame {
        &self.tip
    }

    /// Writes joint rates \[rad/s or m/s\] for the twist `V_B` of the tip's origin, in base axes. `workspace` is
    /// scratch, whose positions are set here to the encoders' `q`.
    pub fn rates(
        &mut self,
        model: &Model,
        workspace: &mut Workspace,
        q: &DVector<f64>,
        V_B: &Twist,
        rates: &mut DVector<f64>,
    ) -> Resolved {
        let config = &self.config;
        workspace.set_positions(q);
        match config.method.jacobian() {
            JacobianKind::Generalized => {
                workspace.generalized_jacobian(&self.tip, &mut self.matrix);
            }
            JacobianKind::FixedBase => workspace.fixed_base_jacobian(&self.tip, &mut self.matrix),
        }
        let weight = |row: usize| match (config.components[row], row < 3) {
            (false, _) => 0.0,
            (true, true) => 1.0,
            (true, false) => config.characteristic_length,
        };
        let weights = Vector6::from_fn(|row, _| weight(row));
        for mut column in self.matrix.column_iter_mut() {
            column.component_mul_assign(&weights);
        }
        let mut v = Vector6::zeros();
        v.fixed_rows_mut::<3>(0).copy_from(&V_B.linear);
        v.fixed_rows_mut::<3>(3).copy_from(&V_B.angular);
        v.component_mul_assign(&weights);
        let principal = Principal::of(&self.matrix);
        let commanded = config.components.iter().filter(|c| **c).count();
        let weakest = principal.weakest(commanded.min(model.dof()));
        if config.method.inverts() {
            let scaled = principal.solve(&v, config.damping_threshold);
            self.matrix.tr_mul_to(&scaled, rates);
        } else {
            self.matrix.tr_mul_to(&v, rates);
            *rates *= config.transpose_gain;
        }
        Resolved {
            smallest_singular_value: weakest,
            damped: config.method.inverts() && weakest < config.damping_threshold,
        }
    }
}
