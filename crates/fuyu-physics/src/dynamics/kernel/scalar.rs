//! The number type of the kernels.

use std::ops::{Add, Mul, Neg, Sub};

/// A number type for the kernels: `f64`, SIMD registers of it, or a type that counts operations or has higher
/// precision. It needs only the operations of the recursions.
///
/// `f64` uses fused multiply-add (one rounding) on every machine, so that results are the same everywhere. Without the
/// instruction, the compiler inserts a slow function call. Call kernels inside [`pulp::Arch::dispatch`], which enables
/// the instruction where the processor has it.
pub trait Scalar:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// `value` as a number of the same kind as `self`; the value of `self` is ignored.
    fn constant(self, value: f64) -> Self;

    /// `1 / self`.
    fn recip(self) -> Self;

    /// `self · factor + addend`.
    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        self * factor + addend
    }

    /// `addend - self · factor`.
    #[inline(always)]
    fn mul_sub_from(self, factor: Self, addend: Self) -> Self {
        (-self).mul_add(factor, addend)
    }

    /// `self · k`.
    #[inline(always)]
    fn times(self, k: f64) -> Self {
        self * self.constant(k)
    }

    /// `self + k`.
    #[inline(always)]
    fn plus(self, k: f64) -> Self {
        self + self.constant(k)
    }
}

impl Scalar for f64 {
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        f64::mul_add(self, factor, addend)
    }

    #[inline(always)]
    fn recip(self) -> Self {
        1.0 / self
    }
}
