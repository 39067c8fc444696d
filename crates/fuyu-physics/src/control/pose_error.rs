//! Deviation of the tip from the goal, and its saturation.

use std::f64::consts::{PI, SQRT_2};

use nalgebra::{Matrix3, Vector3};

use super::gains::{ConfigError, check_positive};
use crate::spatial::Pose;

/// Deviation of the tip E from the goal D, in base axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseError {
    /// `e_p = r_D - r_E` \[m\], Masutani 1995 eq. (5.1).
    pub position: Vector3<f64>,
    /// `e_o = ½ (X_E×X_D + Y_E×Y_D + Z_E×Z_D)`, Masutani 1995 eq. (5.2): the rotation axis from E to D
    /// times the sine of the angle.
    pub orientation: Vector3<f64>,
    /// `|E_o|` of Masutani 1995 eq. (5.12): `2√2 sin(θ/2)`, zero only at the goal, largest (2√2) half a turn away,
    /// where `e_o` also vanishes.
    pub axes_norm: f64,
    /// Angle from E to D \[rad\], in [0, π].
    pub angle: f64,
    /// Within [`HALF_TURN_CAP`] of half a turn, the unit vector along the axis of the rotation from E to D, which `e_o`
    /// does not determine there. Zero elsewhere.
    pub half_turn_axis: Vector3<f64>,
}

/// Angle from half a turn within which the orientation error no longer decreases \[rad\].
///
/// Half a turn from the goal `e_o` vanishes, eq. (5.5), and the law of the thesis rests there without having reached
/// the goal. Within this angle the orientation error is therefore constant, about the axis of the rotation: the potential
/// becomes a cone with a ridge at half a turn, from which it decreases to both sides. It remains continuous, the proof of
/// stability remains valid, and the tip leaves the ridge; on the ridge both directions of rotation are equally good.
pub const HALF_TURN_CAP: f64 = 0.05;

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
        let half_turn_axis = if angle > PI - HALF_TURN_CAP {
            axis_of(&(d * e.transpose()), &orientation)
        } else {
            Vector3::zeros()
        };
        Self {
            position,
            orientation,
            axes_norm,
            angle,
            half_turn_axis,
        }
    }

    /// Whether distance \[m\] and angle \[rad\] do not exceed these values.
    pub(super) fn is_within(&self, (distance, angle): (f64, f64)) -> bool {
        self.position.norm() <= distance && self.angle <= angle
    }
}

/// Unit vector along the axis of a rotation of nearly half a turn, on the side of `sense`.
fn axis_of(rotation: &Matrix3<f64>, sense: &Vector3<f64>) -> Vector3<f64> {
    // R + Rᵀ = 2 cos θ + 2 (1 - cos θ) n nᵀ, whose longest column is the most accurate.
    let cos = 0.5 * (rotation.trace() - 1.0);
    let outer = (rotation + rotation.transpose()) * 0.5 - Matrix3::identity() * cos;
    let n = outer.column(outer.diagonal().imax()).normalize();
    if n.dot(sense) < 0.0 { -n } else { n }
}

/// `|E_o|/√2` at the edge of the cap.
fn edge() -> f64 {
    2.0 * (0.5 * HALF_TURN_CAP).cos()
}

