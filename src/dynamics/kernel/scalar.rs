//! The numbers that the kernels calculate with.

use std::ops::{Add, Mul, Neg, Sub};

/// A number, or several side by side, on which a kernel runs: `f64`, lanes of it, or a type that counts
/// operations or carries more digits. Only what the recursions need.
pub trait Scalar:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// `value` as a number of the same kind as `self` (which only tells how many lanes there are).
    fn constant(self, value: f64) -> Self;

    /// `1 / self`.
    fn recip(self) -> Self;

    /// `self · factor + addend`, rounded once where the machine can.
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
    fn recip(self) -> Self {
        1.0 / self
    }
}

/// `f64` on a machine that multiplies and adds in one instruction. Elsewhere it is right but slow, so it
/// belongs inside code that is compiled for such a machine.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(transparent)]
pub struct Fused(pub f64);

macro_rules! fused_operator {
    ($trait:ident, $method:ident) => {
        impl $trait for Fused {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0))
            }
        }
    };
}
fused_operator!(Add, add);
fused_operator!(Sub, sub);
fused_operator!(Mul, mul);

impl Neg for Fused {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Scalar for Fused {
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self(value)
    }

    #[inline(always)]
    fn recip(self) -> Self {
        Self(1.0 / self.0)
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        Self(self.0.mul_add(factor.0, addend.0))
    }
}
