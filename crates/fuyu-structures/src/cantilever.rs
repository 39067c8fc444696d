//! Closed forms of uniform cantilevers.

use std::f64::consts::PI;

use crate::{Deflection, StructureError, error};

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
        let mut z = (k as f64 + 0.5) * PI;
        // The roots of cos z + 1/cosh z; Newton's method converges quadratically from here.
        for _ in 0..12 {
            let (value, slope) = (z.cos() + 1.0 / z.cosh(), -z.sin() - z.tanh() / z.cosh());
            z -= value / slope;
        }
        z
    }

    /// The ratio σ of the shape's two parts, and `(1 - σ) exp z`, neither with cancellation or overflow.
    fn ratio(z: f64) -> (f64, f64) {
        let small = (-z).exp();
        let half = 0.5 * small * small;
        let divisor = 0.5 - half + z.sin() * small;
        (
            (0.5 + half + z.cos() * small) / divisor,
            (z.sin() - z.cos() - small) / divisor,
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
        // (1 - σ) sinh u and (1 - σ) cosh u.
        let (up, down) = (0.5 * (u - z).exp(), 0.5 * (-u - z).exp());
        let (sinh, cosh) = (rest * (up - down), rest * (up + down));
        Deflection {
            value: scale * ((-u).exp() + sinh - cos + sigma * sin),
            slope: scale * b * (-(-u).exp() + cosh + sin + sigma * cos),
            curvature: scale * b * b * ((-u).exp() + sinh + cos - sigma * sin),
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

#[cfg(test)]
mod tests {
    use super::*;

    // High modes were those of mode 99; sinh and cosh overflow from mode 226 on.
    #[test]
    fn high_modes_have_their_own_frequency_and_shape() {
        let beam = Cantilever::new(2.0, 3.0, 5.0).unwrap();
        for k in [0, 5, 99, 100, 150, 300, 2000] {
            let z = (k as f64 + 0.5) * PI;
            let expected = (z / 2.0).powi(2) * (5.0_f64 / 3.0).sqrt();
            let tolerance = if k == 0 { 0.5 } else { 1e-5 };
            assert!(
                (beam.frequency(k) / expected - 1.0).abs() < tolerance,
                "{k}"
            );
            // At the tip the deflection is 2 / sqrt(m) and the curvature zero; at the root all is at rest.
            let (tip, root) = (beam.shape(k, 2.0), beam.shape(k, 0.0));
            let (size, bend) = (2.0 / 6.0_f64.sqrt(), (z / 2.0).powi(2));
            assert!((tip.value - size).abs() < 1e-9 * z, "{k}: {tip:?}");
            assert!(tip.curvature.abs() < 1e-9 * bend * z, "{k}: {tip:?}");
            assert!(
                root.value.abs() < 1e-12 && root.slope.abs() < 1e-9 * z,
                "{k}"
            );
        }
        // Orthogonality needs the right shape in between.
        let steps = 200_000;
        let product = |a: usize, b: usize| {
            let at = |i: i32| 2.0 * (f64::from(i) + 0.5) / f64::from(steps);
            let terms = (0..steps).map(|i| beam.shape(a, at(i)).value * beam.shape(b, at(i)).value);
            terms.sum::<f64>() * 6.0 / f64::from(steps)
        };
        assert!((product(300, 300) - 1.0).abs() < 1e-3);
        assert!(product(300, 301).abs() < 1e-3);
    }
}
