//! Roots of `det[A s² + B s + C] = 0`, which are the poles and transmission zeros of structures.

use nalgebra::{Cholesky, Complex, DMatrix, Schur};

use crate::{StructureError, eigen::reduced_eigen, error};

/// Roots that are larger than this times the geometric mean scale of the polynomial count as infinite. A singular leading
/// coefficient has pairs of them, which rounding makes about 1e8.
const INFINITE: f64 = 1e6;

/// All finite roots of `det[A s² + B s + C] = 0`, sorted by magnitude and then by imaginary part: twice the size of the
/// matrices if `A` is regular, fewer if not.
///
/// `C` must be regular (no root at zero). The roots are the reciprocals of the eigenvalues of the companion matrix of the reversed polynomial,
/// which keeps the relative accuracy of the small ones. Without damping (`B = 0`) and with symmetric matrices, the problem is a
/// symmetric one of the matrices' size, and the roots lie on the axes exactly.
///
/// # Errors
/// Matrices of different sizes, singular `C`, or an iteration that reaches its limit.
pub fn quadratic_roots(
    A: &DMatrix<f64>,
    B: &DMatrix<f64>,
    C: &DMatrix<f64>,
) -> Result<Vec<Complex<f64>>, StructureError> {
    let n = A.nrows();
    for (name, matrix) in [
        ("coefficient of s²", A),
        ("coefficient of s", B),
        ("constant coefficient", C),
    ] {
        error::size(name, matrix.shape(), (n, n))?;
        error::finite_entries(name, matrix)?;
    }
    if n == 0 {
        return Ok(Vec::new());
    }
    check_regular(C)?;
    let scale = (C.norm() / A.norm().max(f64::MIN_POSITIVE)).sqrt();
    let roots = if B.norm() == 0.0 {
        undamped(A, C)?
    } else {
        damped(A, B, C, scale)?
    };
    let mut finite: Vec<_> = roots
        .into_iter()
        .filter(|s| s.norm() < INFINITE * scale)
        .collect();
    finite.sort_by(|a, b| a.norm().total_cmp(&b.norm()).then(a.im.total_cmp(&b.im)));
    Ok(finite)
}

/// `s² = -1/ν` with ν the eigenvalues of `C⁻¹ A`.
fn undamped(A: &DMatrix<f64>, C: &DMatrix<f64>) -> Result<Vec<Complex<f64>>, StructureError> {
    let symmetric = |m: &DMatrix<f64>| (m - m.transpose()).amax() <= 1e-14 * m.amax();
    let factor = if symmetric(A) && symmetric(C) {
        Cholesky::new(C.clone())
    } else {
        None
    };
    let reciprocals: Vec<Complex<f64>> = if let Some(factor) = factor {
        let values = reduced_eigen(&factor, A, "C⁻¹ A")?.values;
        values.iter().map(|v| Complex::new(*v, 0.0)).collect()
    } else {
        eigenvalues(solve(C, A).ok_or_else(singular)?, "C⁻¹ A")?
    };
    let nonzero = reciprocals.into_iter().filter(|v| v.norm() > 0.0);
    Ok(nonzero
        .flat_map(|v| {
            let s = (-1.0 / v).sqrt();
            [s, -s]
        })
        .collect())
}

fn damped(
    A: &DMatrix<f64>,
    B: &DMatrix<f64>,
    C: &DMatrix<f64>,
    scale: f64,
) -> Result<Vec<Complex<f64>>, StructureError> {
    // With s = scale / t: C t² + scale B t + scale² A.
    let n = A.nrows();
    let mut companion = DMatrix::zeros(2 * n, 2 * n);
    companion.view_mut((0, n), (n, n)).fill_with_identity();
    let mut right = DMatrix::zeros(n, 2 * n);
    right.columns_mut(0, n).copy_from(&(A * (-scale * scale)));
    right.columns_mut(n, n).copy_from(&(B * -scale));
    let solution = solve(C, &right).ok_or_else(singular)?;
    companion.rows_mut(n, n).copy_from(&solution);
    let reciprocals = eigenvalues(companion, "the companion matrix")?;
    let nonzero = reciprocals.into_iter().filter(|t| t.norm() > 0.0);
    Ok(nonzero.map(|t| Complex::new(scale, 0.0) / t).collect())
}

/// Rejects a matrix that is singular up to rounding, after scaling its diagonal to 1.
fn check_regular(C: &DMatrix<f64>) -> Result<(), StructureError> {
    let scales = C
        .diagonal()
        .map(|c| if c == 0.0 { 1.0 } else { c.abs().sqrt() });
    let scaled = C.map_with_location(|i, j, c| c / (scales[i] * scales[j]));
    let norm = scaled.norm();
    match scaled.try_inverse() {
        Some(inverse) if inverse.norm() * norm < 1e13 => Ok(()),
        _ => Err(singular()),
    }
}

/// `A⁻¹ B`, unless `A` is singular.
pub(crate) fn solve(A: &DMatrix<f64>, B: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let solution = A.clone().lu().solve(B)?;
    solution.iter().all(|v| v.is_finite()).then_some(solution)
}

