//! The generalized symmetric eigenvalue problem `K x = λ M x`.

use std::fmt::Display;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

use crate::{StructureError, error};

/// Iterations that nalgebra may spend on one matrix before it is rejected, times its size.
const ITERATIONS_PER_ROW: usize = 60;

/// Eigenvalues and eigenvectors of `K x = λ M x`.
#[derive(Clone, Debug)]
pub struct Eigen {
    /// In ascending order.
    pub values: DVector<f64>,
    /// One column for each value; `Xᵀ M X = I`. Their signs are arbitrary.
    pub vectors: DMatrix<f64>,
}

/// All eigenvalues of `K x = λ M x` for symmetric `K` and symmetric positive definite `M`, by reduction with the
/// Cholesky factor of `M`.
///
/// The error of each eigenvalue is some 1e-16 of the largest one. Use [`lowest_modes`] if the lowest ones of a fine mesh are
/// needed to more digits. Empty matrices have no eigenvalues.
///
/// # Errors
/// Matrices that are not square, finite and symmetric or of different sizes; `M` not positive definite.
pub fn generalized_eigen(K: &DMatrix<f64>, M: &DMatrix<f64>) -> Result<Eigen, StructureError> {
    check_pair(K, M)?;
    reduced_eigen(&mass_factor(M)?, K, "M⁻¹ K")
}

/// The `count` lowest eigenvalues of `K x = λ M x` for symmetric positive semidefinite `K` and symmetric positive definite
/// `M`, by reduction with the Cholesky factor of `K`: the relative error of the lowest ones does not grow with the
/// stiffness of the mesh's smallest element.
///
/// If `K` is singular, which it is for a body that can move freely, the factor is that of `K + σ M` with σ the lowest elastic
/// eigenvalue. Eigenvalues below 1e-9 σ are rigid-body modes and returned as zero.
///
/// # Errors
/// As [`generalized_eigen`]; `K` with a negative eigenvalue; `count` larger than the matrices.
pub fn lowest_modes(
    K: &DMatrix<f64>,
    M: &DMatrix<f64>,
    count: usize,
) -> Result<Eigen, StructureError> {
    check_pair(K, M)?;
    error::count("number of modes", count, 0, K.nrows())?;
    if K.is_empty() {
        return generalized_eigen(K, M);
    }
    mass_factor(M)?;
    let mut factor = well_conditioned_factor(K);
    let mut shift = 0.0;
    if factor.is_none() {
        shift = lowest_elastic_value(K, M)?;
        factor = well_conditioned_factor(&(K + M * shift));
    }
    let factor = factor.ok_or_else(|| StructureError::Matrix {
        matrix: "stiffness matrix K".to_owned(),
        property: "positive semidefinite",
        remedy: "a stiffness cannot be negative",
    })?;
    let inverse = reduced_eigen(&factor, M, "K⁻¹ M")?;
    let n = K.nrows();
    let mut values = DVector::zeros(count);
    let mut lowest = DMatrix::zeros(n, count);
    for k in 0..count {
        let nu = inverse.values[n - 1 - k]; // 1/(λ + σ), which is also xᵀ M x
        if nu <= 0.0 {
            return Err(StructureError::NoConvergence {
                matrix: "K⁻¹ M".to_owned(),
            });
        }
        let value = 1.0 / nu - shift;
        values[k] = if value < 1e-9 * shift { 0.0 } else { value };
        lowest.set_column(k, &(inverse.vectors.column(n - 1 - k) / nu.sqrt()));
    }
    Ok(Eigen {
        values,
        vectors: lowest,
    })
}

/// The smallest eigenvalue that is not one of a rigid-body mode.
fn lowest_elastic_value(K: &DMatrix<f64>, M: &DMatrix<f64>) -> Result<f64, StructureError> {
    let values = generalized_eigen(K, M)?.values;
    let largest = values.amax();
    let elastic = values.iter().copied().filter(|v| *v > 1e-11 * largest);
    let lowest = elastic.fold(f64::INFINITY, f64::min);
    Ok(if lowest.is_finite() { lowest } else { 1.0 })
}

