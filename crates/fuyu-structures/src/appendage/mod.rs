//! A deformable body that is attached to a rigid body.

mod invariants;
mod kinetics;
mod points;
mod spin;

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3};

pub use self::{
    invariants::{Invariants, cross_moment},
    kinetics::Kinetics,
    points::{MassPoint, pair_index},
    spin::FirstOrderLimits,
};
use crate::{StructureError, eigen::check_symmetric, error, generalized_eigen};
pub(crate) use points::pairs;

/// Angular rate of the attachment as a fraction of the first frequency above which first-order modes do not suffice: the
/// missing centrifugal stiffness is then .7 % of the frequency.
pub const FIRST_ORDER_RATE: f64 = 0.1;

/// Tip deflection as a fraction of the length above which first-order modes do not suffice.
pub const FIRST_ORDER_DEFLECTION: f64 = 0.03;

/// Smallest eigenvalue, with its sign turned, that rounding of given digits may give a singular mass matrix with unit
/// diagonal.
const COUPLED_MASS_ROUNDING: f64 = 1e-6;

/// A point of a deformable body at which its deformation is of interest, such as its tip.
///
/// Its position is `position + Σ translation_k μ_k + ½ Σ chi_kl μ_k μ_l` \[m\], its small rotation `Σ rotation_k μ_k` \[rad\].
/// All in axes of the attachment frame.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputPoint {
    /// Its name in messages and plots.
    pub name: String,
    /// Undeformed position \[m\].
    pub position: Vector3<f64>,
    /// One for each mode \[m per unit of μ\].
    pub translation: Vec<Vector3<f64>>,
    /// One for each mode \[rad per unit of μ\].
    pub rotation: Vec<Vector3<f64>>,
    /// Second-order displacement, one for each pair of modes in the order of [`pair_index`], or empty.
    pub chi: Vec<Vector3<f64>>,
}

impl OutputPoint {
    /// Displacement \[m\] at modal coordinates `mu`.
    pub fn displacement(&self, mu: &[f64]) -> Vector3<f64> {
        let mut sum = combined(&self.translation, mu);
        for (chi, (k, l)) in self.chi.iter().zip(pairs(mu.len())) {
            let factor = if k == l { 0.5 } else { 1.0 };
            sum += chi * (factor * mu[k] * mu[l]);
        }
        sum
    }

    /// Small rotation \[rad\] at modal coordinates `mu`.
    pub fn rotation(&self, mu: &[f64]) -> Vector3<f64> {
        combined(&self.rotation, mu)
    }

    fn transformed(&self, T: &DMatrix<f64>) -> Self {
        let mix = |values: &[Vector3<f64>]| {
            T.column_iter()
                .map(|c| combined(values, c.iter()))
                .collect()
        };
        let n = T.nrows();
        let chi = |(i, j): (usize, usize)| {
            let all = (0..n).flat_map(|k| (0..n).map(move |l| (k, l)));
            all.map(|(k, l)| self.chi[pair_index(n, k, l)] * (T[(k, i)] * T[(l, j)]))
                .sum()
        };
        Self {
            name: self.name.clone(),
            position: self.position,
            translation: mix(&self.translation),
            rotation: mix(&self.rotation),
            chi: if self.chi.is_empty() {
                Vec::new()
            } else {
                pairs(T.ncols()).map(chi).collect()
            },
        }
    }
}

/// A deformable body attached to a rigid body, with the data for a multibody engine.
///
/// The attachment frame A is fixed to the rigid body at the attachment; the deformed shape is zero there. Modal coordinates μ (n of them) have
/// `modal_mass μ'' + modal_damping μ' + modal_stiffness μ = forces` when A does not move. The matrices need not be
/// diagonal. Everything is about the origin of A and in its axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Appendage {
    /// Its name in messages.
    pub name: String,
    /// Names of the modes, n of them.
    pub mode_names: Vec<String>,
    /// Mass integrals of the body and its shapes.
    pub invariants: Invariants,
    /// n x n, symmetric positive definite. `∫ psi_k · psi_l dm`, and rotary inertia where the source has it.
    pub modal_mass: DMatrix<f64>,
    /// n x n, symmetric positive definite.
    pub modal_stiffness: DMatrix<f64>,
    /// n x n, symmetric positive semidefinite.
    pub modal_damping: DMatrix<f64>,
    /// Points of interest.
    pub outputs: Vec<OutputPoint>,
}

