//! The rotation group: exponential map, its inverse differential, and the attitude angles of the thesis.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// `exp([u×])` as a unit quaternion, accurate down to `u = 0`.
#[inline]
pub fn exp_so3(u: &Vector3<f64>) -> UnitQuaternion<f64> {
    let half_sq = 0.25 * u.norm_squared();
    // sin(x)/x and cos(x) at x = |u|/2; the series is exact to rounding below x = 1e-2.
    let (c, s) = if half_sq < 1e-4 {
        let x = half_sq;
        (
            1.0 - x / 2.0 * (1.0 - x / 12.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0))),
            1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0))),
        )
    } else {
        let x = half_sq.sqrt();
        (x.cos(), x.sin() / x)
    };
    let v = u * (0.5 * s);
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::from_parts(c, v))
}

/// The same attitudes as a continuous sequence of quaternions: of `q` and `-q`, which are the same attitude, the one
/// closer to its predecessor.
pub fn unwound(
    attitudes: impl Iterator<Item = UnitQuaternion<f64>>,
) -> impl Iterator<Item = UnitQuaternion<f64>> {
    attitudes.scan(None, |before, q| {
        let opposite = before.is_some_and(|b: UnitQuaternion<f64>| b.coords.dot(&q.coords) < 0.0);
        let q = match opposite {
            true => UnitQuaternion::new_unchecked(-q.into_inner()),
            false => q,
        };
        *before = Some(q);
        Some(q)
    })
}

/// Rate `u'` of the exponential coordinates of `R(t) = R0 exp([u×])` at body-frame angular velocity `w` (`R' = R
/// [w×]`): the inverse right differential of the exponential, `u' = w + ½ u × w + (1 - (θ/2) cot(θ/2))/θ² u × (u × w)`,
/// `θ = |u|`.
///
/// With it, any Runge-Kutta tableau integrates attitude on the rotation group (Munthe-Kaas). Valid for `θ < 2π`; `θ` is the
/// angle of rotation within one integration step.
#[inline]
pub fn rotation_vector_rate(u: &Vector3<f64>, w: &Vector3<f64>) -> Vector3<f64> {
    let th2 = u.norm_squared();
    let k = if th2 < 1e-2 {
        // (1 - x cot x)/(4x²) at x = θ/2: 1/12 + θ²/720 + θ⁴/30240 + θ⁶/1209600 + ...
        1.0 / 12.0
            + th2
                * (1.0 / 720.0
                    + th2 * (1.0 / 30240.0 + th2 * (1.0 / 1_209_600.0 + th2 / 47_900_160.0)))
    } else {
        let half = 0.5 * th2.sqrt();
        (1.0 - half / half.tan()) / th2
    };
    let uw = u.cross(w);
    w + uw * 0.5 + u.cross(&uw) * k
}

/// Rotation `R_WB` from the thesis's attitude angles: rotate by roll about x, then by pitch about the
/// new y, then by yaw about the new z, `R_WB = Rx(φ) Ry(θ) Rz(ψ)`.
///
/// Masutani 1995 eq. (F.1), whose entry (3,1) is a misprint for `sin φ sin ψ - cos φ sin θ cos ψ`.
pub fn rotation_from_roll_pitch_yaw_intrinsic(roll: f64, pitch: f64, yaw: f64) -> Rotation3<f64> {
    let (sf, cf) = roll.sin_cos();
    let (st, ct) = pitch.sin_cos();
    let (sp, cp) = yaw.sin_cos();
    #[rustfmt::skip]
    let m = Matrix3::new(
        ct * cp,                 -ct * sp,                 st,
        cf * sp + sf * st * cp,  cf * cp - sf * st * sp,  -sf * ct,
        sf * sp - cf * st * cp,  sf * cp + cf * st * sp,   cf * ct,
    );
    Rotation3::from_matrix_unchecked(m)
}

