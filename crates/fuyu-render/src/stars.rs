//! Stars.

use nalgebra::{Isometry3, UnitVector3, Vector3};
use rand::{RngExt, SeedableRng, rngs::Xoshiro256PlusPlus};
use rand_distr::StandardNormal;

use crate::{Camera, Frame, Scene};

/// A star.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Star {
    /// Direction in the world.
    pub direction: UnitVector3<f64>,
    /// Apparent visual magnitude.
    pub magnitude: f64,
}

/// Stars brighter than magnitude 6.5, a count that all catalogues agree on within a few percent (Yale Bright Star
/// Catalogue: 9,110 objects).
const NAKED_EYE: f64 = 9100.0;

impl Star {
    /// A sky that does not exist but has as many stars as the real one, evenly distributed, up to `faintest` magnitudes, or 9
    /// if that is more:
    /// log10 N(m) = 3.96 + 0.51 (m - 6.5) (Allen, Astrophysical Quantities, for bright stars).
    pub fn random_sky(faintest: f64, seed: u64) -> Vec<Self> {
        let count = NAKED_EYE * 10_f64.powf(0.51 * (faintest.min(9.0) - 6.5));
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let stars = (0..count as usize).map(|_| {
            let mut normal = || -> f64 { random.sample(StandardNormal) };
            let v = Vector3::new(normal(), normal(), normal());
            let direction = UnitVector3::try_new(v, 1e-12).unwrap_or_else(Vector3::z_axis);
            // Inverse of the distribution; in (0, 1].
            let fraction: f64 = 1.0 - random.random::<f64>();
            let magnitude = faintest.min(9.0) + fraction.log10() / 0.51;
            Self {
                direction,
                magnitude,
            }
        });
        stars.collect()
    }
}

/// Apparent visual magnitude of the Sun (IAU 2015 resolution B2 gives -26.74 for V).
const SUN_MAGNITUDE: f64 = -26.74;
/// Standard deviation of a star's image \[px\].
const BLUR: f64 = 0.6;

/// Solid angle \[sr\] that a pixel at `[u, v]` sees: that between the rays of its edges, `cos³ / (fx fy)` for a pinhole. `None`
/// where the lens shows nothing.
fn solid_angle(camera: &Camera, [u, v]: [f64; 2]) -> Option<f64> {
    let ray = |u: f64, v: f64| Some(camera.ray([u, v])?.normalize());
    let across = ray(u + 0.5, v)? - ray(u - 0.5, v)?;
    let down = ray(u, v + 0.5)? - ray(u, v - 0.5)?;
    Some(across.cross(&down).norm())
}

/// Adds the stars that nothing hides to `radiance`, as seen by one of `samples` samples. `sees_sky` says whether a pixel's
/// ray meets no body.
///
/// In sunlight of irradiance `E`, a white surface that fills a pixel of solid angle `W` sends `E W / pi` into the lens; a star
/// sends its own irradiance. The ratio is what the star adds to a pixel.
pub fn add(
    scene: &Scene,
    camera: &Camera,
    X_WC: &Isometry3<f64>,
    frame: &mut Frame,
    sees_sky: impl Fn(usize) -> bool,
    samples: usize,
) {
    let (width, height) = (frame.width as i64, frame.height as i64);
    let white = std::f64::consts::PI * scene.star_gain / samples as f64;
    let R_CW = X_WC.rotation.inverse();
    let p_W = X_WC.translation.vector;
    for star in &scene.stars {
        let d_C = R_CW * star.direction.into_inner();
        let Some([u, v]) = camera.project(&d_C) else {
            continue;
        };
        let near = |x: f64, n: i64| x > -2.0 && x < n as f64 + 1.0;
        if !near(u, width)
            || !near(v, height)
            || camera.ray([u, v]).is_none_or(|ray| {
                // A lens that folds back would show it a second time.
                (ray.normalize() - d_C).norm() > 1e-6
            })
        {
            continue;
        }
        if (scene.earth).is_some_and(|earth| earth.hit(&p_W, &star.direction).is_some()) {
            continue;
        }
        let Some(solid_angle) = solid_angle(camera, [u, v]) else {
            continue;
        };
        let flux = white / solid_angle * 10_f64.powf(-0.4 * (star.magnitude - SUN_MAGNITUDE));
        let (column, row) = (u.round() as i64, v.round() as i64);
        let weight = |x: f64| (-0.5 * (x / BLUR).powi(2)).exp();
        let along =
            |centre: i64, at: f64| [-2, -1, 0, 1, 2].map(|d| weight((centre + d) as f64 - at));
        let (wx, wy) = (along(column, u), along(row, v));
        let total = wx.iter().sum::<f64>() * wy.iter().sum::<f64>();
        for (dy, wy) in (-2..).zip(wy) {
            for (dx, wx) in (-2..).zip(wx) {
                let (x, y) = (column + dx, row + dy);
                if x < 0 || y < 0 || x >= width || y >= height {
                    continue;
                }
                let i = (y * width + x) as usize;
                if sees_sky(i) {
                    let part = (flux * wx * wy / total) as f32;
                    frame.radiance[i] = frame.radiance[i].map(|x| x + part);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_random_sky_has_the_right_number_of_stars_of_each_brightness() {
        let sky = Star::random_sky(6.5, 3);
        assert_eq!(sky.len(), 9100);
        let brighter = |m: f64| sky.iter().filter(|s| s.magnitude < m).count() as f64;
        // Each magnitude has 10^0.51 = 3.24 times as many.
        let ratio = brighter(6.0) / brighter(5.0);
        assert!((ratio - 3.24).abs() < 0.25, "{ratio}");
        let mean = sky
            .iter()
            .map(|s| s.direction.into_inner())
            .sum::<Vector3<f64>>()
            / 9100.0;
        // A unit vector's coordinate has a variance of a third.
        assert!(mean.amax() < 4.0 / (3.0 * 9100_f64).sqrt());
        assert_eq!(sky, Star::random_sky(6.5, 3));
    }
}
