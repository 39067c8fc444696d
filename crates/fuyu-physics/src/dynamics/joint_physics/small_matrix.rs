//! Dense symmetric matrices of the size of a robot, in slices that the caller owns: column by column, `n` rows.

/// Replaces the lower triangle of `a` by its Cholesky factor `L`, `a = L Lᵀ`. Entries are NaN if `a` is not positive
/// definite.
pub(super) fn factorize(a: &mut [f64], n: usize) {
    for j in 0..n {
        for k in 0..j {
            let l = a[k * n + j];
            for i in j..n {
                a[j * n + i] -= a[k * n + i] * l;
            }
        }
        let pivot = a[j * n + j];
        let root = if pivot > 0.0 { pivot.sqrt() } else { f64::NAN };
        for i in j..n {
            a[j * n + i] /= root;
        }
    }
}

/// Solves `L x = b` in place.
pub(super) fn solve_lower(l: &[f64], n: usize, b: &mut [f64]) {
    for j in 0..n {
        b[j] /= l[j * n + j];
        let x = b[j];
        for i in j + 1..n {
            b[i] -= l[j * n + i] * x;
        }
    }
}

/// Solves `Lᵀ x = b` in place.
pub(super) fn solve_lower_transposed(l: &[f64], n: usize, b: &mut [f64]) {
    for j in (0..n).rev() {
        let mut x = b[j];
        for i in j + 1..n {
            x -= l[j * n + i] * b[i];
        }
        b[j] = x / l[j * n + j];
    }
}

/// Sweeps of Jacobi's method; convergence is quadratic, and six sweeps are usual.
const SWEEPS: usize = 30;

/// Eigenvalues and eigenvectors of a symmetric matrix by Jacobi's method of plane rotations: `a` becomes diagonal, the
/// columns of `vectors` are the eigenvectors. (G. H. Golub and C. F. Van Loan, Matrix Computations, section 8.5.)
pub(super) fn diagonalize(a: &mut [f64], n: usize, vectors: &mut [f64]) {
    vectors[..n * n].fill(0.0);
    (0..n).for_each(|i| vectors[i * n + i] = 1.0);
    for _ in 0..SWEEPS {
        let mut is_diagonal = true;
        for p in 0..n {
            for q in p + 1..n {
                let (app, aqq, apq) = (a[p * n + p], a[q * n + q], a[q * n + p]);
                if apq == 0.0 || apq.abs() <= f64::EPSILON * 0.1 * (app * aqq).abs().sqrt() {
                    continue;
                }
                is_diagonal = false;
                let tau = (aqq - app) / (2.0 * apq);
                let t = tau.signum() / (tau.abs() + tau.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for k in 0..n {
                    let (x, y) = (a[p * n + k], a[q * n + k]);
                    (a[p * n + k], a[q * n + k]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..n {
                    let (x, y) = (a[k * n + p], a[k * n + q]);
                    (a[k * n + p], a[k * n + q]) = (c * x - s * y, s * x + c * y);
                }
                (a[q * n + p], a[p * n + q]) = (0.0, 0.0);
                for k in 0..n {
                    let (x, y) = (vectors[p * n + k], vectors[q * n + k]);
                    (vectors[p * n + k], vectors[q * n + k]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
        if is_diagonal {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    fn matrix(n: usize) -> DMatrix<f64> {
        let root = DMatrix::from_fn(n, n, |i, j| (1.0 + (3 * i + 7 * j) as f64).sin());
        &root * root.transpose() + DMatrix::identity(n, n) * 0.1
    }

    // Against nalgebra's own solver.
    #[test]
    fn a_factor_solves() {
        let a = matrix(5);
        let b = DVector::from_fn(5, |i, _| (i as f64).cos());
        let mut l = a.as_slice().to_vec();
        factorize(&mut l, 5);
        let mut x = b.clone();
        solve_lower(&l, 5, x.as_mut_slice());
        solve_lower_transposed(&l, 5, x.as_mut_slice());
        assert!((a * x - b).amax() < 1e-13);
    }

    #[test]
    fn eigenvectors_diagonalize() {
        for n in [1, 2, 7, 20] {
            let a = matrix(n);
            let (mut d, mut v) = (a.as_slice().to_vec(), vec![0.0; n * n]);
            diagonalize(&mut d, n, &mut v);
            let v = DMatrix::from_column_slice(n, n, &v);
            let d = DMatrix::from_diagonal(&DMatrix::from_column_slice(n, n, &d).diagonal());
            assert!((&v * d * v.transpose() - &a).amax() < 1e-13 * a.amax() * n as f64);
            assert!((v.tr_mul(&v) - DMatrix::identity(n, n)).amax() < 1e-13);
        }
    }
}
