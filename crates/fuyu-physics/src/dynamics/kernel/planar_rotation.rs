//! Rotation about a coordinate axis, which is cheaper than a general rotation.

use pulp::Simd;

use super::vector::other_axes;
use super::{F64x8, GROUP_SIZE, Lanes, Mat3, Scalar, Sym3, Vec3};

/// Rotation `R_AB` by an angle about a coordinate axis, with the products that tensors need. `apply` transforms
/// components in B to components in A, `apply_inverse` the reverse. The axis is the const parameter of the methods: 0
/// is x, 1 is y, 2 is z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarRotation<S> {
    /// Cosine of the angle.
    pub cos: S,
    /// Sine of the angle.
    pub sin: S,
    /// `sin²`.
    pub sin_sin: S,
    /// `sin cos`.
    pub sin_cos: S,
    /// Sine of twice the angle.
    pub sin_twice: S,
    /// Cosine of twice the angle.
    pub cos_twice: S,
}

impl<S: Scalar> PlanarRotation<S> {
    /// From cosine and sine of the angle.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn new(cos: S, sin: S) -> Self {
        let (sin_sin, sin_cos) = (sin * sin, sin * cos);
        Self {
            cos,
            sin,
            sin_sin,
            sin_cos,
            sin_twice: sin_cos + sin_cos,
            cos_twice: cos.mul_add(cos, -sin_sin),
        }
    }

    /// A constant rotation, with numbers of the kind of `like`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn constant(like: S, rotation: &PlanarRotation<f64>) -> Self {
        Self {
            cos: like.constant(rotation.cos),
            sin: like.constant(rotation.sin),
            sin_sin: like.constant(rotation.sin_sin),
            sin_cos: like.constant(rotation.sin_cos),
            sin_twice: like.constant(rotation.sin_twice),
            cos_twice: like.constant(rotation.cos_twice),
        }
    }

    /// Components in A of a vector given in B.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn apply<const AXIS: usize>(&self, v: Vec3<S>) -> Vec3<S> {
        let (j, k) = other_axes(AXIS);
        let mut rotated = v;
        rotated[j] = self.sin.mul_sub_from(v[k], self.cos * v[j]);
        rotated[k] = self.sin.mul_add(v[j], self.cos * v[k]);
        rotated
    }

    /// Components in B of a vector given in A.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn apply_inverse<const AXIS: usize>(&self, v: Vec3<S>) -> Vec3<S> {
        let (j, k) = other_axes(AXIS);
        let mut rotated = v;
        rotated[j] = self.sin.mul_add(v[k], self.cos * v[j]);
        rotated[k] = self.sin.mul_sub_from(v[j], self.cos * v[k]);
        rotated
    }

    /// Components in A of the symmetric tensor whose components in B are `m`, if the off-diagonal entries in the axis's
    /// row are zero (that row is not changed).
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn rotate_sym_in_plane<const AXIS: usize>(&self, m: Sym3<S>) -> Sym3<S> {
        let (j, k) = other_axes(AXIS);
        let (difference, off) = (m.diagonal[j] - m.diagonal[k], m.off[AXIS]);
        // The trace is invariant, so one number corrects both diagonal entries.
        let change = self.sin_sin.mul_add(difference, self.sin_twice * off);
        let mut rotated = m;
        rotated.diagonal[j] = m.diagonal[j] - change;
        rotated.diagonal[k] = m.diagonal[k] + change;
        rotated.off[AXIS] = self.sin_cos.mul_add(difference, self.cos_twice * off);
        rotated
    }

    /// Components in A of the symmetric tensor whose components in B are `m`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn rotate_sym<const AXIS: usize>(&self, m: Sym3<S>) -> Sym3<S> {
        let (j, k) = other_axes(AXIS);
        let mut rotated = self.rotate_sym_in_plane::<AXIS>(m);
        // Entries (axis, j) and (axis, k) rotate as a vector.
        rotated.off[k] = self.sin.mul_sub_from(m.off[j], self.cos * m.off[k]);
        rotated.off[j] = self.sin.mul_add(m.off[k], self.cos * m.off[j]);
        rotated
    }

    /// [`Self::rotate_sym`] of `m`, plus a tensor in A. The additions use values that are known before `m`, so that they
    /// do not lengthen the chain of dependent operations.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn rotate_sym_and_add<const AXIS: usize>(&self, m: Sym3<S>, addend: Sym3<S>) -> Sym3<S> {
        let (i, (j, k)) = (AXIS, other_axes(AXIS));
        let (difference, across) = (m.diagonal[j] - m.diagonal[k], m.off[i]);
        let change = self.sin_sin.mul_add(difference, self.sin_twice * across);
        let mut sum = addend;
        sum.diagonal[i] = m.diagonal[i] + addend.diagonal[i];
        sum.diagonal[j] = (m.diagonal[j] + addend.diagonal[j]) - change;
        sum.diagonal[k] = (m.diagonal[k] + addend.diagonal[k]) + change;
        let across = self.cos_twice.mul_add(across, addend.off[i]);
        sum.off[i] = self.sin_cos.mul_add(difference, across);
        let (to_k, to_j) = (
            self.cos.mul_add(m.off[k], addend.off[k]),
            self.cos.mul_add(m.off[j], addend.off[j]),
        );
        sum.off[k] = self.sin.mul_sub_from(m.off[j], to_k);
        sum.off[j] = self.sin.mul_add(m.off[k], to_j);
        sum
    }

    /// Components in A of the tensor whose components in B are `m`, except for the axis's row, which is not changed.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn rotate_mat_except_axis_row<const AXIS: usize>(&self, m: Mat3<S>) -> Mat3<S> {
        let (j, k) = other_axes(AXIS);
        let Mat3(rows) = m;
        let difference = rows[j][j] - rows[k][k];
        let sum = rows[j][k] + rows[k][j];
        let change = self.sin_sin.mul_add(difference, self.sin_cos * sum);
        let sheared = self.sin_sin.mul_sub_from(sum, self.sin_cos * difference);
        let mut rotated = rows;
        rotated[j][j] = rows[j][j] - change;
        rotated[k][k] = rows[k][k] + change;
        rotated[j][k] = rows[j][k] + sheared;
        rotated[k][j] = rows[k][j] + sheared;
        let (a, b) = (rows[j][AXIS], rows[k][AXIS]);
        rotated[j][AXIS] = self.sin.mul_sub_from(b, self.cos * a);
        rotated[k][AXIS] = self.sin.mul_add(a, self.cos * b);
        Mat3(rotated)
    }

    /// Components in A of the tensor whose components in B are `m`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn rotate_mat<const AXIS: usize>(&self, m: Mat3<S>) -> Mat3<S> {
        let Mat3(mut rotated) = self.rotate_mat_except_axis_row::<AXIS>(m);
        rotated[AXIS] = self.apply::<AXIS>(m.0[AXIS]);
        Mat3(rotated)
    }
}

