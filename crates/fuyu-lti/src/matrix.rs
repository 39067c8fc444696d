//! Checks of matrices, and small helpers on them.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

use crate::LtiError;

/// A complex number.
pub type Complex = nalgebra::Complex<f64>;
/// A dense real matrix.
pub type Matrix = DMatrix<f64>;
/// A dense complex matrix.
pub type ComplexMatrix = DMatrix<Complex>;

pub(crate) fn finite(what: &str, m: &Matrix) -> Result<(), LtiError> {
    for (row, r) in m.row_iter().enumerate() {
        for (col, &value) in r.iter().enumerate() {
            if !value.is_finite() {
                return Err(LtiError::NotFinite {
                    what: what.into(),
                    value,
                    row,
                    col,
                });
            }
        }
    }
    Ok(())
}

pub(crate) fn shaped(what: &str, m: &Matrix, rows: usize, cols: usize) -> Result<(), LtiError> {
    if m.shape() != (rows, cols) {
        return Err(LtiError::Shape {
            what: what.into(),
            rows: m.nrows(),
            cols: m.ncols(),
            expected: format!("{rows} x {cols}"),
        });
    }
    finite(what, m)
}

pub(crate) fn square(what: &str, m: &Matrix) -> Result<usize, LtiError> {
    if !m.is_square() {
        return Err(LtiError::Shape {
            what: what.into(),
            rows: m.nrows(),
            cols: m.ncols(),
            expected: "square".into(),
        });
    }
    finite(what, m)?;
    Ok(m.nrows())
}

pub(crate) fn positive(what: &str, value: f64) -> Result<(), LtiError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(LtiError::Range {
            what: what.into(),
            value,
            expected: "positive and finite",
        })
    }
}

/// The symmetric part, after a check that there is next to nothing else.
pub(crate) fn symmetric(what: &str, m: &Matrix, n: usize) -> Result<Matrix, LtiError> {
    shaped(what, m, n, n)?;
    let difference = (m - m.transpose()).amax();
    if difference > 1e-10 * m.amax() {
        return Err(LtiError::NotSymmetric {
            what: what.into(),
            difference,
        });
    }
    Ok(symmetric_part(m))
}

pub(crate) fn symmetric_part(m: &Matrix) -> Matrix {
    (m + m.transpose()) * 0.5
}

/// Eigenvalues, in no order, and orthonormal eigenvectors of a symmetric matrix.
pub(crate) fn symmetric_eigen(m: &Matrix) -> Result<SymmetricEigen<f64, Dyn>, LtiError> {
    let n = m.nrows();
    if n == 0 {
        return Ok(SymmetricEigen {
            eigenvalues: DVector::zeros(0),
            eigenvectors: Matrix::zeros(0, 0),
        });
    }
    let limit = 1000 * n;
    m.clone()
        .try_symmetric_eigen(f64::EPSILON, limit)
        .ok_or(LtiError::NotConverged {
            what: "the symmetric eigenvalue iteration",
            iterations: limit,
        })
}

