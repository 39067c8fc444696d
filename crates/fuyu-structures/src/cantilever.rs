//! Closed forms of uniform cantilevers.

use std::f64::consts::PI;

use crate::{Deflection, StructureError, error};

/// Most modes for which the closed forms are evaluated; `sinh` of the argument has 1e130 there.
const MOST: usize = 100;

/// Closed forms of the bending of a uniform Euler-Bernoulli cantilever (Blevins 1979, table 8-1). Modes are numbered from 0,
/// mass-normalised (`∫ φ² dm = 1`, so kg^-1/2) and positive at the tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cantilever {
    length: f64,
    mass_per_length: f64,
    EI: f64,
}

impl Cantilever {
    /// A cantilever of a length \[m\], mass per length \[kg/m\] and bending stiffness \[N m²\].
    ///
    /// # Errors
    /// A value that is not positive.
    pub fn new(length: f64, mass_per_length: f64, EI: f64) -> Result<Self, StructureError> {
        Ok(Self {
            length: error::positive("length [m]", length)?,
            mass_per_length: error::positive("mass per length [kg/m]", mass_per_length)?,
            EI: error::positive("EI [N m²]", EI)?,
        })
    }

    /// `β L`: the root of `cos z cosh z = -1` \[-\].
    fn root(k: usize) -> f64 {
        let k = k.min(MOST - 1);
        let mut z = (k as f64 + 0.5) * PI;
        // The roots of cos z + 1/cosh z; Newton's method converges quadratically from here.
        for _ in 0..12 {
            let (value, slope) = (z.cos() + 1.0 / z.cosh(), -z.sin() - z.tanh() / z.cosh());
            z -= value / slope;
        }
        z
    }

    /// The ratio σ of the shape's two parts, and 1 - σ without cancellation.
    fn ratio(z: f64) -> (f64, f64) {
        let divisor = z.sinh() + z.sin();
        (
            (z.cosh() + z.cos()) / divisor,
            (z.sin() - z.cos() - (-z).exp()) / divisor,
        )
    }

    fn sign(k: usize) -> f64 {
        if k.is_multiple_of(2) { 1.0 } else { -1.0 }
    }

    /// Angular frequency of mode `k` \[rad/s\].
    pub fn frequency(&self, k: usize) -> f64 {
        let wave_number = Self::root(k) / self.length;
        wave_number * wave_number * (self.EI / self.mass_per_length).sqrt()
    }

    /// Shape of mode `k` at `s` \[m\] from the root.
    pub fn shape(&self, k: usize, s: f64) -> Deflection {
        let z = Self::root(k);
        let (sigma, rest) = Self::ratio(z);
        let (b, u) = (z / self.length, z * s / self.length);
        let scale = Self::sign(k) / (self.mass_per_length * self.length).sqrt();
        let (sin, cos) = u.sin_cos();
        Deflection {
            value: scale * ((-u).exp() + rest * u.sinh() - cos + sigma * sin),
            slope: scale * b * (-(-u).exp() + rest * u.cosh() + sin + sigma * cos),
            curvature: scale * b * b * ((-u).exp() + rest * u.sinh() + cos - sigma * sin),
        }
    }

    /// `∫ φ dm` of mode `k` \[kg^1/2\].
    pub fn integral(&self, k: usize) -> f64 {
        let z = Self::root(k);
        Self::sign(k) * (self.mass_per_length * self.length).sqrt() * 2.0 * Self::ratio(z).0 / z
    }

    /// `∫ s φ dm` of mode `k` \[kg^1/2 m\].
    pub fn first_moment(&self, k: usize) -> f64 {
        let z = Self::root(k);
        Self::sign(k) * (self.mass_per_length * self.length).sqrt() * self.length * 2.0 / (z * z)
    }

    /// Share of the beam's mass that moves with mode `k` when the root is shaken across the beam: `(∫ φ dm)² / m` \[-\].
    pub fn effective_mass_fraction(&self, k: usize) -> f64 {
        self.integral(k).powi(2) / (self.mass_per_length * self.length)
    }

    /// Where this mass acts: `∫ s φ dm / ∫ φ dm`, as a fraction of the length \[-\].
    pub fn modal_centre(&self, k: usize) -> f64 {
        self.first_moment(k) / self.integral(k) / self.length
    }
}

/// Closed forms of the torsion of a uniform shaft with one end fixed (Blevins 1979, table 8-16). Modes are numbered from 0,
/// normalised to `∫ θ² dI = 1` and positive at the tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaft {
    length: f64,
    inertia_per_length: f64,
    GJ: f64,
}

impl Shaft {
    /// A shaft of a length \[m\], polar moment of inertia per length \[kg m\] and torsional stiffness \[N m²\].
    ///
    /// # Errors
    /// A value that is not positive.
    pub fn new(length: f64, inertia_per_length: f64, GJ: f64) -> Result<Self, StructureError> {
        Ok(Self {
            length: error::positive("length [m]", length)?,
            inertia_per_length: error::positive(
                "polar moment of inertia per length [kg m]",
                inertia_per_length,
            )?,
            GJ: error::positive("GJ [N m²]", GJ)?,
        })
    }

    fn wave_number(&self, k: usize) -> f64 {
        (k as f64 + 0.5) * PI / self.length
    }

    fn scale(&self, k: usize) -> f64 {
        Cantilever::sign(k) * (2.0 / (self.inertia_per_length * self.length)).sqrt()
    }

    /// Angular frequency of mode `k` \[rad/s\].
    pub fn frequency(&self, k: usize) -> f64 {
        self.wave_number(k) * (self.GJ / self.inertia_per_length).sqrt()
    }

    /// Angle of mode `k` at `s` \[m\] from the root, and its slope.
    pub fn shape(&self, k: usize, s: f64) -> (f64, f64) {
        let (b, scale) = (self.wave_number(k), self.scale(k));
        (scale * (b * s).sin(), scale * b * (b * s).cos())
    }
}