impl Appendage {
    /// How many modes there are, n.
    pub fn modes(&self) -> usize {
        self.invariants.modes()
    }

    /// A body of which only the linear equations are known: constrained frequencies \[rad/s\], damping ratios and coupling P
    /// (n x 6, mass-normalised, about the attachment) as in Kida 1993 eq. (2.5). `rigid` is mass, first moment and
    /// inertia about the attachment.
    ///
    /// # Errors
    /// Lengths that differ, a frequency that is not positive, a negative damping ratio.
    pub fn from_coupling(
        name: &str,
        rigid: (f64, Vector3<f64>, Matrix3<f64>),
        frequencies: &[f64],
        damping_ratios: &[f64],
        P: &DMatrix<f64>,
    ) -> Result<Self, StructureError> {
        let n = frequencies.len();
        error::size("coupling P", P.shape(), (n, 6))?;
        let mut invariants = Invariants::rigid(rigid.0, rigid.1, rigid.2, n, false);
        for k in 0..n {
            invariants.set_first(1 + k, Vector3::new(P[(k, 0)], P[(k, 1)], P[(k, 2)]));
            invariants.set_second(
                0,
                1 + k,
                antisymmetric(Vector3::new(P[(k, 3)], P[(k, 4)], P[(k, 5)])),
            );
        }
        Self::with_frequencies(name, invariants, frequencies, damping_ratios)
    }

    /// Mass-normalised modes of a body with known invariants.
    ///
    /// # Errors
    /// Lengths that differ, a frequency that is not positive, a negative damping ratio.
    pub fn with_frequencies(
        name: &str,
        invariants: Invariants,
        frequencies: &[f64],
        damping_ratios: &[f64],
    ) -> Result<Self, StructureError> {
        let n = invariants.modes();
        error::size("frequencies", (frequencies.len(), 1), (n, 1))?;
        error::size("damping ratios", (damping_ratios.len(), 1), (n, 1))?;
        for k in 0..n {
            error::positive(
                format_args!("{name}, frequency of mode {k} [rad/s]"),
                frequencies[k],
            )?;
            error::not_negative(
                format_args!("{name}, damping ratio of mode {k}"),
                damping_ratios[k],
            )?;
        }
        let diagonal =
            |f: &dyn Fn(usize) -> f64| DMatrix::from_diagonal(&DVector::from_fn(n, |k, _| f(k)));
        let appendage = Self {
            name: name.to_owned(),
            mode_names: (0..n).map(|k| format!("mode{}", k + 1)).collect(),
            invariants,
            modal_mass: DMatrix::identity(n, n),
            modal_stiffness: diagonal(&|k| frequencies[k].powi(2)),
            modal_damping: diagonal(&|k| 2.0 * damping_ratios[k] * frequencies[k]),
            outputs: Vec::new(),
        };
        appendage.check()?;
        Ok(appendage)
    }

    /// Rejects values that no body can have. A program that fills in the fields itself should call this once.
    ///
    /// # Errors
    /// Matrices of other sizes than n x n, not symmetric or not positive (semi)definite; negative mass; an inertia that is
    /// not one of a body; output points with other numbers of modes. Whether the body has the mass that the modes move is
    /// checked by [`Self::check_coupled_mass`].
    pub fn check(&self) -> Result<(), StructureError> {
        let (n, name) = (self.modes(), &self.name);
        error::size(
            format_args!("{name}, names of the modes"),
            (self.mode_names.len(), 1),
            (n, 1),
        )?;
        error::not_negative(format_args!("{name}, mass [kg]"), self.invariants.mass())?;
        for a in 0..self.invariants.functions() {
            let field = format!("{name}, mass integrals of function {a}");
            error::finite(&field, self.invariants.first(a).sum())?;
            for b in a..self.invariants.functions() {
                error::finite(&field, self.invariants.second(a, b).sum())?;
            }
        }
        for (field, matrix, definite) in [
            ("modal mass", &self.modal_mass, true),
            ("modal stiffness", &self.modal_stiffness, true),
            ("modal damping", &self.modal_damping, false),
        ] {
            let field = format!("{name}, {field}");
            error::size(&field, matrix.shape(), (n, n))?;
            check_symmetric(&field, matrix)?;
            // A semidefinite matrix passes with a small part of its largest entry added.
            let margin = if definite {
                0.0
            } else {
                1e-9 * matrix.amax() + f64::MIN_POSITIVE
            };
            let shifted = matrix + DMatrix::identity(n, n) * margin;
            if n > 0 && shifted.cholesky().is_none() {
                let property = if definite {
                    "positive definite"
                } else {
                    "positive semidefinite"
                };
                let remedy = "frequencies must be positive, damping zero or positive";
                return Err(StructureError::Matrix {
                    matrix: field,
                    property,
                    remedy,
                });
            }
        }
        for output in &self.outputs {
            let field = format!("{name}, output point {}", output.name);
            error::size(&field, (output.translation.len(), 3), (n, 3))?;
            error::size(&field, (output.rotation.len(), 3), (n, 3))?;
            if !output.chi.is_empty() {
                error::size(&field, (output.chi.len(), 3), (n * (n + 1) / 2, 3))?;
            }
        }
        Ok(())
    }

