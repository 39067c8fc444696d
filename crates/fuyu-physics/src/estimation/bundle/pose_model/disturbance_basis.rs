//! Sensitivities of the attitude to small disturbances: angular acceleration of the body, and errors of the camera's
//! gyro.

use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

use super::super::free_motion::{FreeMotion, Sensitivity};

/// Sensitivity of rotation (body axes) and impulse (inertial axes) at a time to `K` angular accelerations ("acceleration_histories").
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response<const K: usize> {
    /// Rotation by the amplitude of each course \[s²\].
    pub turn: [Matrix3<f64>; K],
    /// Impulse since the reference time by the amplitude of each course \[s\].
    pub impulse: [Matrix3<f64>; K],
}

/// First-order responses of `motion` at ascending `times` to angular accelerations. `course` gives the time history of
/// each: at a time and an attitude, the acceleration in inertial axes as a matrix times its three amplitudes.
/// `attitudes` are the attitudes of the motion at `times`, with sensitivities.
///
/// An impulse `δL` at `s` rotates the body at `t` by `B(t, s) δL = (B(t) - A(t) A(s)⁻¹ B(s)) δL`, where `A(t)` and
/// `B(t)` are the derivatives of the rotation at `t` by rotation and momentum at the reference time. The integral
/// over `s` is a trapezoidal sum between the times.
pub fn responses<const K: usize>(
    motion: &FreeMotion,
    times: &[f64],
    attitudes: &[(UnitQuaternion<f64>, Sensitivity)],
    course: impl Fn(f64, &Matrix3<f64>) -> [Matrix3<f64>; K],
) -> Vec<Response<K>> {
    let zero = Response {
        turn: [Matrix3::zeros(); K],
        impulse: [Matrix3::zeros(); K],
    };
    let mut out = vec![zero; times.len()];
    let split = times.partition_point(|t| *t < motion.time);
    let by_turn = motion.shape_by_turn();
    let mut walk = |order: &mut dyn Iterator<Item = usize>| {
        // Integrals of A⁻¹ B times the acceleration_histories and of the acceleration_histories; A⁻¹ B and the attitude at the previous time.
        let (mut sum, mut impulse) = ([Matrix3::zeros(); K], [Matrix3::zeros(); K]);
        let (mut before, mut last) = (Matrix3::zeros(), motion.time);
        let mut R_before = *motion.R_WB.to_rotation_matrix().matrix();
        for i in order {
            let (R_WB, S) = &attitudes[i];
            let R = *R_WB.to_rotation_matrix().matrix();
            let A = Matrix3::identity() + S.fixed_columns::<5>(0) * by_turn;
            let B = S.fixed_columns::<3>(5).into_owned();
            let now = A.try_inverse().map_or(before, |inverse| inverse * B);
            let step = times[i] - last;
            let middle = last + 0.5 * step;
            let (from, to) = (course(middle, &R_before), course(middle, &R));
            for k in 0..K {
                sum[k] += (before * from[k] + now * to[k]) * (0.5 * step);
                impulse[k] += (from[k] + to[k]) * (0.5 * step);
                out[i].turn[k] = B * impulse[k] - A * sum[k];
            }
            out[i].impulse = impulse;
            (before, last, R_before) = (now, times[i], R);
        }
    };
    walk(&mut (split..times.len()));
    walk(&mut (0..split).rev());
    out
}

/// Number of intervals of the gyro's random walk.
pub const INTERVALS: usize = 12;

/// Number of unknowns of the gyro's error: bias, and the random walk's increments.
pub const GYRO: usize = 3 + 3 * INTERVALS;

/// Sensitivity of the error of the camera's attitude (inertial axes) to bias and random-walk increments, at each time;
/// zero at the last time. The attitude is `exp(error) R_WC`. `noise` is the random walk \[rad/√s\] and `bias` the bias
/// \[rad/s\] of one unit.
pub fn gyro_error(
    times: &[f64],
    R_WC: &[UnitQuaternion<f64>],
    noise: f64,
    bias: f64,
) -> Vec<SMatrix<f64, 3, GYRO>> {
    let mut out = vec![SMatrix::<f64, 3, GYRO>::zeros(); times.len()];
    let (Some(first), Some(last)) = (times.first(), times.last()) else {
        return out;
    };
    let interval = ((last - first) / INTERVALS as f64).max(f64::MIN_POSITIVE);
    let increment = Matrix3::identity() * (noise * interval.sqrt());
    let mut sum = Matrix3::zeros();
    for i in (0..times.len()).rev() {
        if let Some(next) = times.get(i + 1) {
            let mean =
                R_WC[i].to_rotation_matrix().matrix() + R_WC[i + 1].to_rotation_matrix().matrix();
            sum -= mean * (0.5 * bias * (next - times[i]));
        }
        out[i].fixed_columns_mut::<3>(0).copy_from(&sum);
        for k in 0..INTERVALS {
            // Fraction of the interval that is still to come.
            let end = first + interval * (k + 1) as f64;
            let share = ((end - times[i]) / interval).clamp(0.0, 1.0);
            out[i]
                .fixed_columns_mut::<3>(3 + 3 * k)
                .copy_from(&(increment * -share));
        }
    }
    out
}

