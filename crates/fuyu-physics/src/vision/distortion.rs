//! Lens distortion: the models of `sensor_msgs/CameraInfo`, and their removal from image points.

use nalgebra::{Matrix2, Vector2};

use super::Pinhole;

/// A model of lens distortion with its coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// `plumb_bob` (Brown 1966): `k1, k2, p1, p2, k3`; three radial and two tangential coefficients.
    PlumbBob([f64; 5]),
    /// `equidistant` (Kannala and Brandt 2006, the fisheye model of OpenCV): `k1` to `k4` of
    /// `θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)`, with θ the angle from the optical axis.
    Equidistant([f64; 4]),
}

/// Why coefficients are not those of a lens.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DistortionError {
    /// The model is not known.
    #[error("distortion model '{0}' is not known; available are plumb_bob and equidistant")]
    Model(String),
    /// The number of coefficients is wrong.
    #[error("distortion model {model} has {have} coefficients; it must have {need}")]
    Count {
        /// The model.
        model: &'static str,
        /// Number of coefficients.
        have: usize,
        /// The right number.
        need: &'static str,
    },
    /// A coefficient is NaN or infinite.
    #[error("a distortion coefficient is {0}; it must be finite")]
    Value(f64),
    /// An image point lies where the lens shows nothing.
    #[error(
        "the distortion cannot be removed at pixel ({u:.1}, {v:.1}): the lens does not show anything there; check the coefficients"
    )]
    Outside {
        /// Column \[px\].
        u: f64,
        /// Row \[px\].
        v: f64,
    },
}

/// Largest error of a removed distortion, over the focal length.
const TOLERANCE: f64 = 1e-9;

/// Largest number of Newton steps.
const STEPS: usize = 30;

impl Distortion {
    /// The distortion of a `CameraInfo` with `distortion_model` and coefficients `d`. `None` without distortion:
    /// without coefficients, or if all are zero, even for an unknown model; but not for an equidistant lens, whose
    /// image radius is the angle, not its tangent, even with zero coefficients.
    ///
    /// # Errors
    /// [`DistortionError`] if there are coefficients, and the model is unknown or has a different number of them.
    pub fn new(model: &str, d: &[f64]) -> Result<Option<Self>, DistortionError> {
        if let Some(value) = d.iter().find(|d| !d.is_finite()) {
            return Err(DistortionError::Value(*value));
        }
        let is_straight = d.is_empty() || model != "equidistant";
        if is_straight && d.iter().all(|d| *d == 0.0) {
            return Ok(None);
        }
        let wrong = |model, need| DistortionError::Count {
            model,
            have: d.len(),
            need,
        };
        match model {
            "plumb_bob" | "" => {
                if !(4..=5).contains(&d.len()) {
                    return Err(wrong("plumb_bob", "4 or 5"));
                }
                let k = |i: usize| d.get(i).copied().unwrap_or_default();
                Ok(Some(Self::PlumbBob([k(0), k(1), k(2), k(3), k(4)])))
            }
            "equidistant" => match d {
                [a, b, c, e] => Ok(Some(Self::Equidistant([*a, *b, *c, *e]))),
                _ => Err(wrong("equidistant", "4")),
            },
            other => Err(DistortionError::Model(other.to_owned())),
        }
    }

