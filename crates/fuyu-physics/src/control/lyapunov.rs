//! Lyapunov function of the closed loop.

use nalgebra::DVector;

use super::{Gains, PoseError};
use crate::dynamics::Workspace;

/// `W = U + ½ q̇ᵀ Ĥ q̇` \[J\]: the artificial potential of the deviation and the kinetic energy, Masutani 1995
/// eq. (5.13), and with saturated errors eq. (5.27).
///
/// Under transpose-Jacobian control with the generalized Jacobian, `dW/dt = -q̇ᵀ K_V q̇` along the motion, eq. (5.19),
/// for any motion of the base, as long as momentum is zero and the goal is at rest in the world. With the fixed-base
/// Jacobian `W` may increase.
#[derive(Debug, Clone, PartialEq)]
pub struct LyapunovFunction {
    /// Gains of the law; `k_v` is not used in `W`.
    pub gains: Gains,
}

impl LyapunovFunction {
    /// For the gains of a law.
    pub fn new(gains: Gains) -> Self {
        Self { gains }
    }

    /// `U` \[J\].
    pub fn potential(&self, error: &PoseError) -> f64 {
        Self::potential_of(&self.gains, error)
    }

    pub(super) fn potential_of(gains: &Gains, error: &PoseError) -> f64 {
        gains.saturation.potential(error, gains.k_p, gains.k_o)
    }

    /// `W` \[J\] for a deviation and joint rates; `workspace` holds the joint positions.
    pub fn value(&self, workspace: &mut Workspace, qd: &DVector<f64>, error: &PoseError) -> f64 {
        let inertia = workspace.reduced_inertia();
        let n = qd.len();
        let twice: f64 = (0..n).map(|i| qd[i] * inertia.column(i).dot(qd)).sum();
        self.potential(error) + 0.5 * twice
    }

    /// `dW/dt = -q̇ᵀ K_V q̇` \[W\], eq. (5.19).
    pub fn rate(&self, qd: &DVector<f64>) -> f64 {
        let pairs = self.gains.k_v.iter().zip(qd);
        -pairs.map(|(k, qd)| k * qd * qd).sum::<f64>()
    }
}
