//! Mass integrals over the shape functions of a deformable body, which do not depend on its state.

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::points::{MassPoint, pair_index, pairs};
use crate::{StructureError, error};

/// Mass integrals of a body with displacement `r = Σ c_a φ_a`.
///
/// The functions φ are numbered: 0 is the undeformed position X with c = 1; `1 + k` is psi_k with c = μ_k; then, for second order,
/// one for each pair `k <= l` in the order of [`pair_index`]: chi_kl with c = μ_k μ_l, or μ_k²/2 if k = l.
/// Everything is in axes of the attachment frame A and about its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Invariants {
    modes: usize,
    mass: f64,
    first: Vec<Vector3<f64>>,
    second: Vec<Matrix3<f64>>,
}

impl Invariants {
    /// Integrals of a rigid body to which modes are added with [`Invariants::set_first`] and [`Invariants::set_second`]; all
    /// others are zero.
    pub fn rigid(
        mass: f64,
        first_moment: Vector3<f64>,
        inertia: Matrix3<f64>,
        modes: usize,
        second_order: bool,
    ) -> Self {
        let mut invariants = Self::zeros(mass, modes, second_order);
        invariants.first[0] = first_moment;
        invariants.second[0] = Matrix3::identity() * (inertia.trace() / 2.0) - inertia;
        invariants
    }

    /// All integrals zero, except the mass.
    fn zeros(mass: f64, modes: usize, second_order: bool) -> Self {
        let pairs = if second_order {
            pairs(modes).count()
        } else {
            0
        };
        let functions = 1 + modes + pairs;
        Self {
            modes,
            mass,
            first: vec![Vector3::zeros(); functions],
            second: vec![Matrix3::zeros(); functions * functions],
        }
    }

    /// Sums over mass points.
    ///
    /// # Errors
    /// No point; points with different numbers of modes; a number that is not finite; negative mass.
    pub fn from_points(points: &[MassPoint]) -> Result<Self, StructureError> {
        let first = points.first().ok_or_else(|| StructureError::Size {
            field: "the list of mass points".to_owned(),
            found: "no entry".to_owned(),
            expected: "one or more".to_owned(),
        })?;
        let (modes, second_order) = (first.psi.len(), !first.chi.is_empty());
        let mut sums = Self::zeros(0.0, modes, second_order);
        let functions = sums.functions();
        let mut values = vec![Vector3::zeros(); functions];
        for (i, point) in points.iter().enumerate() {
            error::size(
                format_args!("psi of mass point {i}"),
                (point.psi.len(), 3),
                (modes, 3),
            )?;
            error::size(
                format_args!("chi of mass point {i}"),
                (point.chi.len(), 3),
                (functions - 1 - modes, 3),
            )?;
            error::not_negative(format_args!("mass of mass point {i} [kg]"), point.mass)?;
            values[0] = point.position;
            values[1..=modes].copy_from_slice(&point.psi);
            values[1 + modes..].copy_from_slice(&point.chi);
            sums.mass += point.mass;
            for a in 0..functions {
                let weighted = values[a] * point.mass;
                error::finite(
                    format_args!("a displacement of mass point {i}"),
                    weighted.sum(),
                )?;
                sums.first[a] += weighted;
                let row = sums.second[a * functions..].iter_mut().skip(a);
                for (second, value) in row.zip(&values[a..]) {
                    *second += weighted * value.transpose();
                }
            }
        }
        for a in 0..functions {
            for b in a..functions {
                sums.set_second(a, b, sums.second(a, b));
            }
        }
        Ok(sums)
    }

    /// How many modes there are, n.
    pub fn modes(&self) -> usize {
        self.modes
    }

    /// Whether there are integrals of chi.
    pub fn second_order(&self) -> bool {
        self.functions() > 1 + self.modes
    }

    /// How many functions φ there are: 1 + n, or 1 + n + n (n + 1)/2 with second order.
    pub fn functions(&self) -> usize {
        self.first.len()
    }