impl PlanarRotation<F64x8> {
    /// Eight rotations by zero.
    pub(super) const IDENTITY: Self = Self {
        cos: F64x8([1.0; GROUP_SIZE]),
        sin: F64x8::ZERO,
        sin_sin: F64x8::ZERO,
        sin_cos: F64x8::ZERO,
        sin_twice: F64x8::ZERO,
        cos_twice: F64x8([1.0; GROUP_SIZE]),
    };

    /// Stores `rotations` at index `first` and after.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn store_lanes<S: Simd>(
        &mut self,
        first: usize,
        rotations: &PlanarRotation<Lanes<S>>,
    ) {
        rotations.cos.store(&mut self.cos.0[first..]);
        rotations.sin.store(&mut self.sin.0[first..]);
        rotations.sin_sin.store(&mut self.sin_sin.0[first..]);
        rotations.sin_cos.store(&mut self.sin_cos.0[first..]);
        rotations.sin_twice.store(&mut self.sin_twice.0[first..]);
        rotations.cos_twice.store(&mut self.cos_twice.0[first..]);
    }

    /// Rotation `i`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn lane(&self, i: usize) -> PlanarRotation<f64> {
        PlanarRotation {
            cos: self.cos.0[i],
            sin: self.sin.0[i],
            sin_sin: self.sin_sin.0[i],
            sin_cos: self.sin_cos.0[i],
            sin_twice: self.sin_twice.0[i],
            cos_twice: self.cos_twice.0[i],
        }
    }
}