    /// Distorted coordinates of a point at `n`, both in units of the focal length.
    pub fn distort(&self, n: &Vector2<f64>) -> Vector2<f64> {
        match self {
            Self::PlumbBob([k1, k2, p1, p2, k3]) => {
                let r2 = n.norm_squared();
                let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                let xy = 2.0 * n.x * n.y;
                n * radial
                    + Vector2::new(
                        p1 * xy + p2 * (r2 + 2.0 * n.x * n.x),
                        p1 * (r2 + 2.0 * n.y * n.y) + p2 * xy,
                    )
            }
            Self::Equidistant([k1, k2, k3, k4]) => {
                let r = n.norm();
                if r < 1e-12 {
                    return *n;
                }
                let angle = r.atan();
                let a2 = angle * angle;
                let distorted = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))));
                n * (distorted / r)
            }
        }
    }

    /// The point whose distorted coordinates are `d`, both in units of the focal length, by Newton's method. `None`
    /// where there is none.
    pub fn undistort(&self, d: &Vector2<f64>) -> Option<Vector2<f64>> {
        let mut n = match self {
            Self::PlumbBob(_) => *d,
            // With zero coefficients the radius is the angle.
            Self::Equidistant(_) => {
                let angle = d.norm().min(1.5);
                d * (angle.tan() / angle.max(1e-12))
            }
        };
        for _ in 0..STEPS {
            let off = self.distort(&n) - d;
            if off.norm() < TOLERANCE {
                return Some(n);
            }
            let h = 1e-6 * (1.0 + n.norm());
            let column = |step: Vector2<f64>| {
                (self.distort(&(n + step)) - self.distort(&(n - step))) / (2.0 * h)
            };
            let slope = Matrix2::from_columns(&[
                column(Vector2::new(h, 0.0)),
                column(Vector2::new(0.0, h)),
            ]);
            // Beyond a fold the lens shows nothing.
            if slope.determinant() <= 0.0 {
                return None;
            }
            n -= slope.try_inverse()? * off;
            if !n.iter().all(|x| x.is_finite()) {
                return None;
            }
        }
        None
    }

    /// The pixel at which a camera without distortion shows the point that this one shows at (`u`, `v`) \[px\].
    ///
    /// # Errors
    /// [`DistortionError::Outside`] if the lens shows nothing there.
    pub fn rectify(&self, camera: &Pinhole, u: f64, v: f64) -> Result<[f64; 2], DistortionError> {
        let seen = Vector2::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
        let n = self
            .undistort(&seen)
            .ok_or(DistortionError::Outside { u, v })?;
        Ok([camera.cx + camera.fx * n.x, camera.cy + camera.fy * n.y])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn removal_inverts_distortion() {
        for lens in [
            Distortion::PlumbBob([-0.28, 0.07, 1e-3, -5e-4, 0.01]),
            Distortion::Equidistant([0.02, -0.01, 0.003, -0.001]),
        ] {
            for (x, y) in [(0.0, 0.0), (0.4, -0.3), (-0.6, 0.5), (0.01, 0.7)] {
                let n = Vector2::new(x, y);
                let back = lens.undistort(&lens.distort(&n)).unwrap();
                assert!((back - n).norm() < 1e-8, "{lens:?} {n} {back}");
            }
        }
    }

    /// Values of `cv::projectPoints` and `cv::fisheye::projectPoints` follow the formulas that OpenCV prints; these
    /// were computed by hand for one point.
    #[test]
    fn points_are_where_the_formulas_put_them() {
        let plumb_bob = Distortion::PlumbBob([0.1, 0.0, 0.01, 0.02, 0.0]);
        // r² = 0.25, x y = 0.12: x' = 0.3 1.025 + 2 0.01 0.12 + 0.02 (0.25 + 0.18), y' = 0.4 1.025 + 0.01 (0.25 +
        // 0.32) + 2 0.02 0.12.
        let found = plumb_bob.distort(&Vector2::new(0.3, 0.4));
        assert!(
            (found - Vector2::new(0.3185, 0.4205)).norm() < 1e-12,
            "{found}"
        );
        let fisheye = Distortion::Equidistant([0.0; 4]);
        let found = fisheye.distort(&Vector2::new(1.0, 0.0));
        assert!((found.x - std::f64::consts::FRAC_PI_4).abs() < 1e-12);
    }

    #[test]
    fn coefficients_are_checked() {
        // Drivers of ideal cameras write zeros for any model.
        assert_eq!(Distortion::new("plumb_bob", &[0.0; 5]), Ok(None));
        assert_eq!(Distortion::new("rational_polynomial", &[0.0; 8]), Ok(None));
        assert!(Distortion::new("equidistant", &[0.0; 4]).unwrap().is_some());
        for model in ["", "plumb_bob", "equidistant"] {
            assert_eq!(Distortion::new(model, &[]), Ok(None));
        }
        let refused = |model: &str, d: &[f64]| Distortion::new(model, d).unwrap_err().to_string();
        assert!(refused("equidistant", &[0.1; 5]).contains("must have 4"));
        assert!(refused("rational_polynomial", &[0.1; 8]).contains("plumb_bob and equidistant"));
        assert!(refused("plumb_bob", &[0.1; 3]).contains("must have 4 or 5"));
        assert!(refused("plumb_bob", &[f64::NAN; 5]).contains("finite"));
    }
}
