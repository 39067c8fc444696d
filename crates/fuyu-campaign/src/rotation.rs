//! Directions and rotations. Quaternions are x, y, z, w.

use std::f64::consts::{PI, TAU};

/// A direction from two numbers of (0, 1), uniform on the unit sphere: its z coordinate is uniform (Archimedes).
pub fn on_sphere([u, v]: [f64; 2]) -> [f64; 3] {
    let z = 2.0 * u - 1.0;
    let r = libm::sqrt((1.0 - z * z).max(0.0));
    let angle = TAU * v;
    [r * libm::cos(angle), r * libm::sin(angle), z]
}

/// A rotation from three numbers of (0, 1), uniform on the rotation group: Shoemake 1992, "Uniform random rotations",
/// Graphics Gems III.
pub fn uniform_rotation([u, v, w]: [f64; 3]) -> [f64; 4] {
    let (r1, r2) = (libm::sqrt(1.0 - u), libm::sqrt(u));
    let (a, b) = (TAU * v, TAU * w);
    [
        r1 * libm::sin(a),
        r1 * libm::cos(a),
        r2 * libm::sin(b),
        r2 * libm::cos(b),
    ]
}

/// A rotation from three numbers of (0, 1), uniform among those by at most `largest` \[rad\]: the axis is uniform on
/// the sphere, the angle has the density 1 - cos of the uniform distribution on the group (Miles 1965, "On random rotations in R³").
pub fn rotation_within(u: [f64; 3], largest: f64) -> [f64; 4] {
    let share = |angle: f64| angle - libm::sin(angle);
    let wanted = u[0] * share(largest.min(PI));
    // The share grows with the angle: bisection, to the last bit.
    let (mut low, mut high) = (0.0, largest.min(PI));
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        match share(middle) < wanted {
            true => low = middle,
            false => high = middle,
        }
    }
    let axis = on_sphere([u[1], u[2]]);
    rotation_from_vector(axis.map(|x| x * high))
}

/// The rotation about a vector by its length \[rad\].
pub fn rotation_from_vector(turn: [f64; 3]) -> [f64; 4] {
    let angle = libm::sqrt(turn.iter().map(|x| x * x).sum());
    // sin(a/2) / a
    let scale = match angle < 1e-8 {
        true => 0.5,
        false => libm::sin(0.5 * angle) / angle,
    };
    let [x, y, z] = turn.map(|x| x * scale);
    [x, y, z, libm::cos(0.5 * angle)]
}

/// The product of two rotations, of unit length: the second one is about axes that the first one has turned.
pub fn compose(p: [f64; 4], q: [f64; 4]) -> [f64; 4] {
    let [x, y, z, w] = p;
    let [a, b, c, d] = q;
    let product = [
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    ];
    let length = libm::sqrt(product.iter().map(|x| x * x).sum());
    product.map(|x| x / length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Design, Sampling};

    const N: u64 = 40_000;

    fn points() -> Vec<[f64; 3]> {
        let design = Design::new(Sampling::Random, 8, N, &["a", "b", "c"]).unwrap();
        (0..N)
            .map(|run| std::array::from_fn(|c| design.coordinate(run, c)))
            .collect()
    }

    /// Rotation matrix of a quaternion, by its definition.
    fn matrix([x, y, z, w]: [f64; 4]) -> [[f64; 3]; 3] {
        [
            [
                1.0 - 2.0 * (y * y + z * z),
                2.0 * (x * y - w * z),
                2.0 * (x * z + w * y),
            ],
            [
                2.0 * (x * y + w * z),
                1.0 - 2.0 * (x * x + z * z),
                2.0 * (y * z - w * x),
            ],
            [
                2.0 * (x * z - w * y),
                2.0 * (y * z + w * x),
                1.0 - 2.0 * (x * x + y * y),
            ],
        ]
    }

    fn distance(mut sample: Vec<f64>, cdf: impl Fn(f64) -> f64) -> f64 {
        sample.sort_by(f64::total_cmp);
        let n = sample.len() as f64;
        let gaps = sample
            .iter()
            .enumerate()
            .map(|(i, x)| (cdf(*x) - (i as f64 + 0.5) / n).abs());
        gaps.fold(0.0, f64::max) * n.sqrt()
    }

    // Every coordinate of a uniform direction is uniform.
    #[test]
    fn directions_are_uniform() {
        let directions: Vec<_> = points().iter().map(|u| on_sphere([u[0], u[1]])).collect();
        for i in 0..3 {
            let sample = directions.iter().map(|d| d[i]).collect();
            assert!(distance(sample, |x| (x + 1.0) / 2.0) < 1.95, "{i}");
        }
        let length = |d: &[f64; 3]| d.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!(directions.iter().all(|d| (length(d) - 1.0).abs() < 1e-15));
    }

    // Each column of the matrix is a uniform direction, and the angle has the density (1 - cos) / pi.
    #[test]
    fn rotations_are_uniform() {
        let rotations: Vec<_> = points().into_iter().map(uniform_rotation).collect();
        for (row, column) in [(0, 0), (1, 0), (2, 1), (1, 2)] {
            let sample = rotations.iter().map(|q| matrix(*q)[row][column]).collect();
            assert!(
                distance(sample, |x| (x + 1.0) / 2.0) < 1.95,
                "{row} {column}"
            );
        }
        let angles = rotations
            .iter()
            .map(|q| 2.0 * q[3].abs().min(1.0).acos())
            .collect();
        assert!(distance(angles, |a| (a - a.sin()) / PI) < 1.95);
    }

    #[test]
    fn rotations_within_an_angle() {
        for largest in [0.1f64, 1.0, PI] {
            let rotations: Vec<_> = points()
                .into_iter()
                .map(|u| rotation_within(u, largest))
                .collect();
            let angle = |q: &[f64; 4]| {
                2.0 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
                    .sqrt()
                    .min(1.0)
                    .asin()
            };
            let angles: Vec<_> = rotations.iter().map(angle).collect();
            assert!(angles.iter().all(|a| *a <= largest * (1.0 + 1e-12)));
            let share = |a: f64| (a - a.sin()) / (largest - largest.sin());
            assert!(distance(angles, share) < 1.95, "{largest}");
            let z = rotations.iter().map(|q| q[2] / (1.0 - q[3] * q[3]).sqrt());
            assert!(distance(z.collect(), |z| (z + 1.0) / 2.0) < 1.95);
        }
    }

    #[test]
    fn composition_is_that_of_matrices() {
        let (p, q) = (
            uniform_rotation([0.2, 0.3, 0.4]),
            uniform_rotation([0.7, 0.1, 0.9]),
        );
        let (P, Q, product) = (matrix(p), matrix(q), matrix(compose(p, q)));
        for i in 0..3 {
            for j in 0..3 {
                let sum: f64 = (0..3).map(|k| P[i][k] * Q[k][j]).sum();
                assert!((product[i][j] - sum).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn a_rotation_about_a_vector() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let q = rotation_from_vector([0.0, 0.0, PI / 2.0]);
        assert!((q[2] - half).abs() < 1e-15 && (q[3] - half).abs() < 1e-15);
        assert_eq!(rotation_from_vector([0.0; 3]), [0.0, 0.0, 0.0, 1.0]);
    }
}
