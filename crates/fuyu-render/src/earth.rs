//! The Earth in the background.

use std::sync::LazyLock;

use nalgebra::{RealField, Vector3};
use rayon::prelude::*;

/// Mean radius of the Earth \[m\] (IUGG).
pub const EARTH_RADIUS: f64 = 6_371_008.8;

/// Mean reflectance (Bond albedo, NASA Earth fact sheet).
const ALBEDO: f64 = 0.3;

/// The Earth: a diffuse sphere with oceans, land and clouds that are made up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Earth {
    /// Its centre in the world \[m\].
    pub centre: Vector3<f64>,
    /// Its radius \[m\].
    pub radius: f64,
}

impl Earth {
    /// The Earth with its mean radius.
    pub fn at(centre: Vector3<f64>) -> Self {
        Self {
            centre,
            radius: EARTH_RADIUS,
        }
    }

    /// Distance along the unit vector `d` from the point `p` of the world \[m\] to the surface, if it is met.
    pub fn hit(&self, p: &Vector3<f64>, d: &Vector3<f64>) -> Option<f64> {
        // In radii, so that squares are small.
        let distance = hit(&((self.centre - p) / self.radius), d)?;
        Some(distance * self.radius)
    }

    /// Fraction of the Sun's light that arrives at the point `p`: 1, or 0 behind the Earth.
    pub fn sunlight(&self, p: &Vector3<f64>, toward_sun: &Vector3<f64>) -> f64 {
        match self.hit(p, toward_sun) {
            Some(_) => 0.0,
            None => 1.0,
        }
    }

    /// Irradiance of light that the Earth reflects to the point `p`, of full sunlight, and the direction toward its centre:
    /// that of a diffuse sphere which is lit everywhere as below `p`.
    pub fn earthshine(&self, p: &Vector3<f64>, toward_sun: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let toward = self.centre - p;
        let distance = toward.norm().max(self.radius);
        let direction = toward.try_normalize(0.0).unwrap_or_else(Vector3::z);
        let lit = (-direction).dot(toward_sun).max(0.0);
        (ALBEDO * lit * (self.radius / distance).powi(2), direction)
    }
}

/// The Earth as seen from one point. Single precision is enough: an error of 2e-6 rad at the limb from the distance of the
/// Moon.
pub struct EarthView {
    /// Its centre from there, in radii.
    c: Vector3<f32>,
    toward_sun: Vector3<f32>,
    surface: &'static Surface,
}

impl EarthView {
    /// The Earth from the point `p` of the world \[m\].
    pub fn new(earth: &Earth, p: &Vector3<f64>, toward_sun: &Vector3<f64>) -> Self {
        Self {
            c: ((earth.centre - p) / earth.radius).cast(),
            toward_sun: toward_sun.cast(),
            surface: &SURFACE,
        }
    }

    /// Radiance seen along the unit vector `d`, if the Earth is there.
    pub fn radiance(&self, d: &Vector3<f32>) -> Option<[f32; 3]> {
        let distance = hit(&self.c, d)?;
        let n = d * distance - self.c;
        let lit = n.dot(&self.toward_sun);
        if lit <= 0.0 {
            return Some([0.0; 3]);
        }
        let surface = self.surface.at(&n);
        // Toward the limb the air scatters more light, blue.
        let slant = 1.0 + n.dot(d);
        let squared = slant * slant;
        let dimmed = 1.0 - 0.5 * squared * squared;
        let air = [0.05, 0.12, 0.25].map(|x: f32| x * squared * slant);
        Some(std::array::from_fn(|i| {
            (surface[i] * dimmed + air[i]) * lit
        }))
    }
}

/// Distance along the unit vector `d` to a unit sphere about `c`, if it is met.
fn hit<T: RealField + Copy>(c: &Vector3<T>, d: &Vector3<T>) -> Option<T> {
    let along = d.dot(c);
    // Distance of the line from the centre, without a difference of large squares.
    let apart = (c - d * along).norm_squared();
    if along <= T::zero() || apart > T::one() {
        return None;
    }
    let distance = along - (T::one() - apart).sqrt();
    (distance > T::zero()).then_some(distance)
}

