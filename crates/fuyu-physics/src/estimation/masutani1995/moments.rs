//! Moments from the waveform: Masutani 1995 eqs. (2.36)-(2.39), (2.51), (2.52) and app. E.

use nalgebra::Vector3;

/// Quantities from the waveform and the invariable plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observed {
    pub alpha: f64,
    /// Largest and least `|w|²` \[rad²/s²\].
    pub beta: f64,
    pub gamma: f64,
    pub k: f64,
    /// Mean rate of the herpolhode's angle, `A` \[rad/s\].
    pub precession: f64,
}

impl Observed {
    /// `J_x, J_y, J_z` of the asymmetric model; not necessarily moments that a body can have.
    ///
    /// The quadratic (2.38) is solved in the form without cancellation where its leading coefficient vanishes,
    /// at `alpha = 2 J_z` (E.9). There is a second admissible root only if that coefficient is
    /// negative; then the herpolhode decides.
    pub fn asymmetric(&self) -> Vector3<f64> {
        let Self {
            alpha, beta, gamma, ..
        } = *self;
        let k_squared = self.k * self.k;
        let common = k_squared * (alpha * beta - 1.0) - alpha * (beta - gamma);
        let c2 = k_squared * gamma * (alpha * beta - 1.0) - (beta - gamma);
        let c1 = -2.0 * common;
        let c0 = alpha * common;
        let root = (c1 * c1 - 4.0 * c2 * c0).sqrt();
        let low = -2.0 * c0 / (c1 + root);
        let runs_ahead = self.precession * alpha.sqrt() > 1.0;
        let jz = if c2 < 0.0 && runs_ahead {
            (c1 + root) / (-2.0 * c2)
        } else {
            low
        };
        let other = |square: f64| (jz - alpha) / (square * jz - 1.0);
        Vector3::new(other(beta), other(gamma), jz)
    }
}

/// `J_x = J_y` and `J_z` of the axisymmetric model, from the mean `|w|²`, `alpha` and the herpolhode's rate.
pub(super) fn axisymmetric(alpha: f64, mean_square: f64, precession: f64) -> Vector3<f64> {
    let jx = alpha.sqrt() / precession;
    let jz = (jx - alpha) / (mean_square * jx - 1.0);
    Vector3::new(jx, jx, jz)
}
