//! Reference of the base's attitude, and the deviation of the base from it.

use nalgebra::{UnitQuaternion, Vector3};

/// Reference of the attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeTarget {
    /// Desired attitude of the base: frame D in the world.
    pub R_WD: UnitQuaternion<f64>,
    /// Angular velocity of D, axes of D \[rad/s\].
    pub w_WD_D: Vector3<f64>,
}

impl AttitudeTarget {
    /// A reference that does not turn.
    pub fn fixed(R_WD: UnitQuaternion<f64>) -> Self {
        Self {
            R_WD,
            w_WD_D: Vector3::zeros(),
        }
    }
}

/// Input of a law: deviation of attitude and rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeDeviation {
    /// Twice the vector part of the quaternion of `R_DB`, with the sign of the quaternion for which the real part is
    /// positive \[rad\]: to first order the rotation vector from reference to base, bounded by 2.
    pub angle: Vector3<f64>,
    /// Angular velocity of the base relative to the reference, base axes \[rad/s\].
    pub rate: Vector3<f64>,
}

impl AttitudeDeviation {
    /// Deviation of a base with this attitude and angular velocity (base axes).
    pub fn new(R_WB: &UnitQuaternion<f64>, w_WB_B: &Vector3<f64>, target: &AttitudeTarget) -> Self {
        let R_DB = target.R_WD.inverse() * R_WB;
        Self {
            angle: R_DB.imag() * 2.0_f64.copysign(R_DB.w),
            rate: w_WB_B - R_DB.inverse_transform_vector(&target.w_WD_D),
        }
    }

    /// The angle of the rotation from reference to base \[rad\].
    pub fn turn(&self) -> f64 {
        2.0 * (0.5 * self.angle.norm()).clamp(0.0, 1.0).asin()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviations_are_those_of_the_shorter_turn() {
        let axis = Vector3::new(0.6, 0.0, -0.8);
        for angle in [1e-9_f64, 0.3, 3.0, 3.3, 6.0] {
            let R_WD = UnitQuaternion::from_euler_angles(0.4, 2.0, -1.0);
            let R_WB = R_WD * UnitQuaternion::new(axis * angle);
            let w = Vector3::new(0.1, 0.2, 0.3);
            let target = AttitudeTarget { R_WD, w_WD_D: w };
            let deviation = AttitudeDeviation::new(&R_WB, &w, &target);
            let shorter = if angle > std::f64::consts::PI {
                angle - std::f64::consts::TAU
            } else {
                angle
            };
            assert!((deviation.angle - axis * 2.0 * (0.5 * shorter).sin()).norm() < 1e-15);
            assert!((deviation.turn() - shorter.abs()).abs() < 1e-12);
            // The reference rotates about an axis fixed in D, thus with the base only if both agree.
            let expected = w - (R_WD.inverse() * R_WB).inverse() * w;
            assert!((deviation.rate - expected).norm() < 1e-15);
        }
    }
}
