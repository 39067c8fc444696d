//! Symmetric 3 × 3 matrices, stored as six entries: half the operations of full ones in the recursions.

use nalgebra::{Matrix3, Vector3};
use std::ops::{Add, AddAssign, Mul};

/// A symmetric 3 × 3 matrix, such as a rotational inertia.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Symmetric3 {
    /// Diagonal `xx, yy, zz`.
    pub diagonal: Vector3<f64>,
    /// Entries off the diagonal `yz, xz, xy`: entry `k` lies in neither row nor column `k`.
    pub off_diagonal: Vector3<f64>,
}

impl Symmetric3 {
    /// All entries zero.
    pub const ZERO: Self = Self {
        diagonal: Vector3::new(0.0, 0.0, 0.0),
        off_diagonal: Vector3::new(0.0, 0.0, 0.0),
    };

    /// The full matrix.
    pub fn to_matrix(&self) -> Matrix3<f64> {
        let (d, o) = (&self.diagonal, &self.off_diagonal);
        Matrix3::new(d.x, o.z, o.y, o.z, d.y, o.x, o.y, o.x, d.z)
    }

    /// `R S Rᵀ`: the same tensor in axes A, where `R = R_AB` takes components in its axes B to components in A.
    #[inline]
    pub fn rotated(&self, R: &Matrix3<f64>) -> Self {
        let (x, y, z) = (
            Vector3::new(R.m11, R.m12, R.m13),
            Vector3::new(R.m21, R.m22, R.m23),
            Vector3::new(R.m31, R.m32, R.m33),
        );
        let (Sx, Sy, Sz) = (self * x, self * y, self * z);
        Self {
            diagonal: Vector3::new(x.dot(&Sx), y.dot(&Sy), z.dot(&Sz)),
            off_diagonal: Vector3::new(y.dot(&Sz), x.dot(&Sz), x.dot(&Sy)),
        }
    }

    /// `2 (p·g) 1 - p gᵀ - g pᵀ`: the change of a moment of inertia when its reference point moves
    /// ([`SpatialInertia::shifted`](super::SpatialInertia::shifted)).
    #[inline]
    pub fn shift(p: &Vector3<f64>, g: &Vector3<f64>) -> Self {
        let (x, y, z) = (2.0 * p.x * g.x, 2.0 * p.y * g.y, 2.0 * p.z * g.z);
        Self {
            diagonal: Vector3::new(y + z, x + z, x + y),
            off_diagonal: Vector3::new(
                -p.y * g.z - p.z * g.y,
                -p.x * g.z - p.z * g.x,
                -p.x * g.y - p.y * g.x,
            ),
        }
    }

    /// The inverse, by cofactors. A singular matrix gives entries that are not finite.
    #[inline]
    pub fn inverse(&self) -> Self {
        let (d, o) = (&self.diagonal, &self.off_diagonal);
        let diagonal = Vector3::new(
            d.y * d.z - o.x * o.x,
            d.x * d.z - o.y * o.y,
            d.x * d.y - o.z * o.z,
        );
        let off_diagonal = Vector3::new(
            o.y * o.z - o.x * d.x,
            o.x * o.z - o.y * d.y,
            o.x * o.y - o.z * d.z,
        );
        let determinant = d.x * diagonal.x + o.z * off_diagonal.z + o.y * off_diagonal.y;
        let scale = 1.0 / determinant;
        Self {
            diagonal: diagonal * scale,
            off_diagonal: off_diagonal * scale,
        }
    }
}

/// From a symmetric matrix, of which the upper triangle is read.
impl From<Matrix3<f64>> for Symmetric3 {
    fn from(m: Matrix3<f64>) -> Self {
        Self {
            diagonal: m.diagonal(),
            off_diagonal: Vector3::new(m[(1, 2)], m[(0, 2)], m[(0, 1)]),
        }
    }
}

impl Mul<Vector3<f64>> for &Symmetric3 {
    type Output = Vector3<f64>;
    #[inline]
    fn mul(self, v: Vector3<f64>) -> Vector3<f64> {
        let (d, o) = (&self.diagonal, &self.off_diagonal);
        Vector3::new(
            d.x * v.x + o.z * v.y + o.y * v.z,
            o.z * v.x + d.y * v.y + o.x * v.z,
            o.y * v.x + o.x * v.y + d.z * v.z,
        )
    }
}

impl Add for Symmetric3 {
    type Output = Self;
    #[inline]
    fn add(mut self, o: Self) -> Self {
        self += o;
        self
    }
}

impl AddAssign for Symmetric3 {
    #[inline]
    fn add_assign(&mut self, o: Self) {
        self.diagonal += o.diagonal;
        self.off_diagonal += o.off_diagonal;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    fn matrix() -> Matrix3<f64> {
        Matrix3::new(2.0, 0.1, -0.2, 0.1, 1.5, 0.3, -0.2, 0.3, 1.8)
    }

    #[test]
    fn products_agree_with_the_full_matrix() {
        let (full, symmetric) = (matrix(), Symmetric3::from(matrix()));
        assert_eq!(symmetric.to_matrix(), full);
        let v = Vector3::new(0.3, -0.7, 1.1);
        assert!((&symmetric * v - full * v).norm() < 1e-15);
        let R = Rotation3::from_euler_angles(0.4, -0.9, 2.1);
        let turned = R.matrix() * full * R.matrix().transpose();
        assert!((symmetric.rotated(R.matrix()).to_matrix() - turned).norm() < 1e-15);
        let identity = symmetric.inverse().to_matrix() * full;
        assert!((identity - Matrix3::identity()).norm() < 1e-15);
    }

    #[test]
    fn shift_is_the_tensor_of_its_formula() {
        let (p, g) = (Vector3::new(0.3, -1.2, 0.7), Vector3::new(0.4, 0.9, 2.1));
        let expected =
            Matrix3::from_diagonal_element(2.0 * p.dot(&g)) - p * g.transpose() - g * p.transpose();
        assert!((Symmetric3::shift(&p, &g).to_matrix() - expected).norm() < 1e-15);
    }

    #[test]
    fn the_inverse_of_a_singular_matrix_is_not_finite() {
        assert!(!Symmetric3::ZERO.inverse().diagonal.x.is_finite());
    }
}