    /// Rejects a mass matrix of rigid motion and modes together that is not positive semidefinite: the modes move more mass
    /// than there is. `carrier` is the mass matrix of the rigid body that carries this one, for a velocity `(v, w)` of
    /// the attachment frame about its origin, or zero; the air table of Kida 1993 has the mass of its appendage there.
    /// A slender body has no inertia about its axis, so that the matrix may be singular. Each row is scaled by its
    /// diagonal entry first.
    ///
    /// # Errors
    /// [`StructureError::Matrix`].
    pub fn check_coupled_mass(&self, carrier: &Matrix6<f64>) -> Result<(), StructureError> {
        let (n, P) = (self.modes(), self.coupling());
        let mut M = DMatrix::zeros(6 + n, 6 + n);
        M.view_mut((0, 0), (6, 6))
            .copy_from(&(self.rigid_mass_matrix() + carrier));
        M.view_mut((6, 0), (n, 6)).copy_from(&P);
        M.view_mut((0, 6), (6, n)).copy_from(&P.transpose());
        M.view_mut((6, 6), (n, n)).copy_from(&self.modal_mass);
        let scale = M
            .diagonal()
            .map(|m| if m > 0.0 { m.sqrt().recip() } else { 1.0 });
        let scaled = DMatrix::from_fn(6 + n, 6 + n, |i, j| scale[i] * M[(i, j)] * scale[j]);
        if scaled.symmetric_eigenvalues().min() >= -COUPLED_MASS_ROUNDING {
            return Ok(());
        }
        Err(StructureError::Matrix {
            matrix: format!("{}, mass matrix of body and modes together", self.name),
            property: "positive semidefinite",
            remedy: "the modes move more mass than the body and what carries it have: check units, reference point and modal mass",
        })
    }

