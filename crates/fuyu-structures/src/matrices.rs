//! A structure as mass and stiffness matrices, and its modes.

use nalgebra::{DMatrix, DVector};

use crate::{
    StructureError,
    eigen::{check_symmetric, cholesky},
    error, lowest_modes,
};

/// Mass and stiffness matrices of a structure with `n` degrees of freedom.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrices {
    /// Mass, n x n, symmetric.
    pub M: DMatrix<f64>,
    /// Stiffness, n x n, symmetric.
    pub K: DMatrix<f64>,
}

/// Modes of a structure: `K φ = ω² M φ` with `φᵀ M φ = 1`.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes {
    /// Angular frequencies \[rad/s\], ascending; zero for rigid-body motion.
    pub frequencies: DVector<f64>,
    /// One column for each mode, n rows with zeros at fixed degrees of freedom. The sign is such that the entry of largest
    /// magnitude is positive (the first of them if several differ by less than 1e-6).
    pub shapes: DMatrix<f64>,
}

impl Matrices {
    /// Matrices that another program computed.
    ///
    /// # Errors
    /// Matrices of different sizes, or not symmetric or finite.
    pub fn new(M: DMatrix<f64>, K: DMatrix<f64>) -> Result<Self, StructureError> {
        check_symmetric("mass matrix M", &M)?;
        check_symmetric("stiffness matrix K", &K)?;
        error::size("stiffness matrix K", K.shape(), M.shape())?;
        Ok(Self { M, K })
    }

    /// How many degrees of freedom there are.
    pub fn len(&self) -> usize {
        self.M.nrows()
    }

    /// Whether there is no degree of freedom.
    pub fn is_empty(&self) -> bool {
        self.M.is_empty()
    }

    /// The degrees of freedom that are not in `fixed`.
    fn free(&self, fixed: &[usize]) -> Result<Vec<usize>, StructureError> {
        error::others("fixed degree of freedom", fixed, self.len())
    }

    /// The matrices with some degrees of freedom held at zero, which removes their rows and columns.
    ///
    /// # Errors
    /// A degree of freedom that does not exist.
    pub fn held(&self, fixed: &[usize]) -> Result<Self, StructureError> {
        Ok(self.part(&self.free(fixed)?))
    }

    fn part(&self, dofs: &[usize]) -> Self {
        let part = |m: &DMatrix<f64>| m.select_rows(dofs).select_columns(dofs);
        Self {
            M: part(&self.M),
            K: part(&self.K),
        }
    }

    /// The `count` lowest modes with some degrees of freedom held at zero: constrained modes if the attachment is held,
    /// unconstrained ones if `fixed` is empty.
    ///
    /// # Errors
    /// A degree of freedom that does not exist, more modes than degrees of freedom, `M` not positive definite, `K` with a negative
    /// eigenvalue.
    pub fn modes(&self, fixed: &[usize], count: usize) -> Result<Modes, StructureError> {
        let free = self.free(fixed)?;
        let held = self.part(&free);
        let eigen = lowest_modes(&held.K, &held.M, count)?;
        let mut shapes = DMatrix::zeros(self.len(), count);
        for (row, dof) in free.iter().enumerate() {
            shapes.row_mut(*dof).copy_from(&eigen.vectors.row(row));
        }
        for mut shape in shapes.column_iter_mut() {
            let largest = shape.amax();
            let leading = shape
                .iter()
                .find(|v| v.abs() >= (1.0 - 1e-6) * largest)
                .copied();
            if leading.is_some_and(|v| v < 0.0) {
                shape.neg_mut();
            }
        }
        Ok(Modes {
            frequencies: eigen.values.map(f64::sqrt),
            shapes,
        })
    }

    /// Static condensation (Guyan 1965): the degrees of freedom that are not kept follow those kept as if they had no
    /// mass. Returns the condensed matrices and the transformation from kept to all degrees of freedom (n x kept).
    ///
    /// # Errors
    /// A degree of freedom that does not exist; stiffness of the others singular.
    pub fn condensed(&self, kept: &[usize]) -> Result<(Self, DMatrix<f64>), StructureError> {
        let T = self.static_shapes(kept, &[])?;
        let M = T.transpose() * &self.M * &T;
        let K = T.transpose() * &self.K * &T;
        Ok((
            Self {
                M: M.symmetric_part(),
                K: K.symmetric_part(),
            },
            T,
        ))
    }

    /// Craig-Bampton basis: a static shape for each of the `boundary` degrees of freedom (unit displacement of one, the other
    /// boundary ones zero), then `count` modes with the boundary held. The degrees of freedom in `fixed` stay zero.
    /// Returns n x (boundary + count).
    ///
    /// # Errors
    /// A degree of freedom that does not exist, too many modes, singular stiffness of the interior.
    pub fn craig_bampton(
        &self,
        boundary: &[usize],
        fixed: &[usize],
        count: usize,
    ) -> Result<DMatrix<f64>, StructureError> {
        let statics = self.static_shapes(boundary, fixed)?;
        let held: Vec<usize> = fixed.iter().chain(boundary).copied().collect();
        let modes = self.modes(&held, count)?;
        let mut basis = DMatrix::zeros(self.len(), boundary.len() + count);
        basis.columns_mut(0, boundary.len()).copy_from(&statics);
        basis
            .columns_mut(boundary.len(), count)
            .copy_from(&modes.shapes);
        Ok(basis)
    }

    fn static_shapes(
        &self,
        boundary: &[usize],
        fixed: &[usize],
    ) -> Result<DMatrix<f64>, StructureError> {
        let held: Vec<usize> = fixed.iter().chain(boundary).copied().collect();
        let interior = self.free(&held)?;
        let mut shapes = DMatrix::zeros(self.len(), boundary.len());
        for (column, dof) in boundary.iter().enumerate() {
            shapes[(*dof, column)] = 1.0;
        }
        if interior.is_empty() {
            return Ok(shapes);
        }
        let inner = self.K.select_rows(&interior);
        let factor = cholesky(
            inner.select_columns(&interior),
            "stiffness of the inner degrees of freedom",
            "keep more degrees of freedom, so that the others cannot move freely",
        )?;
        let solution = factor.solve(&-inner.select_columns(boundary));
        for (row, dof) in interior.iter().enumerate() {
            shapes.row_mut(*dof).copy_from(&solution.row(row));
        }
        Ok(shapes)
    }
}
