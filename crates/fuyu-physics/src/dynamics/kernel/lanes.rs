//! SIMD numbers: several `f64` in one register.

use std::ops::{Add, Mul, Neg, Sub};

use pulp::Simd;

use super::Scalar;

/// Numbers per group in memory: as many as the widest registers hold.
pub const GROUP_SIZE: usize = 8;

/// A group of eight numbers in one cache line: access across two cache lines would take twice as long.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub struct F64x8(pub [f64; GROUP_SIZE]);

impl F64x8 {
    /// All zero.
    pub const ZERO: Self = Self([0.0; GROUP_SIZE]);
}

/// A SIMD register of `f64`, as wide as the processor's. Each lane is bit-identical to a computation with `f64`.
#[derive(Debug, Clone, Copy)]
pub struct Lanes<S: Simd> {
    pub(super) simd: S,
    pub(super) value: S::f64s,
}

impl<S: Simd> Lanes<S> {
    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        let value = simd.splat_f64s(value);
        Self { simd, value }
    }

    /// Loads the first numbers of a slice.
    ///
    /// # Panics
    /// If the slice is shorter than a register.
    #[inline(always)]
    pub fn load(simd: S, from: &[f64]) -> Self {
        let (lanes, _) = S::as_simd_f64s(from);
        let value = lanes[0];
        Self { simd, value }
    }

    /// Loads as many numbers as the slice holds, or as there are lanes; the others are zero.
    #[inline(always)]
    pub fn load_some(simd: S, from: &[f64]) -> Self {
        let value = simd.partial_load_f64s(from);
        Self { simd, value }
    }

    /// The number in the first lane.
    #[inline(always)]
    pub fn first(self) -> f64 {
        let mut numbers = F64x8::ZERO;
        self.store(&mut numbers.0);
        numbers.0[0]
    }

    /// Stores the lanes to the first numbers of a slice.
    ///
    /// # Panics
    /// If the slice is shorter than a register.
    #[inline(always)]
    pub fn store(self, into: &mut [f64]) {
        let (lanes, _) = S::as_mut_simd_f64s(into);
        lanes[0] = self.value;
    }
}

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let value = self.simd.add_f64s(self.value, other.value);
        Self { value, ..self }
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let value = self.simd.sub_f64s(self.value, other.value);
        Self { value, ..self }
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let value = self.simd.mul_f64s(self.value, other.value);
        Self { value, ..self }
    }
}

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let value = self.simd.neg_f64s(self.value);
        Self { value, ..self }
    }
}

impl<S: Simd> Scalar for Lanes<S> {
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self::splat(self.simd, value)
    }

    #[inline(always)]
    fn recip(self) -> Self {
        let one = self.simd.splat_f64s(1.0);
        let value = self.simd.div_f64s(one, self.value);
        Self { value, ..self }
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        let value = self
            .simd
            .mul_add_f64s(self.value, factor.value, addend.value);
        Self { value, ..self }
    }
}
