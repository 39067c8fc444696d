//! Postures for the design of a law and for the evaluation of its stability.

use nalgebra::DVector;

use crate::model::{JointLimits, Model};

/// `count` postures spread evenly over the ranges of the joints: points of the Halton sequence (J. H. Halton, Numer.
/// Math. 2, 1960), the same in every run. The range of a joint without limits, or with a range beyond a turn, is -π to
/// π.
///
/// The sequence uses the first 16 primes; further joints repeat them.
pub fn spread_postures(model: &Model, count: usize) -> Vec<DVector<f64>> {
    const PRIMES: [usize; 16] = [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53];
    let posture = |k: usize| {
        let joints = model.joints().iter().enumerate();
        let positions = joints.map(|(j, joint)| {
            let [lower, upper] = range(&joint.limits);
            lower + (upper - lower) * radical_inverse(k, PRIMES[j % PRIMES.len()])
        });
        DVector::from_iterator(model.dof(), positions)
    };
    (1..=count).map(posture).collect()
}

fn range(limits: &JointLimits) -> [f64; 2] {
    use std::f64::consts::{PI, TAU};
    let JointLimits { lower, upper, .. } = *limits;
    match lower.is_finite() && upper.is_finite() && upper - lower <= TAU {
        true => [lower, upper],
        false => [-PI, PI],
    }
}

/// Radical inverse: the digits of `k` in this base, mirrored at the point; between 0 and 1.
fn radical_inverse(mut k: usize, base: usize) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0 / base as f64);
    while k > 0 {
        value += (k % base) as f64 * digit;
        k /= base;
        digit /= base as f64;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    // The first points by hand: 1, 10, 11, 100 in base 2; 1, 2, 10, 11 in base 3.
    #[test]
    fn digits_are_mirrored() {
        let points = |base| [1, 2, 3, 4].map(|k| radical_inverse(k, base));
        assert_eq!(points(2), [0.5, 0.25, 0.75, 0.125]);
        let expected = [1.0 / 3.0, 2.0 / 3.0, 1.0 / 9.0, 4.0 / 9.0];
        for (found, expected) in points(3).into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-15, "{found}");
        }
    }

    #[test]
    fn a_range_beyond_a_turn_is_a_turn() {
        let limits = JointLimits {
            lower: -0.5,
            upper: 1.0,
            ..JointLimits::NONE
        };
        assert_eq!(range(&limits), [-0.5, 1.0]);
        let pi = std::f64::consts::PI;
        assert_eq!(range(&JointLimits::NONE), [-pi, pi]);
        let wide = JointLimits {
            lower: -7.0,
            upper: 7.0,
            ..limits
        };
        assert_eq!(range(&wide), [-pi, pi]);
    }
}
