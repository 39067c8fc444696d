//! The aperiodic solution: the body turns over once, from one direction of its middle axis to the other. Masutani 1995
//! eqs. (2.12), (2.44)-(2.49).

use nalgebra::{UnitQuaternion, Vector3};

use super::DynamicParameters;
use crate::estimation::elliptic::gudermannian;

/// The motion as a function of `s`, the time since the fastest moment. The rotation in space
/// depends on `alpha` and `lambda` alone; the moments are known only if they are given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Aperiodic {
    pub alpha: f64,
    /// `|lambda|` \[rad/s\].
    pub lambda: f64,
    pub parameters: Option<DynamicParameters>,
}

impl Aperiodic {
    /// Angular velocity in the reference frame \[rad/s\], (2.45) and (2.46).
    pub fn velocity(&self, s: f64) -> Vector3<f64> {
        let rate = self.alpha.sqrt().recip();
        let (sin, cos) = (rate * s).sin_cos();
        let radius = self.lambda / (self.lambda * s).cosh();
        Vector3::new(radius * cos, radius * sin, rate)
    }

    /// Attitude in the reference frame of the body-fixed frame that coincides with it at `s = 0`;
    /// (2.47)-(2.49). In the print the integral of (2.48) starts at time zero; here it starts at `s = 0`.
    pub fn attitude(&self, s: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), s / self.alpha.sqrt())
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), gudermannian(self.lambda * s))
    }
}

/// Rates in principal axes \[rad/s\] at `u = lambda t - delta`, (2.12).
pub(super) fn rates(parameters: &DynamicParameters, u: f64) -> Vector3<f64> {
    let sech = u.cosh().recip();
    let amplitudes = parameters.squared_amplitudes().map(f64::sqrt);
    Vector3::new(
        amplitudes.x * sech,
        u.tanh() / parameters.alpha().sqrt(),
        amplitudes.z * sech,
    )
}