/// Eigenvalues of a symmetric matrix in ascending order, and the eigenvectors as columns.
pub(crate) fn ascending_eigen(m: &Matrix) -> Result<(Vec<f64>, Matrix), LtiError> {
    let eigen = symmetric_eigen(m)?;
    let mut order: Vec<usize> = (0..m.nrows()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    Ok((
        order.iter().map(|&i| eigen.eigenvalues[i]).collect(),
        eigen.eigenvectors.select_columns(&order),
    ))
}

/// Squares of the frequencies in ascending order and mass-normalised shapes, as columns, of the modes of `M w'' + K w = 0`; `what` is the name of M.
pub(crate) fn normal_modes(
    what: &str,
    mass: &Matrix,
    stiffness: &Matrix,
) -> Result<(Vec<f64>, Matrix), LtiError> {
    let factor = positive_definite(what, mass)?.l();
    let inverse = solve(what, &factor, &identity(mass.nrows()))?;
    let reduced = symmetric_part(&(&inverse * stiffness * inverse.transpose()));
    let (squares, vectors) = ascending_eigen(&reduced)?;
    Ok((squares, inverse.transpose() * vectors))
}

/// Infinite for an empty matrix.
pub(crate) fn smallest_eigenvalue(m: &Matrix) -> Result<f64, LtiError> {
    let values = symmetric_eigen(m)?.eigenvalues;
    Ok(if values.is_empty() {
        f64::INFINITY
    } else {
        values.min()
    })
}

pub(crate) fn positive_definite(what: &str, m: &Matrix) -> Result<Cholesky<f64, Dyn>, LtiError> {
    let smallest = smallest_eigenvalue(m)?;
    let refused = LtiError::NotPositiveDefinite {
        what: what.into(),
        smallest,
    };
    if smallest <= 1e-14 * m.amax() {
        return Err(refused);
    }
    Cholesky::new(m.clone()).ok_or(refused)
}

pub(crate) fn semidefinite(what: &str, m: &Matrix) -> Result<(), LtiError> {
    let smallest = smallest_eigenvalue(m)?;
    if smallest < -1e-10 * m.amax() {
        return Err(LtiError::NotSemidefinite {
            what: what.into(),
            smallest,
        });
    }
    Ok(())
}

/// `a x = b` by LU with partial pivoting.
pub(crate) fn solve(what: &str, a: &Matrix, b: &Matrix) -> Result<Matrix, LtiError> {
    let singular = || LtiError::Singular { what: what.into() };
    let x = a.clone().lu().solve(b).ok_or_else(singular)?;
    if x.iter().all(|v| v.is_finite()) {
        Ok(x)
    } else {
        Err(singular())
    }
}

pub(crate) fn identity(n: usize) -> Matrix {
    Matrix::identity(n, n)
}

/// A matrix of blocks: those in a row have the same height, and all rows the same width.
pub(crate) fn blocks(rows: &[&[&Matrix]]) -> Matrix {
    let height = rows.iter().map(|r| r[0].nrows()).sum();
    let width = rows[0].iter().map(|m| m.ncols()).sum();
    let mut out = Matrix::zeros(height, width);
    let mut i = 0;
    for row in rows {
        let mut j = 0;
        for m in *row {
            out.view_mut((i, j), m.shape()).copy_from(m);
            j += m.ncols();
        }
        i += row[0].nrows();
    }
    out
}

/// `[A - s I, B; C, D]` from `[A, B; C, D]`, where A is n x n.
pub(crate) fn shifted(system: &ComplexMatrix, n: usize, s: Complex) -> ComplexMatrix {
    let mut out = system.clone();
    for i in 0..n {
        out[(i, i)] -= s;
    }
    out
}

/// Singular values in descending order.
pub(crate) fn singular_values(m: &ComplexMatrix) -> Result<Vec<f64>, LtiError> {
    if m.is_empty() {
        return Ok(Vec::new());
    }
    let limit = 1000 * m.nrows().max(m.ncols());
    let svd = nalgebra::SVD::try_new(m.clone(), false, false, f64::EPSILON, limit).ok_or(
        LtiError::NotConverged {
            what: "the singular value iteration",
            iterations: limit,
        },
    )?;
    let mut values: Vec<f64> = svd.singular_values.iter().copied().collect();
    values.sort_by(|a, b| b.total_cmp(a));
    Ok(values)
}

pub(crate) fn complex(m: &Matrix) -> ComplexMatrix {
    m.map(|v| Complex::new(v, 0.0))
}

/// Full singular value decomposition `m = U diag(s) V'` with square U and V, s in descending order.
pub(crate) fn full_svd(m: &Matrix) -> Result<(Matrix, Vec<f64>, Matrix), LtiError> {
    let (rows, cols) = m.shape();
    let n = rows.max(cols);
    if n == 0 {
        return Ok((Matrix::zeros(0, 0), Vec::new(), Matrix::zeros(0, 0)));
    }
    // Complete U and V from the symmetric eigenproblems of the padded matrix: a square SVD, in which the padding contributes null vectors.
    let mut padded = Matrix::zeros(n, n);
    padded.view_mut((0, 0), (rows, cols)).copy_from(m);
    let limit = 1000 * n;
    let svd = nalgebra::SVD::try_new(padded, true, true, f64::EPSILON, limit).ok_or(
        LtiError::NotConverged {
            what: "the singular value iteration",
            iterations: limit,
        },
    )?;
    let (u, v_t) = (svd.u.expect("asked for"), svd.v_t.expect("asked for"));
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
    let k = rows.min(cols);
    let values: Vec<f64> = order
        .iter()
        .take(k)
        .map(|&i| svd.singular_values[i])
        .collect();
    let scale = values.first().copied().unwrap_or(0.0);
    let left: Vec<_> = order
        .iter()
        .take(k)
        .filter(|&&i| svd.singular_values[i] > 1e-13 * scale)
        .map(|&i| u.column(i).rows(0, rows).into_owned())
        .collect();
    let right: Vec<_> = order
        .iter()
        .take(k)
        .filter(|&&i| svd.singular_values[i] > 1e-13 * scale)
        .map(|&i| v_t.row(i).columns(0, cols).transpose())
        .collect();
    Ok((
        completed_basis(&left, rows),
        values,
        completed_basis(&right, cols),
    ))
}

/// An orthogonal matrix whose first columns are the given orthonormal ones.
fn completed_basis(columns: &[DVector<f64>], n: usize) -> Matrix {
    let mut basis: Vec<DVector<f64>> = columns.to_vec();
    let mut candidates: Vec<usize> = (0..n).collect();
    while basis.len() < n {
        // The unit vector with the largest part outside of the span, orthogonalised twice.
        let outside = |&i: &usize| 1.0 - basis.iter().map(|b| b[i] * b[i]).sum::<f64>();
        candidates.sort_by(|a, b| outside(b).total_cmp(&outside(a)));
        let mut v = DVector::zeros(n);
        v[candidates.remove(0)] = 1.0;
        for _ in 0..2 {
            for b in &basis {
                let dot = b.dot(&v);
                v.axpy(-dot, b, 1.0);
            }
        }
        v.normalize_mut();
        basis.push(v);
    }
    if n == 0 {
        Matrix::zeros(0, 0)
    } else {
        Matrix::from_columns(&basis)
    }
}