/// Legendre polynomials of degree 2 to 4, shifted to 0 to 1.
pub fn legendre(x: f64) -> [f64; 3] {
    [
        (6.0 * x - 6.0) * x + 1.0,
        ((20.0 * x - 30.0) * x + 12.0) * x - 1.0,
        (((70.0 * x - 140.0) * x + 90.0) * x - 20.0) * x + 1.0,
    ]
}

/// Position at `elapsed` seconds as a function of position and velocity at time zero, inertial axes, for relative
/// motion near a circular orbit with `rate` \[rad/s\] (Clohessy and Wiltshire 1960). `radial` is the direction from
/// the Earth at time zero, `normal` the orbit's normal.
pub fn clohessy_wiltshire(
    rate: f64,
    radial: &Vector3<f64>,
    normal: &Vector3<f64>,
    elapsed: f64,
) -> (Matrix3<f64>, Matrix3<f64>) {
    // Hill's frame H: x radial, z along the normal.
    let along = normal.cross(radial);
    let R_WH = Matrix3::from_columns(&[*radial, along, *normal]);
    let (s, c) = (rate * elapsed).sin_cos();
    let n = rate;
    #[rustfmt::skip]
    let by_position = Matrix3::new(
        4.0 - 3.0 * c, 0.0, 0.0,
        6.0 * (s - n * elapsed), 1.0, 0.0,
        0.0, 0.0, c,
    );
    #[rustfmt::skip]
    let by_velocity = Matrix3::new(
        s, 2.0 * (1.0 - c), 0.0,
        2.0 * (c - 1.0), 4.0 * s - 3.0 * n * elapsed, 0.0,
        0.0, 0.0, s,
    ) / n;
    // Velocity relative to the rotating frame: v - n z × r.
    let turning = Matrix3::new(0.0, -n, 0.0, n, 0.0, 0.0, 0.0, 0.0, 0.0);
    // The frame has turned by n t.
    let turned = R_WH * Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
    let back = R_WH.transpose();
    (
        turned * (by_position - by_velocity * turning) * back,
        turned * by_velocity * back,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SVector;

    /// Compares with torques that act as small impulses, each of which changes the momentum of the free motion from
    /// then on.
    #[test]
    fn responses_are_those_of_small_impulses() {
        let shape = SVector::<f64, 5>::new(0.3, -0.2, 0.1, 0.05, -0.15);
        let R = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.7, 1.1));
        let motion = FreeMotion::new(&shape, Vector3::new(0.1, -0.2, 0.15), 10.0, R).unwrap();
        let times: Vec<f64> = (0..=200).map(|i| 0.1 * f64::from(i)).collect();
        let attitudes = motion.attitudes_and_sensitivities(&times);
        let acceleration = Vector3::new(2e-5, -3e-5, 1e-5);
        // In inertial axes, and in body axes.
        let found = responses(&motion, &times, &attitudes, |_, R| {
            [Matrix3::identity(), *R]
        });
        for (kind, (end, sign)) in [
            (0, (200, 1.0)),
            (0, (0, -1.0)),
            (1, (200, 1.0)),
            (1, (0, -1.0)),
        ] {
            let mut disturbed = motion;
            for k in 1..=1000 {
                // The impulse acts in the middle of its step.
                let time = 10.0 + sign * (0.01 * f64::from(k) - 0.005);
                disturbed.R_WB = disturbed.attitudes(&[time])[0];
                disturbed.time = time;
                disturbed.momentum += match kind {
                    0 => acceleration,
                    _ => disturbed.R_WB * acceleration,
                } * (sign * 0.01);
            }
            let last = disturbed.attitudes(&[times[end]])[0];
            let turn = (attitudes[end].0.inverse() * last).scaled_axis();
            let expected = found[end].turn[kind] * acceleration;
            assert!(
                (turn - expected).norm() < 2e-2 * turn.norm(),
                "{kind} {end}: {turn} {expected}"
            );
            let impulse = disturbed.momentum - motion.momentum;
            let expected = found[end].impulse[kind] * acceleration;
            assert!(
                (impulse - expected).norm() < 2e-3 * impulse.norm(),
                "{kind} {end}: {impulse} {expected}"
            );
        }
    }

    /// Newton's law with the gradient of gravity, integrated by Euler's method in small steps.
    #[test]
    fn relative_orbits_obey_the_gravity_gradient() {
        let (radial, normal) = (Vector3::new(0.6, 0.8, 0.0), Vector3::z());
        let rate = 0.01;
        let (r0, v0) = (
            Vector3::new(3.0, -5.0, 8.0),
            Vector3::new(0.02, 0.03, -0.01),
        );
        let (mut r, mut v) = (r0, v0);
        let h = 1e-3;
        for k in 0..100_000 {
            let angle = rate * h * (f64::from(k) + 0.5);
            let up = radial * angle.cos() + normal.cross(&radial) * angle.sin();
            r += v * (0.5 * h);
            v += (up * (3.0 * up.dot(&r)) - r) * (rate * rate * h);
            r += v * (0.5 * h);
        }
        let (A, B) = clohessy_wiltshire(rate, &radial, &normal, 100.0);
        assert!(
            (A * r0 + B * v0 - r).norm() < 1e-5,
            "{}",
            A * r0 + B * v0 - r
        );
    }
}