    /// Number of the function chi_kl.
    pub fn pair_function(&self, k: usize, l: usize) -> usize {
        1 + self.modes + pair_index(self.modes, k, l)
    }

    /// Mass \[kg\].
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// `∫ φ_a dm` of function `a`. Function 0 is the first moment \[kg m\], `1 + k` is the S of mode k.
    pub fn first(&self, a: usize) -> Vector3<f64> {
        self.first[a]
    }

    /// `∫ φ_a φ_bᵀ dm` of functions `a` and `b`. (0, 0) is the second moment of mass \[kg m²\], (0, 1 + k) the N of mode k,
    /// (1 + k, 1 + l) the D of modes k and l.
    pub fn second(&self, a: usize, b: usize) -> Matrix3<f64> {
        self.second[a * self.functions() + b]
    }

    /// Replaces `∫ φ_a dm`.
    pub fn set_first(&mut self, a: usize, value: Vector3<f64>) {
        self.first[a] = value;
    }

    /// Replaces `∫ φ_a φ_bᵀ dm`, and with it that of (b, a), its transpose.
    pub fn set_second(&mut self, a: usize, b: usize, value: Matrix3<f64>) {
        let functions = self.functions();
        self.second[b * functions + a] = value.transpose();
        self.second[a * functions + b] = value;
    }

    /// Moment of inertia of the undeformed body about the attachment \[kg m²\].
    pub fn inertia(&self) -> Matrix3<f64> {
        Matrix3::identity() * self.second[0].trace() - self.second[0]
    }

    /// The same without second order.
    pub fn first_order(&self) -> Self {
        let mut result = Self::zeros(self.mass, self.modes, false);
        for a in 0..=self.modes {
            result.set_first(a, self.first(a));
            for b in a..=self.modes {
                result.set_second(a, b, self.second(a, b));
            }
        }
        result
    }

    /// The same in new coordinates ν with `μ = T ν`, `T` of n x m.
    ///
    /// # Errors
    /// A `T` with another number of rows than there are modes.
    pub fn transformed(&self, T: &DMatrix<f64>) -> Result<Self, StructureError> {
        error::size(
            "transformation of the modes",
            T.shape(),
            (self.modes, T.ncols()),
        )?;
        let m = T.ncols();
        let functions = self.functions();
        let mut result = Self::zeros(self.mass, m, self.second_order());
        // How the new functions follow from the old ones, one row for each new function.
        let mut mix = DMatrix::zeros(result.functions(), functions);
        mix[(0, 0)] = 1.0;
        for (i, k) in (0..m).flat_map(|i| (0..self.modes).map(move |k| (i, k))) {
            mix[(1 + i, 1 + k)] = T[(k, i)];
        }
        if self.second_order() {
            for (i, j) in pairs(m) {
                for (k, l) in (0..self.modes).flat_map(|k| (0..self.modes).map(move |l| (k, l))) {
                    mix[(result.pair_function(i, j), self.pair_function(k, l))] +=
                        T[(k, i)] * T[(l, j)];
                }
            }
        }
        for a in 0..result.functions() {
            let first = (0..functions).map(|c| self.first[c] * mix[(a, c)]).sum();
            result.set_first(a, first);
            for b in a..result.functions() {
                let mut second = Matrix3::zeros();
                for (c, d) in (0..functions).flat_map(|c| (0..functions).map(move |d| (c, d))) {
                    let factor = mix[(a, c)] * mix[(b, d)];
                    if factor != 0.0 {
                        second += self.second(c, d) * factor;
                    }
                }
                result.set_second(a, b, second);
            }
        }
        Ok(result)
    }
}

/// `∫ φ × ψ dm` from `∫ φ ψᵀ dm`.
pub fn cross_moment(second: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(
        second[(1, 2)] - second[(2, 1)],
        second[(2, 0)] - second[(0, 2)],
        second[(0, 1)] - second[(1, 0)],
    )
}
