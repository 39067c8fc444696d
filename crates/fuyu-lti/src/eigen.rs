//! Eigenvalues of general real matrices, with bounded iterations.
//!
//! The real Schur form of nalgebra is tried first, on a balanced matrix and with a limit of iterations. Should it reach that limit, which
//! happens for some matrices with eigenvalues of equal modulus, the complex Schur form of this module, which has exceptional shifts, takes over.

use nalgebra::Schur;

use crate::LtiError;
use crate::matrix::{Complex, ComplexMatrix, Matrix, complex, square};

/// Eigenvalues of a real matrix: complex ones in conjugate pairs, the one with positive imaginary part first.
///
/// ```
/// use fuyu_lti::{Matrix, eigenvalues};
/// let a = Matrix::from_row_slice(2, 2, &[0.0, 1.0, -4.0, 0.0]);
/// assert!((eigenvalues(&a).unwrap()[0].im - 2.0).abs() < 1e-15);
/// ```
pub fn eigenvalues(a: &Matrix) -> Result<Vec<Complex>, LtiError> {
    let n = square("the matrix", a)?;
    if n == 0 {
        return Ok(Vec::new());
    }
    let balanced = balanced(a);
    match Schur::try_new(balanced.clone(), f64::EPSILON, 60 * n.max(10)) {
        Some(schur) => Ok(of_quasi_triangular(&schur.unpack().1)),
        None => Ok(paired(
            complex_schur(complex(&balanced))?
                .triangular
                .diagonal()
                .iter()
                .copied()
                .collect(),
        )),
    }
}

/// How far an eigenvalue is beyond the stability limit: positive or zero if its mode does not decay.
pub(crate) fn beyond_limit(l: Complex, discrete: bool) -> f64 {
    if discrete { l.norm() - 1.0 } else { l.re }
}

/// Largest real part of the eigenvalues; `-inf` for an empty matrix. Negative: the continuous system is asymptotically stable.
pub fn spectral_abscissa(a: &Matrix) -> Result<f64, LtiError> {
    Ok(eigenvalues(a)?
        .iter()
        .fold(f64::NEG_INFINITY, |m, l| m.max(l.re)))
}

/// Largest modulus of the eigenvalues; 0 for an empty matrix. Below 1: the discrete system is asymptotically stable.
pub fn spectral_radius(a: &Matrix) -> Result<f64, LtiError> {
    Ok(eigenvalues(a)?
        .iter()
        .fold(0.0, |m: f64, l| m.max(l.norm())))
}

/// Balancing by powers of two (Parlett & Reinsch 1969, norms of James, Langou & Lowery 2014): a diagonal similarity, so eigenvalues stay.
pub(crate) fn balanced(a: &Matrix) -> Matrix {
    let mut m = a.clone();
    balance(&mut m);
    m
}

/// Balances in place; returns the scale `d` of each coordinate: `m = D^-1 a D`.
pub(crate) fn balance(m: &mut Matrix) -> Vec<f64> {
    let n = m.nrows();
    let mut scales = vec![1.0; n];
    for _ in 0..100 {
        let mut changed = false;
        for i in 0..n {
            let mut column = (m.column(i).norm_squared() - m[(i, i)] * m[(i, i)])
                .max(0.0)
                .sqrt();
            let mut row = (m.row(i).norm_squared() - m[(i, i)] * m[(i, i)])
                .max(0.0)
                .sqrt();
            if column == 0.0 || row == 0.0 {
                continue;
            }
            let before = column + row;
            let mut f = 1.0_f64;
            while column < row / 2.0 && f < 1e100 {
                column *= 2.0;
                row /= 2.0;
                f *= 2.0;
            }
            while column >= row * 2.0 && f > 1e-100 {
                column /= 2.0;
                row *= 2.0;
                f /= 2.0;
            }
            if column + row < 0.95 * before {
                changed = true;
                scales[i] *= f;
                m.column_mut(i).scale_mut(f);
                m.row_mut(i).scale_mut(1.0 / f);
            }
        }
        if !changed {
            break;
        }
    }
    scales
}

