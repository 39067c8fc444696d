//! The surroundings of a point at its first sight, and where they are in another image.
//!
//! Inverse compositional alignment of an affine map (Baker and Matthews 2004), with mean and contrast matched in every iteration, so that
//! shading may change. Pixels near the middle count more: perspective bends the map of a surface that turns away from the camera, and
//! an affine map fitted to all of a window alike would be off in its middle, by the square of the window's size.

use nalgebra::{Matrix2, Matrix6, SVector, Vector2, Vector6};

use crate::image::sample;

/// Most iterations of an alignment.
const ITERATIONS: usize = 12;
/// Largest step of the last iteration \[px\]; what remains is a fraction of it.
const CONVERGED: f64 = 0.03;
/// Standard deviation of the normal distribution that weights the pixels of a patch, over its radius.
const WEIGHT_WIDTH: f32 = 0.5;
/// Least standard deviation of the values of a patch \[grey values\].
const LEAST_CONTRAST: f32 = 1.5;

/// An image without padding.
#[derive(Clone, Copy)]
pub(crate) struct Pixels<'a> {
    pub data: &'a [u8],
    pub width: usize,
    pub height: usize,
}

impl Pixels<'_> {
    /// Appends the values at the offsets -`r` to `r` in both directions, mapped by `A`, around `p`; `None` if one is outside.
    fn read_parallelogram(
        &self,
        p: Vector2<f64>,
        A: Matrix2<f64>,
        r: i32,
        values: &mut Vec<f32>,
    ) -> Option<()> {
        let reach = f64::from(r);
        let across = reach * (A.m11.abs() + A.m12.abs());
        let along = reach * (A.m21.abs() + A.m22.abs());
        // Less than a thousandth of a pixel for rounding. Also false if a number is none.
        let fits = |x: f64, reach: f64, size: usize| {
            x - reach >= 0.001 && x + reach <= (size - 1) as f64 - 0.001
        };
        if !(fits(p.x, across, self.width) && fits(p.y, along, self.height)) {
            return None;
        }
        let [a11, a12, a21, a22] = [A.m11, A.m12, A.m21, A.m22].map(|a| a as f32);
        // Single precision is enough for what is relative to a pixel near the middle.
        let origin = p.map(f64::floor);
        let rest = (p - origin).map(|x| x as f32);
        let (column, row) = (origin.x as i32, origin.y as i32);
        for y in -r..=r {
            let y = y as f32;
            let (u0, v0) = (rest.x + a12 * y, rest.y + a22 * y);
            for x in -r..=r {
                let x = x as f32;
                let (u, v) = (u0 + a11 * x, v0 + a21 * x);
                let (du, dv) = (floor(u), floor(v));
                let (a, b) = (u - du as f32, v - dv as f32);
                let i = (row + dv) as usize * self.width + (column + du) as usize;
                let upper = self.data.get(i..i + 2)?;
                let lower = self.data.get(i + self.width..i + self.width + 2)?;
                let [top, bottom] = [upper, lower]
                    .map(|s| f32::from(s[0]) + a * (f32::from(s[1]) - f32::from(s[0])));
                values.push(top + b * (bottom - top));
            }
        }
        Some(())
    }

    fn at(&self, p: Vector2<f64>) -> Option<f32> {
        sample(self.data, self.width, self.height, p.x, p.y)
    }
}

/// The largest whole number that is not more than `x`; `f32::floor` is a call where processors of 2008 must do.
fn floor(x: f32) -> i32 {
    let truncated = x as i32;
    truncated - i32::from(x < truncated as f32)
}

/// The values around a point, without their mean and divided by their standard deviation.
#[derive(Debug, Clone)]
pub(crate) struct Patch {
    radius: i32,
    values: Vec<f32>,
    /// Change of each value with the six parameters, times the value's weight.
    descent: Vec<SVector<f32, 6>>,
    inverse_hessian: Matrix6<f64>,
}

/// Where a patch is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Aligned {
    pub position: Vector2<f64>,
    /// From offsets in the patch to offsets in the image.
    pub shape: Matrix2<f64>,
    /// Normalized cross-correlation, -1 to 1.
    pub similarity: f64,
}

impl Patch {
    /// The patch of `2 radius + 1` pixels around `centre`; `None` if it leaves the image or has no structure in both directions.
    pub fn new(image: Pixels<'_>, centre: Vector2<f64>, radius: usize) -> Option<Self> {
        let radius = radius as i32;
        let mut values = Vec::new();
        let mut gradients = Vec::new();
        for y in -radius..=radius {
            for x in -radius..=radius {
                let p = centre + Vector2::new(f64::from(x), f64::from(y));
                let at = |dx, dy| image.at(p + Vector2::new(dx, dy));
                values.push(at(0.0, 0.0)?);
                let gx = 0.5 * (at(1.0, 0.0)? - at(-1.0, 0.0)?);
                let gy = 0.5 * (at(0.0, 1.0)? - at(0.0, -1.0)?);
                gradients.push((x as f32, y as f32, gx, gy));
            }
        }
        let (_, deviation) = normalize(&mut values)?;
        let width = WEIGHT_WIDTH * radius as f32;
        let mut hessian = Matrix6::<f64>::zeros();
        let descent = gradients.into_iter().map(|(x, y, gx, gy)| {
            let (gx, gy) = (gx / deviation, gy / deviation);
            let change = SVector::<f32, 6>::from([gx * x, gx * y, gy * x, gy * y, gx, gy]);
            let weight = (-0.5 * (x * x + y * y) / (width * width)).exp();
            let d: Vector6<f64> = change.cast();
            hessian.ger(f64::from(weight), &d, &d, 1.0);
            change * weight
        });
        let descent = descent.collect();
        Some(Self {
            radius,
            values,
            descent,
            inverse_hessian: hessian.cholesky()?.inverse(),
        })
    }