/// Largest deviations without saturation: the potential is parabolic within these bounds and conical beyond.
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

    /// Refuses bounds that are not positive; an infinite one means no saturation.
    ///
    /// # Errors
    /// [`ConfigError`] names the bound.
    pub fn check(&self) -> Result<(), ConfigError> {
        for (name, bound) in [("e_p_max", self.position), ("e_o_max", self.orientation)] {
            if bound != f64::INFINITY {
                check_positive(name, bound)?;
            }
        }
        Ok(())
    }

    /// Both errors, saturated.
    pub fn saturate(&self, error: &PoseError) -> SaturatedError {
        let (position, position_saturated) = self.position_error(error);
        let (orientation, orientation_saturated) = self.orientation_error(error);
        SaturatedError {
            pose: *error,
            position,
            orientation,
            position_saturated,
            orientation_saturated,
        }
    }

    /// Saturated position error, Masutani 1995 eq. (5.25), and whether it was saturated.
    pub fn position_error(&self, error: &PoseError) -> (Vector3<f64>, bool) {
        let norm = error.position.norm();
        if norm > self.position {
            (error.position * (self.position / norm), true)
        } else {
            (error.position, false)
        }
    }

    /// Saturated orientation error, Masutani 1995 eq. (5.26), and whether it was saturated. Near half a turn it is
    /// constant, see [`HALF_TURN_CAP`].
    pub fn orientation_error(&self, error: &PoseError) -> (Vector3<f64>, bool) {
        let (e_o, scaled) = if error.angle > PI - HALF_TURN_CAP {
            (error.half_turn_axis * HALF_TURN_CAP.sin(), edge())
        } else {
            (error.orientation, error.axes_norm / SQRT_2)
        };
        if scaled > self.orientation {
            (e_o * (self.orientation / scaled), true)
        } else {
            (e_o, false)
        }
    }

    /// Artificial potential `U` \[J\] of Masutani 1995 eqs. (5.22)-(5.24) for gains `k_p`, `k_o`, with constant slope
    /// within [`HALF_TURN_CAP`] of half a turn.
    pub fn potential(&self, error: &PoseError, k_p: f64, k_o: f64) -> f64 {
        let composite = |x: f64, max: f64| {
            if x <= max {
                0.5 * x * x
            } else {
                max * (x - 0.5 * max)
            }
        };
        // |E_o|²/4 = (|E_o|/√2)²/2, and the conical branch of (5.24) follows the same substitution.
        let within = error.angle - (PI - HALF_TURN_CAP);
        let (scaled, cap) = if within > 0.0 {
            let slope = HALF_TURN_CAP.sin() * (self.orientation / edge()).min(1.0);
            (edge(), slope * within)
        } else {
            (error.axes_norm / SQRT_2, 0.0)
        };
        k_p * composite(error.position.norm(), self.position)
            + k_o * (composite(scaled, self.orientation) + cap)
    }
}

/// Deviation of the tip after saturation, on which a law acts; base axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SaturatedError {
    /// The deviation before saturation.
    pub pose: PoseError,
    /// `ē_p` \[m\], Masutani 1995 eq. (5.25).
    pub position: Vector3<f64>,
    /// `ē_o`, Masutani 1995 eq. (5.26), constant within [`HALF_TURN_CAP`] of half a turn.
    pub orientation: Vector3<f64>,
    /// Whether the position error was saturated.
    pub position_saturated: bool,
    /// Whether the orientation error was saturated.
    pub orientation_saturated: bool,
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
            let along = error.half_turn_axis.dot(&axis);
            assert!(angle < 3.1 && along == 0.0 || (along.abs() - 1.0).abs() < 1e-14);
        }
    }

    fn turned_from(d: &Pose, angle: f64) -> Pose {
        let axis = Vector3::new(0.36, 0.48, 0.8);
        Pose::from_parts(d.translation, Rotation3::new(axis * angle) * d.rotation)
    }

    /// Eq. (5.5): half a turn from the goal the orientation error of the thesis is zero. Fails without the cap.
    #[test]
    fn orientation_error_does_not_vanish_half_a_turn_from_the_goal() {
        let d = pose([0.3, 0.1, -0.2], [0.2, 0.5, -0.4]);
        for saturation in [
            Saturation::NONE,
            Saturation {
                position: 0.2,
                orientation: 0.1,
            },
        ] {
            let saturated = |angle: f64| {
                let error = PoseError::between(&turned_from(&d, angle), &d);
                saturation.orientation_error(&error).0
            };
            let (edge, ridge) = (saturated(PI - HALF_TURN_CAP), saturated(PI));
            assert!(edge.norm() > 1e-3 && (edge.norm() - ridge.norm()).abs() < 1e-12);
            // Continuous at the edge, and opposite on the two sides of the ridge.
            assert!((saturated(PI - HALF_TURN_CAP + 1e-9) - edge).norm() < 1e-9);
            assert!((saturated(PI - 1e-6) + saturated(PI + 1e-6)).norm() < 1e-6);
        }
    }

    #[test]
    fn saturated_errors_are_the_gradient_of_the_potential() {
        // A displacement δ of the tip changes U by -k ē·δ. Fails with a wrong factor √2 in (5.24) or (5.26).
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
            (
                Saturation {
                    position: 0.2,
                    orientation: 0.1,
                },
                turned_from(&d, 3.12),
            ),
            (Saturation::NONE, turned_from(&d, 3.12)),
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