/// The thesis's attitude angles (roll, pitch, yaw) \[rad\] of `R_WB`; inverse of
/// [`rotation_from_roll_pitch_yaw_intrinsic`], pitch in [-π/2, π/2]. Masutani 1995 app. F.
///
/// At pitch = ±π/2 roll and yaw are not unique; yaw is then reported as zero.
pub fn roll_pitch_yaw_intrinsic(R_WB: &Rotation3<f64>) -> [f64; 3] {
    let m = R_WB.matrix();
    let cos_pitch = m[(0, 0)].hypot(m[(0, 1)]);
    let pitch = m[(0, 2)].atan2(cos_pitch);
    if cos_pitch < 1e-12 {
        [m[(2, 1)].atan2(m[(1, 1)]), pitch, 0.0]
    } else {
        [
            (-m[(1, 2)]).atan2(m[(2, 2)]),
            pitch,
            (-m[(0, 1)]).atan2(m[(0, 0)]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_agrees_with_nalgebra_and_stays_unit() {
        for scale in [1e-12, 1e-3, 0.019, 0.021, 0.5, 3.0] {
            let u = Vector3::new(0.6, -0.3, 0.74) * scale;
            let q = exp_so3(&u);
            assert!((q.norm() - 1.0).abs() < 4e-16, "{scale}");
            assert!(q.angle_to(&UnitQuaternion::from_scaled_axis(u)) < 1e-15 + 1e-15 * scale);
        }
    }

    #[test]
    fn attitude_rate_is_the_derivative_of_the_logarithm() {
        let w = Vector3::new(0.3, -0.8, 0.5);
        for scale in [0.0, 1e-3, 0.09, 0.11, 1.0, 2.5] {
            let u = Vector3::new(0.6, -0.3, 0.74) * scale;
            let log = |t: f64| (exp_so3(&u) * exp_so3(&(w * t))).scaled_axis();
            let h = 1e-5;
            let fd = (log(h) - log(-h)) / (2.0 * h);
            assert!(
                (fd - rotation_vector_rate(&u, &w)).norm() < 2e-10,
                "{scale}"
            );
        }
    }

    #[test]
    fn attitude_rate_is_smooth_where_the_series_ends() {
        let w = Vector3::new(0.3, -0.8, 0.5);
        let at = |th: f64| rotation_vector_rate(&(Vector3::new(0.6, 0.0, 0.8) * th), &w);
        assert!((at(0.1 - 1e-9) - at(0.1 + 1e-9)).norm() < 2e-9);
    }

    #[test]
    fn unwound_quaternions_are_continuous_and_the_same_attitudes() {
        // From a matrix, the real part is never negative: it jumps at half a turn.
        let turned = |k: u32| Rotation3::from_axis_angle(&Vector3::y_axis(), 0.3 * f64::from(k));
        let wound = || (0..100).map(|k| UnitQuaternion::from_rotation_matrix(&turned(k)));
        let apart = |q: Vec<UnitQuaternion<f64>>| {
            let steps = q.windows(2).map(|w| (w[1].coords - w[0].coords).norm());
            steps.fold(0.0, f64::max)
        };
        assert!(apart(wound().collect()) > 1.0);
        let unwound: Vec<_> = unwound(wound()).collect();
        assert!(apart(unwound.clone()) < 0.16);
        for (a, b) in wound().zip(&unwound) {
            assert!(a.angle_to(b) < 1e-7);
        }
    }

    #[test]
    fn angles_round_trip_and_rotate_about_the_named_axes() {
        for a in [[0.3, -0.7, 1.9], [-2.9, 1.5, -3.0], [0.0, 0.0, 0.0]] {
            let r = rotation_from_roll_pitch_yaw_intrinsic(a[0], a[1], a[2]);
            let b = roll_pitch_yaw_intrinsic(&r);
            assert!(
                a.iter().zip(&b).all(|(x, y)| (x - y).abs() < 1e-14),
                "{a:?} {b:?}"
            );
            let product = Rotation3::from_axis_angle(&Vector3::x_axis(), a[0])
                * Rotation3::from_axis_angle(&Vector3::y_axis(), a[1])
                * Rotation3::from_axis_angle(&Vector3::z_axis(), a[2]);
            assert!((product.matrix() - r.matrix()).norm() < 1e-15);
        }
    }

    #[test]
    fn gimbal_lock_gives_angles_that_rebuild_the_rotation() {
        let r = rotation_from_roll_pitch_yaw_intrinsic(0.4, std::f64::consts::FRAC_PI_2, 0.9);
        let a = roll_pitch_yaw_intrinsic(&r);
        assert!(
            (rotation_from_roll_pitch_yaw_intrinsic(a[0], a[1], a[2]).matrix() - r.matrix()).norm()
                < 1e-14
        );
    }
}
