//! Vectors and 3 × 3 matrices of any [`Scalar`].
//!
//! Here and in all kernels, numbers are not passed through closures (no `map` over arrays): a closure that is not
//! inlined is compiled without the SIMD instructions of the surrounding kernel, and each operation in it becomes a
//! function call.

use std::ops::{Add, Index, IndexMut, Neg, Sub};

use super::Scalar;
use crate::spatial::Symmetric3;

/// A vector with three components.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vec3<S>(pub [S; 3]);

/// A symmetric 3 × 3 matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sym3<S> {
    /// Diagonal `xx, yy, zz`.
    pub diagonal: [S; 3],
    /// Off-diagonal entries `yz, xz, xy`: entry `k` lies in neither row nor column `k`.
    pub off: [S; 3],
}

/// A 3 × 3 matrix by rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mat3<S>(pub [Vec3<S>; 3]);

/// The two axes that follow `axis` in right-handed order.
#[inline(always)]
pub(super) const fn other_axes(axis: usize) -> (usize, usize) {
    ((axis + 1) % 3, (axis + 2) % 3)
}

impl<S: Scalar> Vec3<S> {
    /// All components zero, as numbers of the kind of `like`.
    #[inline(always)]
    pub fn zero(like: S) -> Self {
        Self([like.constant(0.0); 3])
    }

    /// `v` as numbers of the kind of `like`.
    #[inline(always)]
    pub fn constant(like: S, v: &[f64; 3]) -> Self {
        Self([
            like.constant(v[0]),
            like.constant(v[1]),
            like.constant(v[2]),
        ])
    }

    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, o: Self) -> S {
        let [x, y, z] = self.0;
        x.mul_add(o[0], y.mul_add(o[1], z * o[2]))
    }

    /// Vector product.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        let ([x, y, z], [a, b, c]) = (self.0, o.0);
        Self([
            z.mul_sub_from(b, y * c),
            x.mul_sub_from(c, z * a),
            y.mul_sub_from(a, x * b),
        ])
    }

    /// `self · k + addend`.
    #[inline(always)]
    pub fn mul_add(self, k: S, addend: Self) -> Self {
        let ([x, y, z], [a, b, c]) = (self.0, addend.0);
        Self([x.mul_add(k, a), y.mul_add(k, b), z.mul_add(k, c)])
    }

    /// `self · k`.
    #[inline(always)]
    pub fn scaled(self, k: S) -> Self {
        let [x, y, z] = self.0;
        Self([x * k, y * k, z * k])
    }
}

impl<S> Index<usize> for Vec3<S> {
    type Output = S;
    #[inline(always)]
    fn index(&self, i: usize) -> &S {
        &self.0[i]
    }
}

impl<S> IndexMut<usize> for Vec3<S> {
    #[inline(always)]
    fn index_mut(&mut self, i: usize) -> &mut S {
        &mut self.0[i]
    }
}

impl<S: Scalar> Add for Vec3<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        let ([x, y, z], [a, b, c]) = (self.0, o.0);
        Self([x + a, y + b, z + c])
    }
}

impl<S: Scalar> Sub for Vec3<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        let ([x, y, z], [a, b, c]) = (self.0, o.0);
        Self([x - a, y - b, z - c])
    }
}

impl<S: Scalar> Neg for Vec3<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let [x, y, z] = self.0;
        Self([-x, -y, -z])
    }
}

impl<S: Scalar> Sym3<S> {
    /// `m` as numbers of the kind of `like`.
    #[inline(always)]
    pub fn constant(like: S, m: &Symmetric3) -> Self {
        let (d, o) = (&m.diagonal, &m.off_diagonal);
        Self {
            diagonal: Vec3::constant(like, &[d.x, d.y, d.z]).0,
            off: Vec3::constant(like, &[o.x, o.y, o.z]).0,
        }
    }

    /// Row (or column) `i`.
    #[inline(always)]
    pub fn row(self, i: usize) -> Vec3<S> {
        let (j, k) = other_axes(i);
        let mut row = Vec3([self.diagonal[i]; 3]);
        row[j] = self.off[k];
        row[k] = self.off[j];
        row
    }

    /// Matrix times vector.
    #[inline(always)]
    pub fn times(self, v: Vec3<S>) -> Vec3<S> {
        Vec3([self.row(0).dot(v), self.row(1).dot(v), self.row(2).dot(v)])
    }

    /// Entrywise sum with a constant matrix.
    #[inline(always)]
    pub fn plus(self, m: &Symmetric3) -> Self {
        let [x, y, z] = self.diagonal;
        let [a, b, c] = self.off;
        let (d, o) = (&m.diagonal, &m.off_diagonal);
        Self {
            diagonal: [x.plus(d.x), y.plus(d.y), z.plus(d.z)],
            off: [a.plus(o.x), b.plus(o.y), c.plus(o.z)],
        }
    }

    /// The inverse, by cofactors.
    #[inline(always)]
    pub fn inverse(self) -> Self {
        let ([x, y, z], [a, b, c]) = (self.diagonal, self.off);
        let diagonal = [
            a.mul_sub_from(a, y * z),
            b.mul_sub_from(b, x * z),
            c.mul_sub_from(c, x * y),
        ];
        let off = [
            a.mul_sub_from(x, b * c),
            b.mul_sub_from(y, a * c),
            c.mul_sub_from(z, a * b),
        ];
        let scale = x
            .mul_add(diagonal[0], c.mul_add(off[2], b * off[1]))
            .recip();
        Self {
            diagonal: Vec3(diagonal).scaled(scale).0,
            off: Vec3(off).scaled(scale).0,
        }
    }
}

impl From<Sym3<f64>> for Symmetric3 {
    fn from(m: Sym3<f64>) -> Self {
        Self {
            diagonal: m.diagonal.into(),
            off_diagonal: m.off.into(),
        }
    }
}

impl<S: Scalar> Add for Sym3<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self {
            diagonal: (Vec3(self.diagonal) + Vec3(o.diagonal)).0,
            off: (Vec3(self.off) + Vec3(o.off)).0,
        }
    }
}

impl<S: Scalar> Neg for Sym3<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self {
            diagonal: (-Vec3(self.diagonal)).0,
            off: (-Vec3(self.off)).0,
        }
    }
}

impl<S: Scalar> Mat3<S> {
    /// Column `j`.
    #[inline(always)]
    pub fn column(self, j: usize) -> Vec3<S> {
        Vec3([self.0[0][j], self.0[1][j], self.0[2][j]])
    }

    /// Matrix times vector.
    #[inline(always)]
    pub fn times(self, v: Vec3<S>) -> Vec3<S> {
        let [x, y, z] = self.0;
        Vec3([x.dot(v), y.dot(v), z.dot(v)])
    }

    /// Transposed matrix times vector.
    #[inline(always)]
    pub fn tr_mul(self, v: Vec3<S>) -> Vec3<S> {
        let [x, y, z] = self.0;
        x.mul_add(v[0], y.mul_add(v[1], z.scaled(v[2])))
    }
}

impl<S: Scalar> Add for Mat3<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        let ([x, y, z], [a, b, c]) = (self.0, o.0);
        Self([x + a, y + b, z + c])
    }
}
