//! Sine and cosine of many angles at once.

use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

use super::{Eight, GROUP};

/// Above this the quarter turns are no longer counted exactly; the standard library takes over.
const LARGEST: f64 = 1e5;

/// π/2 and what it lacks: with one rounding an operation this is enough for angles in range.
const QUARTER: [f64; 2] = [FRAC_PI_2, 6.123_233_995_736_766e-17];

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

/// Cosines and sines of eight angles to one unit in the last place of 1. The compiler makes wide
/// instructions of it where it may, as everywhere in the kernels ([`super::Scalar`]).
#[inline(always)]
pub fn sin_cos(angles: &Eight) -> (Eight, Eight) {
    let Eight(angles) = angles;
    let (mut cosines, mut sines) = (Eight::ZERO, Eight::ZERO);
    let (Eight(cos), Eight(sin)) = (&mut cosines, &mut sines);
    let mut in_range = true;
    for angle in angles {
        in_range &= angle.abs() <= LARGEST;
    }
    if in_range {
        for i in 0..GROUP {
            (cos[i], sin[i]) = reduced(angles[i]);
        }
    } else {
        for i in 0..GROUP {
            (sin[i], cos[i]) = angles[i].sin_cos();
        }
    }
    (cosines, sines)
}

/// Terms are put together in pairs, so that few wait for others.
#[inline(always)]
fn polynomial(c: &[f64; 6], z: f64) -> f64 {
    let zz = z * z;
    let (high, middle, low) = (
        c[0].mul_add(z, c[1]),
        c[2].mul_add(z, c[3]),
        c[4].mul_add(z, c[5]),
    );
    high.mul_add(zz, middle).mul_add(zz, low)
}

/// Cosine and sine of one angle within the range.
#[inline(always)]
fn reduced(angle: f64) -> (f64, f64) {
    // Adding this rounds to an integer, which then stands in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let shifted = angle.mul_add(FRAC_2_PI, ROUND);
    let quarters = shifted.to_bits();
    let turns = shifted - ROUND;
    let x = turns.mul_add(-QUARTER[0], angle);
    let x = turns.mul_add(-QUARTER[1], x);
    let z = x * x;
    let (s, c) = (polynomial(&SIN, z), polynomial(&COS, z));
    let sin = (x * z).mul_add(s, x);
    let half = 0.5 * z;
    let head = 1.0 - half;
    let cos = head + (z * z).mul_add(c, 1.0 - head - half);
    let (cos, sin) = if quarters & 1 == 0 {
        (cos, sin)
    } else {
        (sin, cos)
    };
    let sign = |value: f64, negative: u64| f64::from_bits(value.to_bits() ^ (negative << 63));
    (
        sign(cos, (quarters ^ (quarters >> 1)) & 1),
        sign(sin, (quarters >> 1) & 1),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wrong digit of a polynomial or of π/2, or a wrong quadrant, shows.
    #[test]
    fn all_quadrants_agree_with_the_standard_library() {
        let mut angle = -1.0e5;
        let mut worst: f64 = 0.0;
        while angle < 1.0e5 {
            let angles = std::array::from_fn(|i| angle + 0.61 * i as f64);
            let (Eight(cos), Eight(sin)) = sin_cos(&Eight(angles));
            for i in 0..GROUP {
                let (s, c) = angles[i].sin_cos();
                worst = worst.max((sin[i] - s).abs()).max((cos[i] - c).abs());
            }
            angle += 4.9;
        }
        assert!(worst <= 2.3e-16, "{worst:e}");
        for angle in [0.0, -1e-300, 1e-9, 1e6, -1e22] {
            let (cos, sin) = sin_cos(&Eight([angle; GROUP]));
            assert_eq!((sin.0[3], cos.0[3]), angle.sin_cos());
        }
        assert!(sin_cos(&Eight([f64::NAN; GROUP])).0.0[0].is_nan());
    }
}