    /// Finds the patch in an image, from an estimate of where it is; `None` if it is not there.
    pub fn align(
        &self,
        image: Pixels<'_>,
        position: Vector2<f64>,
        shape: Matrix2<f64>,
        scratch: &mut Vec<f32>,
    ) -> Option<Aligned> {
        let (mut p, mut A) = (position, shape);
        let r = self.radius;
        let mut similarity = None;
        for _ in 0..ITERATIONS {
            scratch.clear();
            image.read_parallelogram(p, A, r, scratch)?;
            normalize(scratch)?;
            let mut sum = SVector::<f32, 6>::zeros();
            let mut product = 0.0;
            for ((value, reference), descent) in scratch.iter().zip(&self.values).zip(&self.descent)
            {
                sum += descent * (value - reference);
                product += value * reference;
            }
            similarity = Some(f64::from(product) / self.values.len() as f64);
            let step = self.inverse_hessian * sum.cast::<f64>();
            let D = Matrix2::new(step[0], step[1], step[2], step[3]);
            let d = Vector2::new(step[4], step[5]);
            A *= (Matrix2::identity() + D).try_inverse()?;
            p -= A * d;
            if !(p.iter().chain(A.iter()).all(|x| x.is_finite())
                && (p - position).norm() < f64::from(r))
            {
                return None;
            }
            // The corners of the patch move most.
            if d.norm() + f64::from(r) * D.norm() < CONVERGED * f64::from(r) && d.norm() < CONVERGED
            {
                break;
            }
        }
        Some(Aligned {
            position: p,
            shape: A,
            similarity: similarity?,
        })
    }
}

/// Takes the mean away and divides by the standard deviation; gives both, or `None` if there is hardly any contrast.
fn normalize(values: &mut [f32]) -> Option<(f32, f32)> {
    let n = values.len() as f32;
    let mean = values.iter().sum::<f32>() / n;
    let variance = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f32>() / n;
    let deviation = variance.sqrt();
    if deviation < LEAST_CONTRAST {
        return None;
    }
    for x in values {
        *x = (*x - mean) / deviation;
    }
    Some((mean, deviation))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 80;

    /// A smooth function of the plane, as an image that shows it through an affine map.
    fn image(position: Vector2<f64>, A: Matrix2<f64>, gain: f64, offset: f64) -> Vec<u8> {
        let inverse = A.try_inverse().unwrap();
        let pixels = (0..SIZE * SIZE).map(|i| {
            let p = Vector2::new((i % SIZE) as f64, (i / SIZE) as f64);
            let x = inverse * (p - position);
            let value = (0.45 * x.x + 0.2 * x.y).sin() + (0.4 * x.y - 0.1 * x.x).cos();
            (gain * value + offset).round().clamp(0.0, 255.0) as u8
        });
        pixels.collect()
    }

    fn view(data: &[u8]) -> Pixels<'_> {
        Pixels {
            data,
            width: SIZE,
            height: SIZE,
        }
    }

    #[test]
    fn position_and_shape_are_found_despite_other_light() {
        let centre = Vector2::new(40.0, 40.0);
        let reference = image(centre, Matrix2::identity(), 50.0, 110.0);
        let patch = Patch::new(view(&reference), centre, 7).unwrap();
        let A = Matrix2::new(0.85, 0.1, -0.12, 1.08);
        let moved = Vector2::new(43.3, 37.6);
        let darker = image(moved, A, 30.0, 80.0);
        let start = moved + Vector2::new(0.9, -0.8);
        let found = patch
            .align(view(&darker), start, Matrix2::identity(), &mut Vec::new())
            .unwrap();
        // Rounding to grey values and bilinear interpolation of a wave of 13 px.
        assert!((found.position - moved).norm() < 0.03, "{found:?}");
        assert!((found.shape - A).norm() < 0.02, "{found:?}");
        assert!(found.similarity > 0.995, "{found:?}");
    }

    #[test]
    fn flat_surroundings_and_borders_have_no_patch() {
        let flat = vec![100; SIZE * SIZE];
        let centre = Vector2::new(40.0, 40.0);
        assert!(Patch::new(view(&flat), centre, 7).is_none());
        let structured = image(centre, Matrix2::identity(), 50.0, 110.0);
        assert!(Patch::new(view(&structured), Vector2::new(4.0, 40.0), 7).is_none());
        let patch = Patch::new(view(&structured), centre, 7).unwrap();
        let identity = Matrix2::identity();
        let align = |p| patch.align(view(&flat), p, identity, &mut Vec::new());
        assert!(align(centre).is_none());
    }
}