/// The Cholesky factor, unless a pivot is all but zero: a singular matrix may pass by rounding. The last pivot of a
/// cantilever with n equal elements is 1/(4 n³) of its diagonal entry.
fn well_conditioned_factor(matrix: &DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let factor = Cholesky::new(matrix.clone())?;
    let L = factor.l_dirty();
    let regular = (0..matrix.nrows()).all(|i| L[(i, i)].powi(2) > 1e-12 * matrix[(i, i)]);
    regular.then_some(factor)
}

fn mass_factor(M: &DMatrix<f64>) -> Result<Cholesky<f64, Dyn>, StructureError> {
    let remedy = "each degree of freedom needs mass; condense those without (Guyan)";
    cholesky(M.clone(), "mass matrix M", remedy)
}

/// The Cholesky factor of a matrix that has to be positive definite (or empty).
pub(crate) fn cholesky(
    matrix: DMatrix<f64>,
    name: impl Display,
    remedy: &'static str,
) -> Result<Cholesky<f64, Dyn>, StructureError> {
    Cholesky::new(matrix).ok_or_else(|| StructureError::Matrix {
        matrix: name.to_string(),
        property: "positive definite",
        remedy,
    })
}

/// Eigenvalues of `A x = λ L Lᵀ x` for symmetric `A`, in ascending order, and eigenvectors with `Xᵀ L Lᵀ X = I`.
pub(crate) fn reduced_eigen(
    factor: &Cholesky<f64, Dyn>,
    A: &DMatrix<f64>,
    name: &str,
) -> Result<Eigen, StructureError> {
    let L = factor.l();
    let solve = |right: &DMatrix<f64>| {
        L.solve_lower_triangular(right)
            .expect("a Cholesky factor is regular")
    };
    let eigen = symmetric_eigen(&solve(&solve(A).transpose()), name)?;
    let vectors = L
        .tr_solve_lower_triangular(&eigen.vectors)
        .expect("a Cholesky factor is regular");
    Ok(Eigen { vectors, ..eigen })
}

/// Eigenvalues in ascending order, and orthonormal eigenvectors.
pub(crate) fn symmetric_eigen(matrix: &DMatrix<f64>, name: &str) -> Result<Eigen, StructureError> {
    let n = matrix.nrows();
    if n == 0 {
        // nalgebra panics on empty matrices.
        return Ok(Eigen {
            values: DVector::zeros(0),
            vectors: DMatrix::zeros(0, 0),
        });
    }
    let limit = ITERATIONS_PER_ROW * (n + 10);
    let eigen =
        SymmetricEigen::try_new(matrix.symmetric_part(), f64::EPSILON, limit).ok_or_else(|| {
            StructureError::NoConvergence {
                matrix: name.to_owned(),
            }
        })?;
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    Ok(Eigen {
        values: DVector::from_iterator(n, order.iter().map(|i| eigen.eigenvalues[*i])),
        vectors: eigen.eigenvectors.select_columns(&order),
    })
}

fn check_pair(K: &DMatrix<f64>, M: &DMatrix<f64>) -> Result<(), StructureError> {
    check_symmetric("stiffness matrix K", K)?;
    check_symmetric("mass matrix M", M)?;
    error::size("stiffness matrix K", K.shape(), M.shape())
}

/// Rejects a matrix that is not square, finite and symmetric to 1e-9 of its largest entry.
pub(crate) fn check_symmetric(
    name: impl Display,
    matrix: &DMatrix<f64>,
) -> Result<(), StructureError> {
    let n = matrix.nrows();
    error::size(&name, matrix.shape(), (n, n))?;
    error::finite_entries(&name, matrix)?;
    let largest = matrix.amax();
    for row in 0..n {
        for column in 0..row {
            let difference = (matrix[(row, column)] - matrix[(column, row)]).abs();
            if difference > 1e-9 * largest {
                return Err(StructureError::Asymmetric {
                    matrix: name.to_string(),
                    row,
                    column,
                    difference,
                });
            }
        }
    }
    Ok(())
}
