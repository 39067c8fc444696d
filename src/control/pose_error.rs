//! Deviation of the tip from the goal, and its saturation.

use nalgebra::Vector3;

use super::gains::{GainError, check_positive};
use crate::spatial::Pose;

/// Deviation of the tip E from the goal D, in base axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseError {
    /// `e_p = r_D - r_E` \[m\], Masutani 1995 eq. (5.1).
    pub position: Vector3<f64>,
    /// `e_o = ½ (X_E×X_D + Y_E×Y_D + Z_E×Z_D)`, Masutani 1995 eq. (5.2): the rotation axis from E to D
    /// times the sine of the angle.
    pub orientation: Vector3<f64>,
    /// `|E_o|` of Masutani 1995 eq. (5.12): `2√2 sin(θ/2)`, zero only at the goal, largest (2√2) half
    /// a turn away, where `e_o` vanishes too.
    pub axes_norm: f64,
    /// Angle from E to D \[rad\], in [0, π].
    pub angle: f64,
}

impl PoseError {
    /// Deviation of the tip pose `X_BE` from the goal pose `X_BD`.
    pub fn between(X_BE: &Pose, X_BD: &Pose) -> Self {
        let (e, d) = (X_BE.rotation.matrix(), X_BD.rotation.matrix());
        let mut orientation = Vector3::zeros();
        let mut axes_sq = 0.0;
        for k in 0..3 {
            orientation += e.column(k).cross(&d.column(k)) * 0.5;
            axes_sq += (d.column(k) - e.column(k)).norm_squared();
        }
        let axes_norm = axes_sq.sqrt();
        // sin θ = |e_o| and 2 - 2 cos θ = |E_o|²/2: the arc tangent is accurate near 0 and near π.
        let angle = orientation.norm().atan2(1.0 - 0.25 * axes_sq);
        let position = X_BD.translation.vector - X_BE.translation.vector;
        Self {
            position,
            orientation,
            axes_norm,
            angle,
        }
    }
}

/// Largest deviations that act in full: the composite potential, parabolic within and conical beyond.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Saturation {
    /// `e_pmax` \[m\].
    pub position: f64,
    /// `e_omax`, compared with `|E_o|/√2`.
    pub orientation: f64,
}

impl Saturation {
    /// No saturation: the parabolic potential of eq. (5.3).
    pub const NONE: Self = Self {
        position: f64::INFINITY,
        orientation: f64::INFINITY,
    };

    /// Refuses bounds that are not positive; infinite means no saturation.
    ///
    /// # Errors
    /// [`GainError`] names the bound.
    pub fn check(&self) -> Result<(), GainError> {
        for (name, bound) in [("e_p_max", self.position), ("e_o_max", self.orientation)] {
            if bound != f64::INFINITY {
                check_positive(name, bound)?;
            }
        }
        Ok(())
    }

    /// Saturated position error, Masutani 1995 eq. (5.25), and whether it was cut.
    pub fn position_error(&self, error: &PoseError) -> (Vector3<f64>, bool) {
        let norm = error.position.norm();
        if norm > self.position {
            (error.position * (self.position / norm), true)
        } else {
            (error.position, false)
        }
    }

    /// Saturated orientation error, Masutani 1995 eq. (5.26), and whether it was cut.
    pub fn orientation_error(&self, error: &PoseError) -> (Vector3<f64>, bool) {
        let scaled = error.axes_norm / std::f64::consts::SQRT_2;
        if scaled > self.orientation {
            (error.orientation * (self.orientation / scaled), true)
        } else {
            (error.orientation, false)
        }
    }

    /// Artificial potential `U` \[J\] of Masutani 1995 eqs. (5.22)-(5.24) for gains `k_p`, `k_o`.
    pub fn potential(&self, error: &PoseError, k_p: f64, k_o: f64) -> f64 {
        let composite = |x: f64, max: f64| {
            if x <= max {
                0.5 * x * x
            } else {
                max * (x - 0.5 * max)
            }
        };
        // |E_o|²/4 = (|E_o|/√2)²/2, and the conical branch of (5.24) follows the same substitution.
        k_p * composite(error.position.norm(), self.position)
            + k_o * composite(error.axes_norm / std::f64::consts::SQRT_2, self.orientation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Translation3};

    fn pose(xyz: [f64; 3], axis: [f64; 3]) -> Pose {
        Pose::from_parts(Translation3::from(xyz), Rotation3::new(Vector3::from(axis)))
    }

    #[test]
    fn orientation_error_is_axis_times_sine() {
        let axis = Vector3::new(0.36, 0.48, 0.8);
        for angle in [0.0, 1e-9, 0.3, 1.7, 3.1, std::f64::consts::PI] {
            let e = pose([0.0; 3], [0.4, -1.0, 0.2]);
            let d = Pose::from_parts(e.translation, Rotation3::new(axis * angle) * e.rotation);
            let error = PoseError::between(&e, &d);
            assert!((error.orientation - axis * angle.sin()).norm() < 1e-15);
            assert!((error.axes_norm - 8f64.sqrt() * (angle / 2.0).sin()).abs() < 1e-15);
            assert!(
                (error.angle - angle).abs() < 1e-15,
                "{angle} {}",
                error.angle
            );
        }
    }

    #[test]
    fn saturated_errors_are_the_gradient_of_the_potential() {
        // Moving the tip by δ changes U by -k ē·δ; a wrong factor √2 in (5.24) or (5.26) breaks this.
        let (k_p, k_o) = (75.0, 100.0);
        let d = pose([0.3, 0.1, -0.2], [0.2, 0.5, -0.4]);
        for (saturation, tip) in [
            (
                Saturation {
                    position: 0.2,
                    orientation: 0.1,
                },
                pose([1.0, 0.0, 0.0], [0.4, -1.0, 0.2]),
            ),
            (
                Saturation {
                    position: 0.2,
                    orientation: 0.1,
                },
                pose([0.31, 0.1, -0.2], [0.21, 0.5, -0.4]),
            ),
            (Saturation::NONE, pose([1.0, 0.0, 0.0], [0.4, -1.0, 0.2])),
        ] {
            let u = |e: &Pose| saturation.potential(&PoseError::between(e, &d), k_p, k_o);
            let error = PoseError::between(&tip, &d);
            let force = saturation.position_error(&error).0 * k_p;
            let torque = saturation.orientation_error(&error).0 * k_o;
            let h = 1e-6;
            for axis in 0..3 {
                let mut delta = Vector3::zeros();
                delta[axis] = h;
                let moved = |s: f64| {
                    Pose::from_parts(
                        Translation3::from(delta * s) * tip.translation,
                        tip.rotation,
                    )
                };
                let turned = |s: f64| {
                    Pose::from_parts(tip.translation, Rotation3::new(delta * s) * tip.rotation)
                };
                let linear = (u(&moved(1.0)) - u(&moved(-1.0))) / (2.0 * h);
                let angular = (u(&turned(1.0)) - u(&turned(-1.0))) / (2.0 * h);
                assert!((linear + force[axis]).abs() < 1e-6, "force {axis}");
                assert!((angular + torque[axis]).abs() < 1e-6, "torque {axis}");
            }
        }
    }
}
