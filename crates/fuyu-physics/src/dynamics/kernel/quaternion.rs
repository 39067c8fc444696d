//! Unit quaternions and the exponential map by series, for any [`Scalar`].

use super::{Scalar, Vec3};

/// A unit quaternion.
#[derive(Debug, Clone, Copy)]
pub struct Quat<S> {
    /// Scalar part.
    pub w: S,
    /// Vector part.
    pub v: Vec3<S>,
}

/// Largest squared rotation angle \[rad²\] for which the series below are exact to rounding.
pub const SERIES_LIMIT: f64 = 0.25;

/// `cos(θ/2)` by powers of `-θ²`: `1 / (4ᵏ (2k)!)`.
const COS: [f64; 7] = [
    1.0,
    1.0 / 8.0,
    1.0 / 384.0,
    1.0 / 46_080.0,
    1.0 / 10_321_920.0,
    1.0 / 3_715_891_200.0,
    1.0 / 1_961_990_553_600.0,
];

/// `sin(θ/2) / θ` by powers of `-θ²`: `1 / (2 4ᵏ (2k+1)!)`.
const SIN: [f64; 7] = [
    1.0 / 2.0,
    1.0 / 48.0,
    1.0 / 3_840.0,
    1.0 / 645_120.0,
    1.0 / 185_794_560.0,
    1.0 / 81_749_606_400.0,
    1.0 / 51_011_754_393_600.0,
];

/// `(1 - (θ/2) cot(θ/2)) / θ²` by powers of `θ²`: Bernoulli's numbers over factorials.
const COT: [f64; 7] = [
    1.0 / 12.0,
    1.0 / 720.0,
    1.0 / 30_240.0,
    1.0 / 1_209_600.0,
    1.0 / 47_900_160.0,
    691.0 / 1_307_674_368_000.0,
    1.0 / 74_724_249_600.0,
];

#[inline(always)]
fn series<S: Scalar>(coefficients: &[f64; 7], x: S) -> S {
    let mut sum = x.constant(coefficients[6]);
    for k in (0..6).rev() {
        sum = sum.mul_add(x, x.constant(coefficients[k]));
    }
    sum
}

impl<S: Scalar> Quat<S> {
    /// Exponential map of a rotation vector whose square is at most [`SERIES_LIMIT`].
    #[inline(always)]
    pub fn exp_series(u: Vec3<S>) -> Self {
        let x = -u.dot(u);
        Self {
            w: series(&COS, x),
            v: u.scaled(series(&SIN, x)),
        }
    }

    /// `self · o`: first `self`, then `o` in the rotated axes.
    #[inline(always)]
    pub fn compose(self, o: Self) -> Self {
        let w = self.v.dot(o.v);
        Self {
            w: self.w * o.w - w,
            v: self.v.mul_add(o.w, o.v.mul_add(self.w, self.v.cross(o.v))),
        }
    }
}

/// [`crate::spatial::rotation_vector_rate`] where the square of `u` is at most [`SERIES_LIMIT`].
#[inline(always)]
pub fn rotation_vector_rate_series<S: Scalar>(u: Vec3<S>, w: Vec3<S>) -> Vec3<S> {
    let (k, uw) = (series(&COT, u.dot(u)), u.cross(w));
    u.cross(uw).mul_add(k, uw.mul_add(w[0].constant(0.5), w))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::{exp_so3, rotation_vector_rate};
    use nalgebra::Vector3;

    /// Fails for a wrong coefficient, sign or order of products, and for a series that is too short.
    #[test]
    fn series_agree_with_the_closed_forms() {
        let w = Vector3::new(0.3, -2.0, 1.1);
        let first = exp_so3(&Vector3::new(1.0, -2.0, 0.5));
        let parts = |q: &nalgebra::UnitQuaternion<f64>| Quat {
            w: q.w,
            v: Vec3([q.i, q.j, q.k]),
        };
        for size in [0.0, 1e-3, 0.05, 0.2, 0.5] {
            let u = Vector3::new(2.0, -1.0, 2.0) / 3.0 * size;
            let (exact, series) = (exp_so3(&u), Quat::exp_series(Vec3(u.into())));
            // Four roundings.
            let near = |a: f64, b: f64| {
                let limit = 1e-15 * a.abs().max(1.0);
                assert!((a - b).abs() <= limit, "{size}: {a} {b}");
            };
            let both = parts(&first).compose(series);
            let product = first * exact;
            for (a, b) in [(series, exact), (both, product)] {
                near(a.w, b.w);
                [b.i, b.j, b.k]
                    .iter()
                    .zip(a.v.0)
                    .for_each(|(b, a)| near(a, *b));
            }
            let rate = rotation_vector_rate_series(Vec3(u.into()), Vec3(w.into()));
            for i in 0..3 {
                near(rate[i], rotation_vector_rate(&u, &w)[i]);
            }
        }
    }
}
