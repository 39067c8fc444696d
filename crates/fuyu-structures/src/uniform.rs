//! Structures without a rigid part: the FEM and modal models of Kida 1993 section 2.2, their poles and transmission zeros.

use nalgebra::{Complex, DMatrix, DVector};

use crate::{Matrices, StructureError, error, lowest_modes, quadratic_roots};

/// `M w'' + D w' + K w = L u`, `y = Lᵀ w` (eq. (2.1)): sensors and actuators at the same places, in the same directions.
#[derive(Clone, Debug)]
pub struct FemModel {
    /// Mass and stiffness, n x n.
    pub matrices: Matrices,
    /// Damping, n x n, symmetric positive semidefinite.
    pub D: DMatrix<f64>,
    /// Inputs, n x r, of full column rank.
    pub L: DMatrix<f64>,
}

impl FemModel {
    /// A structure with unit forces on some degrees of freedom, whose displacements are measured.
    ///
    /// # Errors
    /// A degree of freedom that does not exist; damping of another size.
    pub fn collocated(
        matrices: Matrices,
        D: DMatrix<f64>,
        dofs: &[usize],
    ) -> Result<Self, StructureError> {
        let n = matrices.len();
        error::size("damping matrix D", D.shape(), (n, n))?;
        let mut L = DMatrix::zeros(n, dofs.len());
        for (column, dof) in dofs.iter().enumerate() {
            error::index("degree of freedom of an input", *dof, n)?;
            L[(*dof, column)] = 1.0;
        }
        Ok(Self { matrices, D, L })
    }

    /// Poles of eq. (2.2) other than the double ones at zero of each rigid-body motion, 2 (n - n_0) of them.
    ///
    /// # Errors
    /// Matrices that are not those of a structure; damping of rigid-body motion.
    pub fn poles(&self) -> Result<Vec<Complex<f64>>, StructureError> {
        let n = self.matrices.len();
        let eigen = lowest_modes(&self.matrices.K, &self.matrices.M, n)?;
        let rigid = eigen.values.iter().filter(|v| **v == 0.0).count();
        let D = eigen.vectors.transpose() * &self.D * &eigen.vectors;
        if rigid > 0 && D.columns(0, rigid).amax() > 1e-9 * D.amax() {
            return Err(StructureError::Matrix {
                matrix: "damping matrix D".to_owned(),
                property: "zero for rigid-body motion",
                remedy: "only deformation of the structure is damped (Kida 1993, after eq. (2.1))",
            });
        }
        let elastic = n - rigid;
        let D = D.view((rigid, rigid), (elastic, elastic)).symmetric_part();
        let K = DMatrix::from_diagonal(&eigen.values.rows(rigid, elastic).into_owned());
        quadratic_roots(&DMatrix::identity(elastic, elastic), &D, &K)
    }

    /// Transmission zeros by theorem 2.1: poles of the structure with the displacements that are measured held at zero, 2 (n - r) of
    /// them.
    ///
    /// # Errors
    /// No input; dependent inputs; inputs that leave a rigid-body motion free.
    pub fn zeros(&self) -> Result<Vec<Complex<f64>>, StructureError> {
        let (n, r) = self.L.shape();
        error::positive("number of inputs", r as f64)?;
        error::size("input matrix L", (n, r), (self.matrices.len(), r))?;
        // An orthonormal basis of the displacements with Lᵀ w = 0 takes the place of the book's standard form L = [L0; 0].
        let projector = &self.L * self.L.transpose();
        let eigen = crate::eigen::symmetric_eigen(&projector, "L Lᵀ")?;
        let largest = eigen.values.amax();
        let rank = eigen
            .values
            .iter()
            .filter(|v| **v > 1e-12 * largest)
            .count();
        if rank < r {
            return Err(dependent("input matrix L"));
        }
        let held = eigen.vectors.columns(0, n - r);
        let part = |m: &DMatrix<f64>| (held.transpose() * m * held).symmetric_part();
        quadratic_roots(
            &part(&self.matrices.M),
            &part(&self.D),
            &part(&self.matrices.K),
        )
    }

