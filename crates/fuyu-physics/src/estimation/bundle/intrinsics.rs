//! Camera intrinsics as unknowns: their effect on the image, and priors.

use nalgebra::{SMatrix, Vector2, Vector3};

use super::scene::MIN_DEPTH;

/// Number of intrinsic unknowns: logarithm of the focal length, principal point (2), first radial coefficient.
pub const INTRINSICS: usize = 4;

/// Prior weight that holds the focal length at its nominal value \[px²\].
const FIXED: f64 = 1e14;

/// Deviation of the camera from its nominal calibration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Intrinsics {
    /// Logarithm of the focal length over its nominal value.
    pub log_focal: f64,
    /// Displacement of the principal point \[px\].
    pub centre: Vector2<f64>,
    /// First coefficient of the radial distortion, as `k1` of `plumb_bob`.
    pub radial: f64,
}

impl Intrinsics {
    /// Intrinsics that differ from the nominal ones in the focal length only.
    pub fn of_focal(log_focal: f64) -> Self {
        Self {
            log_focal,
            ..Self::default()
        }
    }

    /// The lens with these intrinsics and the nominal focal lengths `nominal` \[px\].
    pub fn lens(&self, nominal: &Vector2<f64>) -> Lens {
        Lens {
            focal: nominal * self.log_focal.exp(),
            centre: self.centre,
            radial: self.radial,
        }
    }
}

/// Projection of points, relative to the nominal principal point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    focal: Vector2<f64>,
    centre: Vector2<f64>,
    radial: f64,
}

/// An image point and its derivatives.
pub struct Projected {
    /// The image point \[px\].
    pub pixel: Vector2<f64>,
    /// Derivative by the point in the camera's frame.
    pub by_x: SMatrix<f64, 2, 3>,
    /// Derivative by the intrinsics, in the order of [`Intrinsics`].
    pub by_intrinsics: SMatrix<f64, 2, INTRINSICS>,
}

impl Lens {
    /// Image \[px\] of a point at `x` in the camera's frame; `None` for a point behind the camera.
    #[inline]
    pub fn project(&self, x: &Vector3<f64>) -> Option<Vector2<f64>> {
        (x.z > MIN_DEPTH).then(|| {
            let n = x.xy() / x.z;
            let factor = 1.0 + self.radial * n.norm_squared();
            self.focal.component_mul(&n) * factor + self.centre
        })
    }

    /// Image of a point with its derivatives. A point behind the camera, or too near, is moved to the least depth.
    #[inline]
    pub fn expand(&self, x: &Vector3<f64>) -> Projected {
        let inverse = 1.0 / x.z.max(MIN_DEPTH);
        let n = x.xy() * inverse;
        let square = n.norm_squared();
        let factor = 1.0 + self.radial * square;
        let undistorted = self.focal.component_mul(&n);
        let distorted = undistorted * factor;
        // Derivatives by the normalised point.
        let (a, b) = (
            self.focal.x * (factor + 2.0 * self.radial * n.x * n.x),
            self.focal.y * (factor + 2.0 * self.radial * n.y * n.y),
        );
        let (c, d) = (
            self.focal.x * 2.0 * self.radial * n.x * n.y,
            self.focal.y * 2.0 * self.radial * n.x * n.y,
        );
        #[rustfmt::skip]
        let by_x = SMatrix::<f64, 2, 3>::new(
            a, c, -(a * n.x + c * n.y),
            d, b, -(d * n.x + b * n.y),
        ) * inverse;
        #[rustfmt::skip]
        let by_intrinsics = SMatrix::<f64, 2, INTRINSICS>::new(
            distorted.x, 1.0, 0.0, undistorted.x * square,
            distorted.y, 0.0, 1.0, undistorted.y * square,
        );
        Projected {
            pixel: distorted + self.centre,
            by_x,
            by_intrinsics,
        }
    }
}

/// Weight of the prior on the logarithm of the focal length \[px²\], for image noise `noise` \[px\] and a relative
/// standard deviation `deviation` of the nominal value; with zero deviation the prior holds the nominal value.
pub fn focal_prior_weight(deviation: f64, noise: f64) -> f64 {
    if deviation > 0.0 {
        (noise / deviation).powi(2)
    } else {
        FIXED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_match_finite_differences() {
        let intrinsics = Intrinsics {
            log_focal: 0.02,
            centre: Vector2::new(3.0, -2.0),
            radial: -0.15,
        };
        let nominal = Vector2::new(800.0, 790.0);
        let x = Vector3::new(0.3, -0.4, 1.2);
        let lens = intrinsics.lens(&nominal);
        let expanded = lens.expand(&x);
        assert_eq!(lens.project(&x), Some(expanded.pixel));
        let h = 1e-6;
        for k in 0..3 {
            let step = Vector3::ith(k, h);
            let up = lens.project(&(x + step)).unwrap();
            let down = lens.project(&(x - step)).unwrap();
            let numeric = (up - down) / (2.0 * h);
            assert!((numeric - expanded.by_x.column(k)).norm() < 1e-5, "{k}");
        }
        for k in 0..INTRINSICS {
            let moved = |h: f64| {
                let mut i = intrinsics;
                match k {
                    0 => i.log_focal += h,
                    3 => i.radial += h,
                    _ => i.centre[k - 1] += h,
                }
                i.lens(&nominal).project(&x).unwrap()
            };
            let numeric = (moved(h) - moved(-h)) / (2.0 * h);
            assert!(
                (numeric - expanded.by_intrinsics.column(k)).norm() < 1e-5,
                "{k}"
            );
        }
    }
}
