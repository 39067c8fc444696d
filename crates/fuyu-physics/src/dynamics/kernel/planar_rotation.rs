//! Turning about a coordinate axis: what makes a hop from body to body cheap.

use pulp::Simd;

use super::vector::others;
use super::{Eight, GROUP, Lanes, Mat3, Scalar, Sym3, Vec3};

/// A turn by an angle about a coordinate axis, with the products that tensors need. For a turn of frame B
/// against frame A, `out` takes components in B to components in A and `back` goes back. The axis is the
/// const parameter: 0 is x, 1 is y, 2 is z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn<S> {
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

impl<S: Scalar> Turn<S> {
    /// From cosine and sine of the angle.
    #[inline(always)]
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

    /// A turn that is known beforehand, as numbers of the kind of `like`.
    #[inline(always)]
    pub fn constant(like: S, turn: &Turn<f64>) -> Self {
        Self {
            cos: like.constant(turn.cos),
            sin: like.constant(turn.sin),
            sin_sin: like.constant(turn.sin_sin),
            sin_cos: like.constant(turn.sin_cos),
            sin_twice: like.constant(turn.sin_twice),
            cos_twice: like.constant(turn.cos_twice),
        }
    }

    /// Components in A of a vector given in B.
    #[inline(always)]
    pub fn out<const AXIS: usize>(&self, v: Vec3<S>) -> Vec3<S> {
        let (j, k) = others(AXIS);
        let mut turned = v;
        turned[j] = self.sin.mul_sub_from(v[k], self.cos * v[j]);
        turned[k] = self.sin.mul_add(v[j], self.cos * v[k]);
        turned
    }

    /// Components in B of a vector given in A.
    #[inline(always)]
    pub fn back<const AXIS: usize>(&self, v: Vec3<S>) -> Vec3<S> {
        let (j, k) = others(AXIS);
        let mut turned = v;
        turned[j] = self.sin.mul_add(v[k], self.cos * v[j]);
        turned[k] = self.sin.mul_sub_from(v[j], self.cos * v[k]);
        turned
    }

    /// Components in A of the symmetric tensor whose components in B are `m`, all of them in the plane
    /// of the turn (those along the axis are left as they are).
    #[inline(always)]
    pub fn sym_in_plane<const AXIS: usize>(&self, m: Sym3<S>) -> Sym3<S> {
        let (j, k) = others(AXIS);
        let (difference, off) = (m.diagonal[j] - m.diagonal[k], m.off[AXIS]);
        // The trace stays, so one number corrects both entries of the diagonal.
        let moved = self.sin_sin.mul_add(difference, self.sin_twice * off);
        let mut turned = m;
        turned.diagonal[j] = m.diagonal[j] - moved;
        turned.diagonal[k] = m.diagonal[k] + moved;
        turned.off[AXIS] = self.sin_cos.mul_add(difference, self.cos_twice * off);
        turned
    }

    /// Components in A of the symmetric tensor whose components in B are `m`.
    #[inline(always)]
    pub fn sym<const AXIS: usize>(&self, m: Sym3<S>) -> Sym3<S> {
        let (j, k) = others(AXIS);
        let mut turned = self.sym_in_plane::<AXIS>(m);
        // Entries (axis, j) and (axis, k) turn as a vector.
        turned.off[k] = self.sin.mul_sub_from(m.off[j], self.cos * m.off[k]);
        turned.off[j] = self.sin.mul_add(m.off[k], self.cos * m.off[j]);
        turned
    }

    /// [`Self::sym`] plus a tensor of A that is ready before `m`: the sum does not make anybody wait.
    #[inline(always)]
    pub fn sym_onto<const AXIS: usize>(&self, m: Sym3<S>, more: Sym3<S>) -> Sym3<S> {
        let (i, (j, k)) = (AXIS, others(AXIS));
        let (difference, across) = (m.diagonal[j] - m.diagonal[k], m.off[i]);
        let moved = self.sin_sin.mul_add(difference, self.sin_twice * across);
        let mut sum = more;
        sum.diagonal[i] = m.diagonal[i] + more.diagonal[i];
        sum.diagonal[j] = (m.diagonal[j] + more.diagonal[j]) - moved;
        sum.diagonal[k] = (m.diagonal[k] + more.diagonal[k]) + moved;
        let across = self.cos_twice.mul_add(across, more.off[i]);
        sum.off[i] = self.sin_cos.mul_add(difference, across);
        let (to_k, to_j) = (
            self.cos.mul_add(m.off[k], more.off[k]),
            self.cos.mul_add(m.off[j], more.off[j]),
        );
        sum.off[k] = self.sin.mul_sub_from(m.off[j], to_k);
        sum.off[j] = self.sin.mul_add(m.off[k], to_j);
        sum
    }

    /// Components in A of the tensor whose components in B are `m`, but for its row along the axis,
    /// which is left as it is.
    #[inline(always)]
    pub fn mat_across<const AXIS: usize>(&self, m: Mat3<S>) -> Mat3<S> {
        let (j, k) = others(AXIS);
        let Mat3(rows) = m;
        let difference = rows[j][j] - rows[k][k];
        let sum = rows[j][k] + rows[k][j];
        let moved = self.sin_sin.mul_add(difference, self.sin_cos * sum);
        let sheared = self.sin_sin.mul_sub_from(sum, self.sin_cos * difference);
        let mut turned = rows;
        turned[j][j] = rows[j][j] - moved;
        turned[k][k] = rows[k][k] + moved;
        turned[j][k] = rows[j][k] + sheared;
        turned[k][j] = rows[k][j] + sheared;
        let (a, b) = (rows[j][AXIS], rows[k][AXIS]);
        turned[j][AXIS] = self.sin.mul_sub_from(b, self.cos * a);
        turned[k][AXIS] = self.sin.mul_add(a, self.cos * b);
        Mat3(turned)
    }

    /// Components in A of the tensor whose components in B are `m`.
    #[inline(always)]
    pub fn mat<const AXIS: usize>(&self, m: Mat3<S>) -> Mat3<S> {
        let Mat3(mut turned) = self.mat_across::<AXIS>(m);
        turned[AXIS] = self.out::<AXIS>(m.0[AXIS]);
        Mat3(turned)
    }
}

impl Turn<Eight> {
    /// Eight that are none.
    pub(super) const NONE: Self = Self {
        cos: Eight([1.0; GROUP]),
        sin: Eight::ZERO,
        sin_sin: Eight::ZERO,
        sin_cos: Eight::ZERO,
        sin_twice: Eight::ZERO,
        cos_twice: Eight([1.0; GROUP]),
    };

    /// Takes over several side by side, the first of which comes to `first`.
    #[inline(always)]
    pub(super) fn set<S: Simd>(&mut self, first: usize, turns: &Turn<Lanes<S>>) {
        turns.cos.store(&mut self.cos.0[first..]);
        turns.sin.store(&mut self.sin.0[first..]);
        turns.sin_sin.store(&mut self.sin_sin.0[first..]);
        turns.sin_cos.store(&mut self.sin_cos.0[first..]);
        turns.sin_twice.store(&mut self.sin_twice.0[first..]);
        turns.cos_twice.store(&mut self.cos_twice.0[first..]);
    }

    /// That of one of them.
    #[inline(always)]
    pub(super) fn at(&self, i: usize) -> Turn<f64> {
        Turn {
            cos: self.cos.0[i],
            sin: self.sin.0[i],
            sin_sin: self.sin_sin.0[i],
            sin_cos: self.sin_cos.0[i],
            sin_twice: self.sin_twice.0[i],
            cos_twice: self.cos_twice.0[i],
        }
    }
}