/// Texels of an edge of a face of [`Surface`]: 25 km in its middle.
const FACE: usize = 512;

/// Reflectance of the ground and its clouds, on the six faces of a cube around the unit sphere.
struct Surface {
    /// Red, green, blue; 65,535 is 1. Faces one after the other, each row by row.
    texels: Vec<[u16; 3]>,
}

/// Made on first use, since it takes half a second.
static SURFACE: LazyLock<Surface> = LazyLock::new(Surface::new);

impl Surface {
    fn new() -> Self {
        let texels = (0..6 * FACE * FACE).into_par_iter().map(|i| {
            let (face, row, column) = (i / (FACE * FACE), i / FACE % FACE, i % FACE);
            let [u, v] = [column, row].map(|k| (k as f64 + 0.5) / FACE as f64 * 2.0 - 1.0);
            let mut n = Vector3::zeros();
            let axis = face / 2;
            n[axis] = if face % 2 == 0 { 1.0 } else { -1.0 };
            n[(axis + 1) % 3] = u;
            n[(axis + 2) % 3] = v;
            let n = n.normalize();
            let land = noise(&n, 3.0, 5, 11) - 0.52;
            let cloud = ((noise(&n, 5.0, 6, 29) - 0.5) * 5.0).clamp(0.0, 1.0);
            let ground = match land > 0.0 {
                true => Vector3::new(0.22, 0.2, 0.11),
                false => Vector3::new(0.03, 0.08, 0.2),
            };
            let reflectance = ground.lerp(&Vector3::repeat(0.75), cloud);
            <[f64; 3]>::from(reflectance).map(|x| (x * 65_535.0) as u16)
        });
        Self {
            texels: texels.collect(),
        }
    }

    /// Reflectance at the unit vector `n`, interpolated between texels of its face.
    fn at(&self, n: &Vector3<f32>) -> [f32; 3] {
        let size = n.abs();
        let (axis, along, u, v) = if size.x >= size.y && size.x >= size.z {
            (0, n.x, n.y, n.z)
        } else if size.y >= size.z {
            (1, n.y, n.z, n.x)
        } else {
            (2, n.z, n.x, n.y)
        };
        let face = 2 * axis + usize::from(along < 0.0);
        let scale = 0.5 * FACE as f32 / along.abs();
        let middle = 0.5 * FACE as f32 - 0.5;
        let at = |x: f32| (x * scale + middle).clamp(0.0, (FACE - 1) as f32);
        let (x, y) = (at(u), at(v));
        let (column, row) = ((x as usize).min(FACE - 2), (y as usize).min(FACE - 2));
        let (fx, fy) = (x - column as f32, y - row as f32);
        let corner = (face * FACE + row) * FACE + column;
        let [a, b] = [self.texels[corner], self.texels[corner + 1]];
        let [c, d] = [self.texels[corner + FACE], self.texels[corner + FACE + 1]];
        std::array::from_fn(|i| {
            let [a, b, c, d] = [a, b, c, d].map(|texel| f32::from(texel[i]));
            let (upper, lower) = (a + (b - a) * fx, c + (d - c) * fx);
            (upper + (lower - upper) * fy) / 65_535.0
        })
    }
}

/// Smooth random values in [0, 1] on the unit sphere: `octaves` of value noise from `frequency` on.
fn noise(n: &Vector3<f64>, frequency: f64, octaves: u32, seed: u32) -> f64 {
    let (mut sum, mut weight, mut total, mut scale) = (0.0, 0.5, 0.0, frequency);
    for octave in 0..octaves {
        sum += weight * lattice(&(n * scale), seed + octave);
        total += weight;
        weight *= 0.5;
        scale *= 2.0;
    }
    sum / total
}

