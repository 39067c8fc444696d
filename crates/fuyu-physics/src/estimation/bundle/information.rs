//! Inverse of an information matrix whose unknowns have very different units.

use nalgebra::{SMatrix, SVector};

/// Regularisation of directions whose information vanishes in rounding, relative to the information of single unknowns.
const LEAST_INFORMATION: [f64; 4] = [0.0, 1e-14, 1e-12, 1e-10];

/// Inverse of an information matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inverse<const G: usize> {
    /// The inverse.
    pub covariance: SMatrix<f64, G, G>,
    /// Logarithm of the square root of its determinant.
    pub log_volume: f64,
}

impl<const G: usize> Inverse<G> {
    /// Inverse of `information`, which need not be exactly symmetric. Near the separatrix the information of the
    /// unknowns differs by many orders of magnitude: the matrix is scaled to a unit diagonal, and directions that
    /// vanish in rounding get the least regularisation for which the factorisation succeeds. `None` if none suffices.
    pub fn of(information: &SMatrix<f64, G, G>) -> Option<Self> {
        let scale = SVector::<f64, G>::from_fn(|k, _| {
            let own = information[(k, k)];
            own.max(f64::MIN_POSITIVE).sqrt().recip()
        });
        let scaled = SMatrix::<f64, G, G>::from_fn(|i, j| {
            0.5 * (information[(i, j)] + information[(j, i)]) * scale[i] * scale[j]
        });
        LEAST_INFORMATION.into_iter().find_map(|least| {
            let factor = (scaled + SMatrix::identity() * least).cholesky()?;
            let inverse = factor.inverse();
            let volume = |k: usize| scale[k].ln() - factor.l_dirty()[(k, k)].ln();
            Some(Self {
                covariance: SMatrix::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j]),
                log_volume: (0..G).map(volume).sum(),
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn units_do_not_matter() {
        let information = Matrix3::new(4.0, 1.0, 0.5, 1.0, 3.0, -0.2, 0.5, -0.2, 2.0);
        let exact = information.try_inverse().unwrap();
        let units = Matrix3::from_diagonal(&Vector3::new(1e9, 1e-7, 3.0));
        let found = Inverse::of(&(units * information * units)).unwrap();
        let back = units * found.covariance * units;
        assert!((back - exact).norm() < 1e-14);
        let volume = 0.5 * exact.determinant().ln() - units.determinant().ln();
        assert!((found.log_volume - volume).abs() < 1e-12);
    }

    #[test]
    fn a_direction_without_information_has_a_large_variance() {
        let v = Vector3::new(1.0, -2.0, 0.5);
        let information =
            Matrix3::from_diagonal_element(1.0) - v * v.transpose() / v.norm_squared();
        let found = Inverse::of(&information).unwrap();
        assert!(v.dot(&(found.covariance * v)) > 1e8);
        assert!(Inverse::of(&-Matrix3::identity()).is_none());
    }
}