/// Eigenvalues of the diagonal blocks of a real Schur form.
fn of_quasi_triangular(t: &Matrix) -> Vec<Complex> {
    let n = t.nrows();
    let mut out = Vec::with_capacity(n);
    let mut i = 0;
    while i < n {
        if i + 1 == n || t[(i + 1, i)] == 0.0 {
            out.push(Complex::new(t[(i, i)], 0.0));
            i += 1;
            continue;
        }
        let (a, b, c, d) = (t[(i, i)], t[(i, i + 1)], t[(i + 1, i)], t[(i + 1, i + 1)]);
        let half = 0.5 * (a - d);
        let discriminant = half * half + b * c;
        let mean = 0.5 * (a + d);
        if discriminant < 0.0 {
            let im = (-discriminant).sqrt();
            out.push(Complex::new(mean, im));
            out.push(Complex::new(mean, -im));
        } else {
            // The larger root without cancellation, the other from the product of the roots.
            let larger = if mean >= 0.0 {
                mean + discriminant.sqrt()
            } else {
                mean - discriminant.sqrt()
            };
            let other = if larger == 0.0 {
                0.0
            } else {
                (a * d - b * c) / larger
            };
            out.push(Complex::new(larger, 0.0));
            out.push(Complex::new(other, 0.0));
        }
        i += 2;
    }
    out
}

/// Restores the conjugate pairs that rounding of a complex iteration has separated.
fn paired(mut values: Vec<Complex>) -> Vec<Complex> {
    let scale = values.iter().fold(0.0, |m: f64, v| m.max(v.norm()));
    let mut out = Vec::with_capacity(values.len());
    while let Some(first) = values.pop() {
        let partner = values
            .iter()
            .enumerate()
            .map(|(i, v)| (i, (*v - first.conj()).norm()))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|&(_, distance)| {
                distance < 2.0 * first.im.abs() && first.im.abs() > 1e-14 * scale
            });
        match partner {
            Some((i, _)) => {
                let other = values.swap_remove(i);
                let mean = (first + other.conj()) * 0.5;
                let mean = if mean.im < 0.0 { mean.conj() } else { mean };
                out.extend([mean, mean.conj()]);
            }
            None => out.push(Complex::new(first.re, 0.0)),
        }
    }
    out
}

/// `unitary * triangular * unitary'`.
pub(crate) struct ComplexSchur {
    pub unitary: ComplexMatrix,
    pub triangular: ComplexMatrix,
}

/// Complex Schur form by the single-shift QR iteration with Wilkinson's shift and, every tenth step, an exceptional one
/// (Golub & Van Loan, Matrix Computations, section 7.5).
pub(crate) fn complex_schur(a: ComplexMatrix) -> Result<ComplexSchur, LtiError> {
    let n = a.nrows();
    if n < 2 {
        return Ok(ComplexSchur {
            unitary: ComplexMatrix::identity(n, n),
            triangular: a,
        });
    }
    let scale = a.iter().fold(0.0, |m: f64, v| m.max(v.norm()));
    let (mut u, mut t) = nalgebra::Hessenberg::new(a).unpack();
    let limit = 100 * n;
    let mut hi = n - 1;
    let mut since_deflation = 0;
    for _ in 0..limit {
        let mut lo = hi;
        while lo > 0 {
            let size = t[(lo - 1, lo - 1)].norm() + t[(lo, lo)].norm();
            if t[(lo, lo - 1)].norm() <= f64::EPSILON * size.max(f64::EPSILON * scale) {
                t[(lo, lo - 1)] = Complex::new(0.0, 0.0);
                break;
            }
            lo -= 1;
        }
        if lo == hi {
            hi -= 1;
            since_deflation = 0;
            if hi == 0 {
                return Ok(ComplexSchur {
                    unitary: u,
                    triangular: t,
                });
            }
            continue;
        }
        since_deflation += 1;
        let shift = if since_deflation % 10 == 0 {
            t[(hi, hi)] + Complex::new(0.75 * t[(hi, hi - 1)].norm(), 0.0)
        } else {
            wilkinson_shift(&t, hi)
        };
        qr_step(&mut t, &mut u, lo, hi, shift);
    }
    Err(LtiError::NotConverged {
        what: "the QR iteration for eigenvalues",
        iterations: limit,
    })
}

