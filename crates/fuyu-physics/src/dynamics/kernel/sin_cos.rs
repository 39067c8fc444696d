//! Sines and cosines of several angles at once.

use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

use pulp::Simd;

use super::{F64x8, Lanes, Scalar};

/// Largest angle for which the number of quarter turns is exact; larger ones use the standard library.
const MAX_ANGLE: f64 = 1e5;

/// π/2 as a sum of two numbers: with fused multiply-add, two suffice for angles within the range.
const HALF_PI: [f64; 2] = [FRAC_PI_2, 6.123_233_995_736_766e-17];

/// Minimax polynomials on ±π/4 (Sun's fdlibm): `sin x = x + x³ S(x²)`, `cos x = 1 - x²/2 + x⁴ C(x²)`.
const SIN: [f64; 6] = [
    1.589_690_995_211_55e-10,
    -2.505_076_025_340_686_3e-8,
    2.755_731_370_707_006_8e-6,
    -1.984_126_982_985_795e-4,
    8.333_333_333_322_49e-3,
    -1.666_666_666_666_663e-1,
];
const COS: [f64; 6] = [
    -1.135_964_755_778_819_5e-11,
    2.087_572_321_298_175e-9,
    -2.755_731_435_139_066_3e-7,
    2.480_158_728_947_673e-5,
    -1.388_888_888_887_411e-3,
    4.166_666_666_666_66e-2,
];

/// Cosines and sines to one unit in the last place of 1.
#[inline(always)]
pub fn sin_cos<S: Simd>(angles: Lanes<S>) -> (Lanes<S>, Lanes<S>) {
    let simd = angles.simd;
    let magnitudes = simd.abs_f64s(angles.value);
    let in_range = simd.less_than_or_equal_f64s(magnitudes, simd.splat_f64s(MAX_ANGLE));
    let near = in_range_sin_cos(angles);
    if simd.first_true_m64s(simd.not_m64s(in_range)) < S::F64_LANES {
        let mut numbers = F64x8::ZERO;
        angles.store(&mut numbers.0);
        let [cos, sin] = standard_sin_cos(&numbers);
        let (cos, sin) = (Lanes::load(simd, &cos.0), Lanes::load(simd, &sin.0));
        let cos = simd.select_f64s(in_range, near.0.value, cos.value);
        let sin = simd.select_f64s(in_range, near.1.value, sin.value);
        (Lanes { simd, value: cos }, Lanes { simd, value: sin })
    } else {
        near
    }
}

/// Cosines and sines by the standard library, for angles beyond the range.
#[cold]
fn standard_sin_cos(angles: &F64x8) -> [F64x8; 2] {
    let (mut cos, mut sin) = (F64x8::ZERO, F64x8::ZERO);
    for (i, angle) in angles.0.iter().enumerate() {
        (sin.0[i], cos.0[i]) = angle.sin_cos();
    }
    [cos, sin]
}

/// Evaluates a polynomial of degree five, in pairs of terms to shorten the chain of dependent operations (Estrin).
#[inline(always)]
fn polynomial<S: Simd>(c: &[f64; 6], z: Lanes<S>) -> Lanes<S> {
    let zz = z * z;
    let high = z.constant(c[0]).mul_add(z, z.constant(c[1]));
    let middle = z.constant(c[2]).mul_add(z, z.constant(c[3]));
    let low = z.constant(c[4]).mul_add(z, z.constant(c[5]));
    high.mul_add(zz, middle).mul_add(zz, low)
}

/// Cosines and sines of angles within the range.
#[inline(always)]
fn in_range_sin_cos<S: Simd>(angle: Lanes<S>) -> (Lanes<S>, Lanes<S>) {
    // Adding this rounds to an integer, which is then in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let simd = angle.simd;
    let shifted = angle.mul_add(angle.constant(FRAC_2_PI), angle.constant(ROUND));
    let turns = shifted - angle.constant(ROUND);
    let x = turns.mul_add(angle.constant(-HALF_PI[0]), angle);
    let x = turns.mul_add(angle.constant(-HALF_PI[1]), x);
    let z = x * x;
    let (s, c) = (polynomial(&SIN, z), polynomial(&COS, z));
    let sin = (x * z).mul_add(s, x);
    let (one, half) = (angle.constant(1.0), z.times(0.5));
    let head = one - half;
    let cos = head + (z * z).mul_add(c, one - head - half);
    // By quadrant, sine and cosine are exchanged and change their signs.
    let quarters = simd.transmute_u64s_f64s(shifted.value);
    let is_odd = has_bit(simd, quarters, 1);
    let next = simd.add_u64s(quarters, simd.splat_u64s(1));
    let [cos, sin] = [
        simd.select_f64s(is_odd, sin.value, cos.value),
        simd.select_f64s(is_odd, cos.value, sin.value),
    ];
    (negated(simd, cos, next), negated(simd, sin, quarters))
}

#[inline(always)]
fn has_bit<S: Simd>(simd: S, bits: S::u64s, bit: u64) -> S::m64s {
    let bit = simd.splat_u64s(bit);
    simd.equal_u64s(simd.and_u64s(bits, bit), bit)
}

/// `value` with the opposite sign where the second bit of `quarters` is set.
#[inline(always)]
fn negated<S: Simd>(simd: S, value: S::f64s, quarters: S::u64s) -> Lanes<S> {
    let is_negated = has_bit(simd, quarters, 2);
    let value = simd.select_f64s(is_negated, simd.neg_f64s(value), value);
    Lanes { simd, value }
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::dynamics::kernel::GROUP_SIZE;
    use pulp::{Arch, WithSimd};

    /// Cosines and sines of any eight angles.
    struct Task(F64x8);

    impl WithSimd for Task {
        type Output = [F64x8; 2];
        fn with_simd<S: Simd>(self, simd: S) -> [F64x8; 2] {
            let mut found = [F64x8::ZERO; 2];
            for first in (0..GROUP_SIZE).step_by(S::F64_LANES) {
                let (cos, sin) = sin_cos(Lanes::load(simd, &self.0.0[first..]));
                cos.store(&mut found[0].0[first..]);
                sin.store(&mut found[1].0[first..]);
            }
            found
        }
    }

    /// Fails for a wrong digit of a polynomial or of π/2, a wrong quadrant, and a SIMD width with different results.
    #[test]
    fn all_quadrants_agree_with_the_standard_library() {
        let mut angle = -1.0e5;
        let mut worst: f64 = 0.0;
        while angle < 1.0e5 {
            let angles: [f64; GROUP_SIZE] = std::array::from_fn(|i| angle + 0.61 * i as f64);
            let [cos, sin] = Arch::new().dispatch(Task(F64x8(angles)));
            assert_eq!([cos, sin], Arch::Scalar.dispatch(Task(F64x8(angles))));
            for (i, angle) in angles.iter().enumerate() {
                let (s, c) = angle.sin_cos();
                worst = worst.max((sin.0[i] - s).abs()).max((cos.0[i] - c).abs());
            }
            angle += 4.9;
        }
        assert!(worst <= 2.3e-16, "{worst:e}");
        for angle in [0.0, -1e-300, 1e-9, 1e6, -1e22] {
            let [cos, sin] = Arch::new().dispatch(Task(F64x8([angle; GROUP_SIZE])));
            assert_eq!((sin.0[3], cos.0[3]), angle.sin_cos());
        }
        let mut angles = F64x8::ZERO;
        angles.0[5] = f64::NAN;
        let [cos, sin] = Arch::new().dispatch(Task(angles));
        assert!(cos.0[5].is_nan() && sin.0[5].is_nan() && cos.0[4] == 1.0);
    }
}
