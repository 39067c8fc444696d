//! Small turns and what they do to vectors, for any kind of number.

use super::{Scalar, Vec3};

/// A unit quaternion.
#[derive(Debug, Clone, Copy)]
pub struct Attitude<S> {
    /// Scalar part.
    pub w: S,
    /// Vector part.
    pub v: Vec3<S>,
}

/// Up to this square of an angle \[rad²\] the series below are exact to rounding.
pub const SMALL_TURN: f64 = 0.25;

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

impl<S: Scalar> Attitude<S> {
    /// The turn of a rotation vector whose square is at most [`SMALL_TURN`].
    #[inline(always)]
    pub fn of_small(u: Vec3<S>) -> Self {
        let x = -u.dot(u);
        Self {
            w: series(&COS, x),
            v: u.scaled(series(&SIN, x)),
        }
    }

    /// First `self`, then in the turned axes `o`.
    #[inline(always)]
    pub fn then(self, o: Self) -> Self {
        let w = self.v.dot(o.v);
        Self {
            w: self.w * o.w - w,
            v: self.v.mul_add(o.w, o.v.mul_add(self.w, self.v.cross(o.v))),
        }
    }

    /// Components in the turned axes of a vector given in the others.
    #[inline(always)]
    pub fn back(self, x: Vec3<S>) -> Vec3<S> {
        let t = x.cross(self.v);
        let t = t + t;
        t.mul_add(self.w, t.cross(self.v) + x)
    }
}

/// [`crate::spatial::rotation_vector_rate`] where the square of `u` is at most [`SMALL_TURN`].
#[inline(always)]
pub fn small_turn_rate<S: Scalar>(u: Vec3<S>, w: Vec3<S>) -> Vec3<S> {
    let (k, uw) = (series(&COT, u.dot(u)), u.cross(w));
    u.cross(uw).mul_add(k, uw.mul_add(w[0].constant(0.5), w))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::{exp_so3, rotation_vector_rate};
    use nalgebra::Vector3;

    /// A wrong coefficient, sign or order of products shows; so does a series that is too short.
    #[test]
    fn small_turns_are_those_of_the_closed_forms() {
        let (w, x) = (Vector3::new(0.3, -2.0, 1.1), Vector3::new(-0.4, 0.9, 2.0));
        let first = exp_so3(&Vector3::new(1.0, -2.0, 0.5));
        let parts = |q: &nalgebra::UnitQuaternion<f64>| Attitude {
            w: q.w,
            v: Vec3([q.i, q.j, q.k]),
        };
        for size in [0.0, 1e-3, 0.05, 0.2, 0.5] {
            let u = Vector3::new(2.0, -1.0, 2.0) / 3.0 * size;
            let (exact, ours) = (exp_so3(&u), Attitude::of_small(Vec3(u.into())));
            // Four roundings.
            let near = |a: f64, b: f64| {
                let limit = 1e-15 * a.abs().max(1.0);
                assert!((a - b).abs() <= limit, "{size}: {a} {b}");
            };
            let both = parts(&first).then(ours);
            let product = first * exact;
            for (a, b) in [(ours, exact), (both, product)] {
                near(a.w, b.w);
                [b.i, b.j, b.k]
                    .iter()
                    .zip(a.v.0)
                    .for_each(|(b, a)| near(a, *b));
            }
            let rate = small_turn_rate(Vec3(u.into()), Vec3(w.into()));
            let back = both.back(Vec3(x.into()));
            for i in 0..3 {
                near(rate[i], rotation_vector_rate(&u, &w)[i]);
                near(back[i], product.inverse_transform_vector(&x)[i]);
            }
        }
    }
}
