//! Cameras: intrinsic parameters, distortion, and the ray of every pixel.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};

use crate::{Distortion, Motion};

/// Edge of a tile \[px\]: the image is drawn in such squares.
pub(crate) const TILE: usize = 8;
/// Pixels of a tile.
pub(crate) const TILE_PIXELS: usize = TILE * TILE;
/// Most columns or rows of an image.
const LARGEST_IMAGE: u32 = 16_384;
/// Most samples of a pixel.
const MOST_SAMPLES: usize = 64;

/// Size and intrinsic parameters of an image \[px\]; pixel centres are at integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length along rows.
    pub fx: f64,
    /// Focal length along columns.
    pub fy: f64,
    /// Column of the optical axis.
    pub cx: f64,
    /// Row of the optical axis.
    pub cy: f64,
}

impl Intrinsics {
    /// Square pixels with the optical axis through the middle of the image.
    pub fn centred(width: u32, height: u32, focal_length: f64) -> Self {
        Self {
            width,
            height,
            fx: focal_length,
            fy: focal_length,
            cx: 0.5 * f64::from(width) - 0.5,
            cy: 0.5 * f64::from(height) - 0.5,
        }
    }
}

/// Why a camera cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// The image has no pixels or too many.
    #[error("the image is {0} x {1} px; it must be 1 to {LARGEST_IMAGE} px wide and high")]
    Size(u32, u32),
    /// An intrinsic parameter is impossible.
    #[error("{name} is {value} px; it must be {right}")]
    Intrinsic {
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        right: &'static str,
    },
    /// The number of samples is out of range.
    #[error("{0} samples per pixel; it must be 1 to {MOST_SAMPLES}")]
    Samples(usize),
    /// The lens shows nothing in the middle of the image.
    #[error("the lens distortion leaves no pixel with a view")]
    Blind,
}

/// A camera. Cloning it is cheap.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Its optical frame in the world: z forward, x right, y down.
    pub pose: Motion,
    /// Distance along the optical axis before which nothing is drawn \[m\].
    pub near: f64,
    intrinsics: Intrinsics,
    distortion: Distortion,
    /// One for each sample; the last is that of the pixels' centres at half the exposure.
    samples: Arc<Vec<Sample>>,
}

/// A sample of all pixels: when, and the rays that it sees along.
#[derive(Debug)]
pub(crate) struct Sample {
    /// Fraction of the exposure.
    pub fraction: f64,
    pub rays: Rays,
}

impl Camera {
    /// A camera at the origin of the world with `samples` samples per pixel, spread over its area and over the exposure: 1
    /// is neither smoothed nor blurred.
    ///
    /// # Errors
    /// [`CameraError`] if no camera can have these parameters.
    pub fn new(
        intrinsics: Intrinsics,
        distortion: Distortion,
        samples: usize,
    ) -> Result<Self, CameraError> {
        let Intrinsics { width, height, .. } = intrinsics;
        if ![width, height]
            .iter()
            .all(|n| (1..=LARGEST_IMAGE).contains(n))
        {
            return Err(CameraError::Size(width, height));
        }
        for (name, value) in [("fx", intrinsics.fx), ("fy", intrinsics.fy)] {
            if !(value.is_finite() && value > 0.0) {
                let right = "positive and finite";
                return Err(CameraError::Intrinsic { name, value, right });
            }
        }
        for (name, value) in [("cx", intrinsics.cx), ("cy", intrinsics.cy)] {
            if !value.is_finite() {
                let right = "finite";
                return Err(CameraError::Intrinsic { name, value, right });
            }
        }
        if !(1..=MOST_SAMPLES).contains(&samples) {
            return Err(CameraError::Samples(samples));
        }
        let centre = Sample {
            fraction: 0.5,
            rays: Rays::new(&intrinsics, &distortion, [0.0; 2]),
        };
        if centre.rays.is_blind() {
            return Err(CameraError::Blind);
        }
        let mut all = Vec::with_capacity(samples + 1);
        if samples > 1 {
            let offsets = offsets(samples);
            for (k, offset) in offsets.into_iter().enumerate() {
                all.push(Sample {
                    fraction: (k as f64 + 0.5) / samples as f64,
                    rays: Rays::new(&intrinsics, &distortion, offset),
                });
            }
        }
        all.push(centre);
        Ok(Self {
            pose: Motion::at_rest(Isometry3::identity()),
            near: 0.01,
            intrinsics,
            distortion,
            samples: Arc::new(all),
        })
    }