fn lattice(p: &Vector3<f64>, seed: u32) -> f64 {
    let cell = p.map(f64::floor);
    let f = (p - cell).map(|t| t * t * (3.0 - 2.0 * t));
    let corner = |dx: i32, dy: i32, dz: i32| {
        let at = [cell.x as i32 + dx, cell.y as i32 + dy, cell.z as i32 + dz];
        hash(at, seed)
    };
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let face = |dz: i32| {
        let near = mix(corner(0, 0, dz), corner(1, 0, dz), f.x);
        let far = mix(corner(0, 1, dz), corner(1, 1, dz), f.x);
        mix(near, far, f.y)
    };
    mix(face(0), face(1), f.z)
}

/// A number in [0, 1) for a point of the lattice (finalizer of MurmurHash3).
fn hash([x, y, z]: [i32; 3], seed: u32) -> f64 {
    let mut h = seed
        ^ (x as u32).wrapping_mul(0x8da6_b343)
        ^ (y as u32).wrapping_mul(0xd816_3841)
        ^ (z as u32).wrapping_mul(0xcb1a_b31f);
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    f64::from(h ^ (h >> 16)) / 4_294_967_296.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_surface_is_as_far_away_as_the_orbit_is_high() {
        let earth = Earth::at(Vector3::new(0.0, 0.0, EARTH_RADIUS + 500e3));
        let p = Vector3::zeros();
        assert!((earth.hit(&p, &Vector3::z()).unwrap() - 500e3).abs() < 1e-3);
        // The limb is where the sine of the angle from the centre is R / (R + h).
        let limb = (EARTH_RADIUS / (EARTH_RADIUS + 500e3)).asin();
        let at = |angle: f64| Vector3::new(angle.sin(), 0.0, angle.cos());
        assert!(earth.hit(&p, &at(limb - 1e-6)).is_some());
        assert!(earth.hit(&p, &at(limb + 1e-6)).is_none());
        assert!(earth.hit(&p, &-Vector3::z()).is_none());
    }

    #[test]
    fn the_sun_is_eclipsed_behind_the_earth() {
        let earth = Earth::at(Vector3::new(0.0, 0.0, 7e6));
        assert_eq!(earth.sunlight(&Vector3::zeros(), &Vector3::z()), 0.0);
        assert_eq!(earth.sunlight(&Vector3::zeros(), &Vector3::x()), 1.0);
        let (shine, _) = earth.earthshine(&Vector3::zeros(), &-Vector3::z());
        assert!((shine - 0.3 * (EARTH_RADIUS / 7e6).powi(2)).abs() < 1e-12);
        assert_eq!(earth.earthshine(&Vector3::zeros(), &Vector3::z()).0, 0.0);
    }

    #[test]
    fn the_surface_has_no_seams() {
        // Across the edge and the corner of faces, over a tenth of a texel.
        for n in [Vector3::new(1.0, 1.0, 0.3), Vector3::new(-1.0, 1.0, -1.0)] {
            let n = n.normalize();
            let step = Vector3::new(2e-4, -2e-4, 1e-4);
            let (a, b) = (
                SURFACE.at(&(n - step).cast()),
                SURFACE.at(&(n + step).cast()),
            );
            assert!((0..3).all(|i| (a[i] - b[i]).abs() < 0.05), "{a:?} {b:?}");
        }
    }

    #[test]
    fn its_day_side_is_bright_and_varied_and_its_night_side_dark() {
        let earth = Earth::at(Vector3::new(0.0, 0.0, 42e6));
        let at = |k: i32| Vector3::new(f64::from(k) * 0.01, 0.02, 1.0).normalize();
        let seen = |k: i32, s: &Vector3<f64>| {
            let view = EarthView::new(&earth, &Vector3::zeros(), s);
            view.radiance(&at(k).cast()).unwrap()
        };
        let day: Vec<f32> = (-10..10).map(|k| seen(k, &-Vector3::z())[2]).collect();
        let mean = day.iter().sum::<f32>() / 20.0;
        assert!((0.1..0.8).contains(&mean), "{mean}");
        assert!(day.iter().any(|x| (x - mean).abs() > 0.05));
        assert_eq!(seen(3, &Vector3::z()), [0.0; 3]);
    }
}
