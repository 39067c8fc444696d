//! The asymmetric and the axisymmetric solution: Masutani 1995 eqs. (2.9)-(2.11), (2.13), (2.14) and the
//! attitude (2.16)-(2.23).

use nalgebra::{UnitQuaternion, Vector3};

use super::DynamicParameters;
use crate::estimation::elliptic::{Jacobi, Modulus};

/// Rates and attitude as functions of the argument `u = lambda t - delta` of the elliptic functions. With
/// `k = 0` they are circular functions, and the solution is the axisymmetric one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Periodic {
    pub parameters: DynamicParameters,
    amplitudes: Vector3<f64>,
    modulus: Modulus,
    pub lambda: f64,
    nu: f64,
}

impl Periodic {
    pub fn new(parameters: DynamicParameters) -> Self {
        Self {
            amplitudes: parameters.squared_amplitudes().map(f64::sqrt),
            modulus: parameters.modulus(),
            lambda: parameters.lambda(),
            nu: parameters.unevenness(),
            parameters,
        }
    }

    /// The argument `u` in [-K, K] at which the rates are `w`, with `w.x` not negative.
    pub fn argument(&self, w: &Vector3<f64>) -> f64 {
        let (sn, cn) = (w.y / self.amplitudes.y, w.x / self.amplitudes.x);
        let norm = sn.hypot(cn);
        if norm > 0.0 && norm.is_finite() {
            self.modulus.argument(sn / norm, cn / norm)
        } else {
            0.0
        }
    }

    /// Angular velocity in principal axes \[rad/s\], (2.9), (2.13).
    pub fn rates(&self, u: f64) -> Vector3<f64> {
        let Jacobi { sn, cn, dn } = self.modulus.jacobi(u);
        self.amplitudes.component_mul(&Vector3::new(cn, sn, dn))
    }

    /// Precession angle φ from `u0` to `u` in `duration` \[s\]: the integral of (2.23), which in the
    /// solution (2.9) is
    /// `φ' = √α/J_x + √α (J_x - J_z)/(J_x J_z) · ν sn² / (1 + ν sn²)`.
    pub fn precession(&self, u0: f64, u: f64, duration: f64) -> f64 {
        let J = self.parameters.J();
        let rate = self.parameters.alpha().sqrt() / J.x;
        if self.nu == 0.0 {
            return rate * duration;
        }
        let excess = self.modulus.third_kind_excess(self.nu, u)
            - self.modulus.third_kind_excess(self.nu, u0);
        rate * (duration + (J.x - J.z) / (J.z * self.lambda) * excess)
    }

    /// Attitude of the principal axes in the reference frame, whose z is along the momentum, for precession
    /// angle φ; (2.16) with the angles (2.21) and (2.22).
    pub fn attitude(&self, u: f64, precession: f64) -> UnitQuaternion<f64> {
        let Jacobi { sn, cn, dn } = self.modulus.jacobi(u);
        let J = self.parameters.J();
        // Momentum in principal axes over 2E. Its x and y components share the factor that vanishes with nutation.
        let L = J.component_mul(&self.amplitudes);
        let (x, y) = (L.x * cn, L.y * sn);
        let nutation = x.hypot(y).atan2(L.z * dn);
        let spin = (L.x * cn).atan2(L.y * sn);
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), precession)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), nutation)
            * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), spin)
    }
}