fn wilkinson_shift(t: &ComplexMatrix, hi: usize) -> Complex {
    let (a, b, c, d) = (
        t[(hi - 1, hi - 1)],
        t[(hi - 1, hi)],
        t[(hi, hi - 1)],
        t[(hi, hi)],
    );
    let half = (a - d) * 0.5;
    let root = (half * half + b * c).sqrt();
    let sum = if (half.conj() * root).re >= 0.0 {
        half + root
    } else {
        half - root
    };
    if sum.norm() == 0.0 {
        d
    } else {
        d - b * c / sum
    }
}

fn qr_step(t: &mut ComplexMatrix, u: &mut ComplexMatrix, lo: usize, hi: usize, shift: Complex) {
    let n = t.nrows();
    for k in lo..=hi {
        t[(k, k)] -= shift;
    }
    let mut rotations = Vec::with_capacity(hi - lo);
    for k in lo..hi {
        let (x, y) = (t[(k, k)], t[(k + 1, k)]);
        let r = x.norm().hypot(y.norm());
        let (c, s) = if r == 0.0 {
            (Complex::new(1.0, 0.0), Complex::new(0.0, 0.0))
        } else {
            (x / r, y / r)
        };
        for j in k..n {
            let (p, q) = (t[(k, j)], t[(k + 1, j)]);
            t[(k, j)] = c.conj() * p + s.conj() * q;
            t[(k + 1, j)] = c * q - s * p;
        }
        rotations.push((c, s));
    }
    for (k, (c, s)) in (lo..hi).zip(rotations) {
        for i in 0..=(k + 1) {
            let (p, q) = (t[(i, k)], t[(i, k + 1)]);
            t[(i, k)] = p * c + q * s;
            t[(i, k + 1)] = q * c.conj() - p * s.conj();
        }
        for i in 0..n {
            let (p, q) = (u[(i, k)], u[(i, k + 1)]);
            u[(i, k)] = p * c + q * s;
            u[(i, k + 1)] = q * c.conj() - p * s.conj();
        }
    }
    for k in lo..=hi {
        t[(k, k)] += shift;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // A wrong rotation would leave the product different from the matrix.
    #[test]
    fn the_complex_schur_form_multiplies_back_to_the_matrix() {
        let n = 12;
        let a = Matrix::from_fn(n, n, |i, j| {
            ((7 * i + 3 * j) as f64).sin() + if i == j { i as f64 } else { 0.0 }
        });
        let s = complex_schur(complex(&a)).unwrap();
        let back = &s.unitary * &s.triangular * s.unitary.adjoint();
        assert!((back - complex(&a)).camax() < 1e-12);
        assert!((s.unitary.adjoint() * &s.unitary - ComplexMatrix::identity(n, n)).camax() < 1e-13);
        assert!((1..n).all(|i| (0..i).all(|j| s.triangular[(i, j)].norm() < 1e-12)));
    }

    // The permutation matrix has all eigenvalues of modulus 1, at which unshifted iterations stand still.
    #[test]
    fn the_cyclic_permutation_has_the_roots_of_unity() {
        for n in [3, 4, 5, 8, 17] {
            let a = Matrix::from_fn(n, n, |i, j| if (i + 1) % n == j { 1.0 } else { 0.0 });
            for values in [
                eigenvalues(&a).unwrap(),
                paired(
                    complex_schur(complex(&a))
                        .unwrap()
                        .triangular
                        .diagonal()
                        .iter()
                        .copied()
                        .collect(),
                ),
            ] {
                for k in 0..n {
                    let root =
                        Complex::from_polar(1.0, std::f64::consts::TAU * k as f64 / n as f64);
                    assert!(
                        values.iter().any(|v| (v - root).norm() < 1e-12),
                        "{n}, {k}: {values:?}"
                    );
                }
            }
        }
    }
}