    /// Coupling of the modes to the motion of the attachment: row k is `(∫ psi_k dm, ∫ X × psi_k dm)` about the attachment, n x 6,
    /// columns translation x, y, z, rotation x, y, z. It is P of Kida 1993 eq. (B.4), with plus before the last term, as
    /// his eq. (C.1) and the vector equation before (B.2) have it.
    pub fn coupling(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.modes(), 6, |k, j| match j {
            0..3 => self.invariants.first(1 + k)[j],
            _ => cross_moment(&self.invariants.second(0, 1 + k))[j - 3],
        })
    }

    /// Mass of mode `k` that follows each motion of the attachment: `P_kj² / modal mass` \[kg, kg m²\]. Meaningful for a
    /// diagonal modal mass.
    pub fn effective_mass(&self, k: usize) -> [f64; 6] {
        let P = self.coupling();
        std::array::from_fn(|j| P[(k, j)].powi(2) / self.modal_mass[(k, k)])
    }

    /// Mass matrix of the undeformed body for a velocity `(v, w)` of the attachment frame, about its origin.
    pub fn rigid_mass_matrix(&self) -> Matrix6<f64> {
        let body = &self.invariants;
        rigid_matrix(body.mass(), &body.first(0), &body.inertia())
    }

    /// Undamped angular frequencies with the attachment held \[rad/s\], ascending.
    ///
    /// # Errors
    /// As [`Appendage::check`].
    pub fn frequencies(&self) -> Result<DVector<f64>, StructureError> {
        Ok(generalized_eigen(&self.modal_stiffness, &self.modal_mass)?
            .values
            .map(|v| v.max(0.0).sqrt()))
    }

    /// The same body in new modal coordinates ν with `μ = T ν`, `T` of n x m.
    ///
    /// # Errors
    /// A `T` with another number of rows than there are modes, or as [`Appendage::check`].
    pub fn transformed(&self, T: &DMatrix<f64>) -> Result<Self, StructureError> {
        self.check()?;
        let part = |m: &DMatrix<f64>| (T.transpose() * m * T).symmetric_part();
        Ok(Self {
            name: self.name.clone(),
            mode_names: (0..T.ncols()).map(|k| format!("mode{}", k + 1)).collect(),
            invariants: self.invariants.transformed(T)?,
            modal_mass: part(&self.modal_mass),
            modal_stiffness: part(&self.modal_stiffness),
            modal_damping: part(&self.modal_damping),
            outputs: self.outputs.iter().map(|o| o.transformed(T)).collect(),
        })
    }

    /// The same body with mass-normalised modes, ascending in frequency: modal mass the identity and modal stiffness
    /// diagonal. Each is positive in the largest component of its displacement at the first output point, or of its rotation if
    /// that point does not move.
    ///
    /// # Errors
    /// As [`Appendage::check`].
    pub fn diagonalised(&self) -> Result<Self, StructureError> {
        let mut vectors = generalized_eigen(&self.modal_stiffness, &self.modal_mass)?.vectors;
        if let Some(tip) = self.outputs.first() {
            for mut shape in vectors.column_iter_mut() {
                let displacement = combined(&tip.translation, shape.iter());
                let rotation = combined(&tip.rotation, shape.iter());
                let leading = if displacement.amax() > 1e-6 * rotation.amax() {
                    displacement
                } else {
                    rotation
                };
                if leading[leading.iamax()] < 0.0 {
                    shape.neg_mut();
                }
            }
        }
        let mut result = self.transformed(&vectors)?;
        // Clears the rounding of the congruence.
        result.modal_mass.fill_with_identity();
        result.modal_stiffness = DMatrix::from_diagonal(&result.modal_stiffness.diagonal());
        let largest = result.modal_damping.amax();
        result.modal_damping.apply(|c| {
            if c.abs() < 1e-13 * largest {
                *c = 0.0;
            }
        });
        Ok(result)
    }

    /// The same body with the given modes only, in the given order.
    ///
    /// # Errors
    /// A mode that does not exist, or as [`Appendage::check`].
    pub fn selected(&self, modes: &[usize]) -> Result<Self, StructureError> {
        let n = self.modes();
        let mut T = DMatrix::zeros(n, modes.len());
        for (column, k) in modes.iter().enumerate() {
            error::index(format_args!("{}, selected mode", self.name), *k, n)?;
            T[(*k, column)] = 1.0;
        }
        let mut result = self.transformed(&T)?;
        result.mode_names = modes.iter().map(|k| self.mode_names[*k].clone()).collect();
        Ok(result)
    }

    /// The same body without second order.
    pub fn first_order(&self) -> Self {
        let mut result = self.clone();
        result.invariants = self.invariants.first_order();
        result.outputs.iter_mut().for_each(|o| o.chi.clear());
        result
    }
}

/// `Σ v_k x_k`.
fn combined<'a>(
    vectors: &[Vector3<f64>],
    factors: impl IntoIterator<Item = &'a f64>,
) -> Vector3<f64> {
    vectors.iter().zip(factors).map(|(v, x)| v * *x).sum()
}

/// Mass matrix of a body for a velocity `(v, w)` of a frame: its mass, first moment and inertia about the frame's origin.
fn rigid_matrix(mass: f64, S: &Vector3<f64>, J: &Matrix3<f64>) -> Matrix6<f64> {
    let mut M = Matrix6::identity() * mass;
    M.fixed_view_mut::<3, 3>(0, 3).copy_from(&-S.cross_matrix());
    M.fixed_view_mut::<3, 3>(3, 0).copy_from(&S.cross_matrix());
    M.fixed_view_mut::<3, 3>(3, 3).copy_from(J);
    M
}

/// The antisymmetric `∫ X ψᵀ dm` whose `∫ X × ψ dm` is `moment`.
pub(crate) fn antisymmetric(moment: Vector3<f64>) -> Matrix3<f64> {
    -moment.cross_matrix() / 2.0
}
