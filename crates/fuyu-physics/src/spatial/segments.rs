//! Closest points of segments.

use nalgebra::Vector3;

/// The closest points of two segments, either of which may be a point (C. Ericson, Real-Time Collision Detection, 2005,
/// section 5.1.9). For parallel segments, the middle of the part in which they overlap.
pub(crate) fn closest_points(
    first: &[Vector3<f64>; 2],
    second: &[Vector3<f64>; 2],
) -> [Vector3<f64>; 2] {
    let (d1, d2, r) = (
        first[1] - first[0],
        second[1] - second[0],
        first[0] - second[0],
    );
    let (a, e, f) = (d1.norm_squared(), d2.norm_squared(), d2.dot(&r));
    let (b, c) = (d1.dot(&d2), d1.dot(&r));
    let denominator = a * e - b * b;
    let mut s = if a == 0.0 {
        0.0
    } else if denominator > 1e-12 * a * e {
        ((b * f - c * e) / denominator).clamp(0.0, 1.0)
    } else {
        let ends = [-c / a, (b - c) / a];
        let (low, high) = (
            ends[0].min(ends[1]).clamp(0.0, 1.0),
            ends[0].max(ends[1]).clamp(0.0, 1.0),
        );
        0.5 * (low + high)
    };
    let t = if e > 0.0 { (b * s + f) / e } else { 0.0 };
    let clamped = t.clamp(0.0, 1.0);
    if t != clamped && a > 0.0 {
        s = ((b * clamped - c) / a).clamp(0.0, 1.0);
    }
    [first[0] + d1 * s, second[0] + d2 * clamped]
}

#[cfg(test)]
mod tests {
    use super::*;

    // By sampling both segments finely. Fails for parallel segments or points if these divide by zero.
    #[test]
    fn distances_of_segments_are_those_of_their_points() {
        let mut x = 0.37_f64;
        let mut next = || {
            x = (x * 997.13).fract();
            2.0 * x - 1.0
        };
        for k in 0..240 {
            let mut point = || Vector3::new(next(), next(), next());
            let (mut a, b, mut c) = (point(), point(), point());
            // Every sixth pair is parallel; some are points.
            let mut d = point();
            match k % 6 {
                0 => d = c + (b - a) * 0.7,
                1 => a = b,
                2 => c = d,
                3 => (a, c) = (b, d),
                _ => {}
            }
            let at = |i: i32| f64::from(i) / 200.0;
            let pairs = (0..=200).flat_map(|i| (0..=200).map(move |j| (i, j)));
            let sampled = pairs
                .map(|(i, j)| (a.lerp(&b, at(i)) - c.lerp(&d, at(j))).norm())
                .fold(f64::INFINITY, f64::min);
            let [p, q] = closest_points(&[a, b], &[c, d]);
            let found = (p - q).norm();
            assert!(
                found <= sampled + 1e-12 && found > sampled - 0.02,
                "{k}: {found} {sampled}"
            );
        }
    }
}