    /// The same camera at another place.
    #[must_use]
    pub fn at(&self, pose: Motion) -> Self {
        Self {
            pose,
            ..self.clone()
        }
    }

    /// Size and intrinsic parameters.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// Distortion of its lens.
    pub fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// The pixel (column, row) in which the point `p_C` of the optical frame \[m\] is seen; `None` if it is behind the
    /// camera.
    pub fn project(&self, p_C: &Vector3<f64>) -> Option<[f64; 2]> {
        project(&self.intrinsics, &self.distortion, p_C)
    }

    /// The direction in the optical frame, at z = 1, of a pixel; `None` where the lens shows nothing.
    pub fn ray(&self, [u, v]: [f64; 2]) -> Option<Vector3<f64>> {
        ray(&self.intrinsics, &self.distortion, [u, v])
    }

    /// The samples that make up the radiance; a single one is also that of depth and ids.
    pub(crate) fn samples(&self) -> &[Sample] {
        match self.samples.len() {
            1 => &self.samples,
            n => &self.samples[..n - 1],
        }
    }

    /// The sample of the pixels' centres at half the exposure.
    pub(crate) fn centre(&self) -> &Sample {
        &self.samples[self.samples.len() - 1]
    }
}

/// Offsets from a pixel's centre \[px\], even over its area and with a mean of zero: the additive recurrence with the plastic
/// number, a low-discrepancy sequence (Roberts 2018).
fn offsets(samples: usize) -> Vec<[f64; 2]> {
    let steps = [0.754_877_666_246_693, 0.569_840_290_998_053];
    let offsets = (0..samples).map(|k| steps.map(|a| (0.5 + a * k as f64).fract()));
    let offsets: Vec<[f64; 2]> = offsets.collect();
    let mean = |i: usize| offsets.iter().map(|o| o[i]).sum::<f64>() / samples as f64;
    let mean = [mean(0), mean(1)];
    let centred = offsets.iter().map(|o| [o[0] - mean[0], o[1] - mean[1]]);
    centred.collect()
}

fn project(k: &Intrinsics, distortion: &Distortion, p: &Vector3<f64>) -> Option<[f64; 2]> {
    if p.z <= 0.0 {
        return None;
    }
    let [x, y] = distortion.distort([p.x / p.z, p.y / p.z]);
    Some([k.cx + k.fx * x, k.cy + k.fy * y])
}

fn ray(k: &Intrinsics, distortion: &Distortion, [u, v]: [f64; 2]) -> Option<Vector3<f64>> {
    let [x, y] = distortion.undistort([(u - k.cx) / k.fx, (v - k.cy) / k.fy])?;
    Some(Vector3::new(x, y, 1.0))
}

/// The rays of one tile, at z = 1. Pixels outside the image or without a view have NaN.
#[derive(Debug)]
pub(crate) struct Tile {
    pub x: [f32; TILE_PIXELS],
    pub y: [f32; TILE_PIXELS],
    pub bounds: Bounds,
}

/// Bounds of x and y of rays at z = 1; inverted if there are none.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub x: [f32; 2],
    pub y: [f32; 2],
}

impl Bounds {
    pub const NONE: Self = Self {
        x: [f32::INFINITY, f32::NEG_INFINITY],
        y: [f32::INFINITY, f32::NEG_INFINITY],
    };

    pub fn add(&mut self, x: f32, y: f32) {
        // Minimum and maximum leave out NaN.
        self.x = [self.x[0].min(x), self.x[1].max(x)];
        self.y = [self.y[0].min(y), self.y[1].max(y)];
    }

    pub fn overlap(&self, other: &Self) -> bool {
        self.x[0] <= other.x[1]
            && other.x[0] <= self.x[1]
            && self.y[0] <= other.y[1]
            && other.y[0] <= self.y[1]
    }
}

/// The rays of all pixels, tile by tile.
#[derive(Debug)]
pub(crate) struct Rays {
    pub columns: usize,
    /// Row by row.
    pub tiles: Vec<Tile>,
    /// Bounds of each row of tiles.
    pub rows: Vec<Bounds>,
    /// Where pixels are in the undistorted image, for fast location: scale and offset of columns.
    affine: Option<[f64; 2]>,
}

