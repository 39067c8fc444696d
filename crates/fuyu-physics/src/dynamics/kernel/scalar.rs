//! The numbers that the kernels calculate with.

use std::ops::{Add, Mul, Neg, Sub};

/// A number, or several side by side, on which a kernel runs: `f64`, lanes of it, or a type that counts
/// operations or carries more digits. Only what the recursions need.
///
/// `f64` multiplies and adds with one rounding everywhere, so that results do not depend on the machine.
/// Where the compiler may not assume an instruction for that, a call stands in its place: kernels are
/// meant to be called inside [`pulp::Arch::dispatch`], which allows it.
pub trait Scalar:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// `value` as a number of the same kind as `self` (which only tells how many lanes there are).
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