    /// The `count` lowest unconstrained modes as a model, eq. (2.3), with a damping ratio for each.
    ///
    /// # Errors
    /// Too many modes; another number of damping ratios.
    pub fn modal(
        &self,
        damping_ratios: &[f64],
        count: usize,
    ) -> Result<ModalModel, StructureError> {
        let eigen = lowest_modes(&self.matrices.K, &self.matrices.M, count)?;
        ModalModel::new(
            eigen.values.map(f64::sqrt),
            DVector::from_column_slice(damping_ratios),
            eigen.vectors.transpose() * &self.L,
        )
    }
}

/// `η'' + 2 Z Σ η' + Σ² η = Φᵀ L u`, `y = Lᵀ Φ η` (eq. (2.3)): unconstrained modes.
#[derive(Clone, Debug)]
pub struct ModalModel {
    /// Σ, angular frequencies \[rad/s\], zero for rigid-body motion.
    pub frequencies: DVector<f64>,
    /// Z, damping ratios \[-\].
    pub damping_ratios: DVector<f64>,
    /// Φᵀ L, n x r.
    pub inputs: DMatrix<f64>,
}

impl ModalModel {
    /// A model from its parts.
    ///
    /// # Errors
    /// Lengths that differ; a negative frequency or damping ratio.
    pub fn new(
        frequencies: DVector<f64>,
        damping_ratios: DVector<f64>,
        inputs: DMatrix<f64>,
    ) -> Result<Self, StructureError> {
        let n = frequencies.len();
        error::size("damping ratios", (damping_ratios.len(), 1), (n, 1))?;
        error::size("modal inputs", inputs.shape(), (n, inputs.ncols()))?;
        for k in 0..n {
            error::not_negative(
                format_args!("frequency of mode {k} [rad/s]"),
                frequencies[k],
            )?;
            error::not_negative(format_args!("damping ratio of mode {k}"), damping_ratios[k])?;
        }
        Ok(Self {
            frequencies,
            damping_ratios,
            inputs,
        })
    }

    /// Transmission zeros by theorem 2.2, 2 (n - r) of them: roots of
    /// `det[Δ (s² + 2 Z₁ Σ₁ s + Σ₁²) Δᵀ + s² + 2 Z₂ Σ₂ s + Σ₂²]` with `Δ = Φ₂ᵀ L (Φ₁ᵀ L)⁻¹`.
    ///
    /// Which r modes are the first block is arbitrary as long as `Φ₁ᵀ L` is regular; those of a pivoted QR decomposition are
    /// chosen, which makes it as regular as possible.
    ///
    /// # Errors
    /// Fewer modes than inputs, or dependent inputs.
    pub fn zeros(&self) -> Result<Vec<Complex<f64>>, StructureError> {
        let (n, r) = self.inputs.shape();
        error::count("number of inputs", r, 1, n)?;
        let mut order = DMatrix::from_fn(1, n, |_, k| k as f64);
        self.inputs
            .transpose()
            .col_piv_qr()
            .p()
            .permute_columns(&mut order);
        let order: Vec<usize> = order.iter().map(|k| *k as usize).collect();
        let (first, second) = order.split_at(r);
        let first_inputs = self.inputs.select_rows(first);
        let inverse = first_inputs
            .clone()
            .try_inverse()
            .filter(|i| i.norm() * first_inputs.norm() < 1e12);
        let inverse = inverse.ok_or_else(|| dependent("modal inputs Φᵀ L"))?;
        let delta = self.inputs.select_rows(second) * inverse;
        let diagonal = |modes: &[usize], f: &dyn Fn(f64, f64) -> f64| {
            let entries = modes
                .iter()
                .map(|k| f(self.frequencies[*k], self.damping_ratios[*k]));
            DMatrix::from_diagonal(&DVector::from_iterator(modes.len(), entries))
        };
        let part = |f: &dyn Fn(f64, f64) -> f64| {
            (&delta * diagonal(first, f) * delta.transpose() + diagonal(second, f)).symmetric_part()
        };
        quadratic_roots(
            &part(&|_, _| 1.0),
            &part(&|w, z| 2.0 * z * w),
            &part(&|w, _| w * w),
        )
    }
}

pub(crate) fn dependent(matrix: &str) -> StructureError {
    StructureError::Matrix {
        matrix: matrix.to_owned(),
        property: "of full rank",
        remedy: "choose independent inputs and outputs that reach every rigid-body motion",
    }
}