impl Rays {
    fn new(k: &Intrinsics, distortion: &Distortion, offset: [f64; 2]) -> Self {
        let (width, height) = (k.width as usize, k.height as usize);
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let mut all = Self {
            columns,
            tiles: Vec::with_capacity(columns * rows),
            rows: vec![Bounds::NONE; rows],
            affine: matches!(distortion, Distortion::None).then_some([k.fx, k.cx - offset[0]]),
        };
        for row in 0..rows {
            for column in 0..columns {
                let mut tile = Tile {
                    x: [f32::NAN; TILE_PIXELS],
                    y: [f32::NAN; TILE_PIXELS],
                    bounds: Bounds::NONE,
                };
                for i in 0..TILE_PIXELS {
                    let (u, v) = (column * TILE + i % TILE, row * TILE + i / TILE);
                    if u >= width || v >= height {
                        continue;
                    }
                    let pixel = [u as f64 + offset[0], v as f64 + offset[1]];
                    if let Some(ray) = ray(k, distortion, pixel) {
                        (tile.x[i], tile.y[i]) = (ray.x as f32, ray.y as f32);
                        tile.bounds.add(tile.x[i], tile.y[i]);
                    }
                }
                let whole = &mut all.rows[row];
                for (x, y) in tile.bounds.x.into_iter().zip(tile.bounds.y) {
                    if x.is_finite() {
                        whole.add(x, y);
                    }
                }
                all.tiles.push(tile);
            }
        }
        all
    }

    fn is_blind(&self) -> bool {
        self.rows.iter().all(|row| row.x[0] > row.x[1])
    }

    /// First and last column of tiles in which rays with these bounds may be.
    pub fn columns(&self, bounds: &Bounds) -> (usize, usize) {
        let last = self.columns - 1;
        let Some([scale, offset]) = self.affine else {
            return (0, last);
        };
        let column = |x: f32, margin: f64| {
            let pixel = f64::from(x) * scale + offset + margin;
            ((pixel / TILE as f64).max(0.0) as usize).min(last)
        };
        // Half a pixel for rounding.
        (column(bounds.x[0], -0.5), column(bounds.x[1], 0.5))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_are_those_of_the_pixels() {
        let k = Intrinsics::centred(50, 30, 40.0);
        let lens = Distortion::PlumbBob([-0.2, 0.03, 1e-3, 0.0, 0.0]);
        let camera = Camera::new(k, lens, 1).unwrap();
        let rays = &camera.centre().rays;
        assert_eq!(
            (rays.columns, rays.rows.len(), rays.tiles.len()),
            (7, 4, 28)
        );
        for (u, v) in [(0, 0), (49, 29), (17, 11)] {
            let tile = &rays.tiles[(v / TILE) * rays.columns + u / TILE];
            let i = (v % TILE) * TILE + u % TILE;
            let p = Vector3::new(f64::from(tile.x[i]), f64::from(tile.y[i]), 1.0) * 3.0;
            let [a, b] = camera.project(&p).unwrap();
            assert!((a - u as f64).abs() < 1e-4 && (b - v as f64).abs() < 1e-4);
        }
        // The image has 50 columns; the last tile ends at 56.
        assert!(rays.tiles[6].x[5].is_nan());
    }

    #[test]
    fn samples_are_even_over_pixel_and_exposure() {
        let camera = Camera::new(Intrinsics::centred(8, 8, 10.0), Distortion::None, 16).unwrap();
        let samples = camera.samples();
        assert_eq!(samples.len(), 16);
        let mean = samples.iter().map(|s| s.fraction).sum::<f64>() / 16.0;
        assert!((mean - 0.5).abs() < 1e-12);
        let first = samples.iter().map(|s| f64::from(s.rays.tiles[0].x[0]));
        let mean = first.sum::<f64>() / 16.0 * 10.0 + 3.5;
        assert!(mean.abs() < 1e-6, "{mean}");
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let refused = |k: Intrinsics, samples| {
            let refused = Camera::new(k, Distortion::None, samples);
            refused.unwrap_err().to_string()
        };
        let k = Intrinsics::centred(64, 48, 50.0);
        assert!(refused(Intrinsics { width: 0, ..k }, 1).contains("0 x 48 px"));
        assert!(refused(Intrinsics { fy: -1.0, ..k }, 1).contains("fy is -1 px"));
        assert!(refused(Intrinsics { cx: f64::NAN, ..k }, 1).contains("cx is NaN"));
        assert!(refused(k, 0).contains("0 samples"));
    }
}