fn singular() -> StructureError {
    StructureError::Matrix {
        matrix: "constant coefficient C of the polynomial A s² + B s + C".to_owned(),
        property: "regular",
        remedy: "remove rigid-body motion, whose roots are zero, before asking for the others",
    }
}

/// Eigenvalues of a general real matrix.
///
/// # Errors
/// If the iteration reaches its limit, also from a rotated start.
pub(crate) fn eigenvalues(
    matrix: DMatrix<f64>,
    name: &str,
) -> Result<Vec<Complex<f64>>, StructureError> {
    let n = matrix.nrows();
    if n == 0 {
        return Ok(Vec::new());
    }
    let limit = 100 * (n + 10);
    let matrix = balanced(matrix);
    if matrix.iter().any(|v| !v.is_finite()) {
        return Err(StructureError::NoConvergence {
            matrix: name.to_owned(),
        });
    }
    if let Some(schur) = Schur::try_new(matrix.clone(), f64::EPSILON, limit) {
        return Ok(schur.complex_eigenvalues().iter().copied().collect());
    }
    // A reflection changes the course of an iteration that goes in circles, and no eigenvalue.
    let v = DMatrix::from_fn(n, 1, |i, _| 1.0 + ((i * i) % 7) as f64 / 3.0).normalize();
    let reflection = DMatrix::identity(n, n) - &v * v.transpose() * 2.0;
    let rotated = &reflection * matrix * &reflection;
    let schur = Schur::try_new(rotated, 4.0 * f64::EPSILON, limit).ok_or_else(|| {
        StructureError::NoConvergence {
            matrix: name.to_owned(),
        }
    })?;
    Ok(schur.complex_eigenvalues().iter().copied().collect())
}

/// The matrix with rows and columns scaled by powers of two until they have similar norms (Parlett and Reinsch 1969), which
/// changes no eigenvalue. Without it, small eigenvalues lose the digits that the largest entry has in front of them.
fn balanced(mut matrix: DMatrix<f64>) -> DMatrix<f64> {
    let n = matrix.nrows();
    for _sweep in 0..30 {
        let mut changed = false;
        for i in 0..n {
            let off = matrix[(i, i)].abs();
            let column = matrix.column(i).lp_norm(1) - off;
            let row = matrix.row(i).lp_norm(1) - off;
            if !(column > 0.0 && row > 0.0 && column.is_finite() && row.is_finite()) {
                continue;
            }
            let factor = 2.0_f64.powi(((row / column).log2() / 2.0).round() as i32);
            if factor != 1.0 && column * factor + row / factor < 0.95 * (column + row) {
                matrix.column_mut(i).scale_mut(factor);
                matrix.row_mut(i).scale_mut(1.0 / factor);
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    matrix
}

/// Frequencies in Hz, `|s| / 2π`, of the roots with positive imaginary part, in ascending order.
pub fn frequencies_hz(roots: &[Complex<f64>]) -> Vec<f64> {
    let upper = roots.iter().filter(|s| s.im > 1e-12 * s.norm());
    let mut frequencies: Vec<_> = upper.map(|s| s.norm() / std::f64::consts::TAU).collect();
    frequencies.sort_by(f64::total_cmp);
    frequencies
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    fn diagonal(entries: &[f64]) -> DMatrix<f64> {
        DMatrix::from_diagonal(&DVector::from_column_slice(entries))
    }

    // A singular leading coefficient has fewer roots; rounding would make the others about 1e8.
    #[test]
    fn roots_at_infinity_are_left_out() {
        let (A, C) = (diagonal(&[1.0, 0.0]), diagonal(&[1.0, 4.0]));
        let roots = quadratic_roots(&A, &diagonal(&[0.0, 0.0]), &C).unwrap();
        assert_eq!(roots.len(), 2);
        assert!(roots.iter().all(|s| (s.norm() - 1.0).abs() < 1e-14));
        // The second equation is 0.2 s + 4 = 0.
        let roots = quadratic_roots(&A, &diagonal(&[0.1, 0.2]), &C).unwrap();
        assert_eq!(roots.len(), 3, "{roots:?}");
        assert!((roots[2] + 20.0).norm() < 1e-9, "{roots:?}");
    }

    // s² + 2 ζ ω s + ω² over six decades: the small roots keep their digits.
    #[test]
    fn roots_of_very_different_size_keep_their_digits() {
        let w = [1e-3, 1.0, 1e3];
        let B = diagonal(&w.map(|w| 0.02 * w));
        let roots = quadratic_roots(&DMatrix::identity(3, 3), &B, &diagonal(&w.map(|w| w * w)));
        let roots = roots.unwrap();
        for (pair, w) in roots.chunks(2).zip(w) {
            let exact = Complex::new(-0.01, (1.0_f64 - 1e-4).sqrt()) * w;
            let upper = if pair[0].im > 0.0 { pair[0] } else { pair[1] };
            assert!((upper - exact).norm() < 1e-12 * w, "{pair:?} {exact}");
        }
        assert!(quadratic_roots(&diagonal(&[1.0]), &diagonal(&[1.0]), &diagonal(&[0.0])).is_err());
        assert!(
            quadratic_roots(&diagonal(&[1.0]), &diagonal(&[1.0]), &diagonal(&[f64::NAN])).is_err()
        );
    }
}
