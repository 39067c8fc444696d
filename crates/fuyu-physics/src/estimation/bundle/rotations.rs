//! Functions on the rotation group: Jacobians of the exponential map, nearest rotation, rotation between rays.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// The right Jacobian of the exponential map: `exp([u + δ]×) = exp([u]×) exp([J δ]×)` to first order.
pub fn right_jacobian(u: &Vector3<f64>) -> Matrix3<f64> {
    let square = u.norm_squared();
    let (a, b) = if square < 1e-4 {
        (0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0)
    } else {
        let angle = square.sqrt();
        (
            (1.0 - angle.cos()) / square,
            (angle - angle.sin()) / (square * angle),
        )
    };
    let cross = u.cross_matrix();
    Matrix3::identity() - cross * a + cross * cross * b
}

/// The inverse of [`right_jacobian`], for rotation vectors shorter than 2π.
pub fn right_jacobian_inverse(u: &Vector3<f64>) -> Matrix3<f64> {
    let columns = [Vector3::x(), Vector3::y(), Vector3::z()]
        .map(|axis| crate::spatial::rotation_vector_rate(u, &axis));
    Matrix3::from_columns(&columns)
}

/// The rotation nearest to a matrix; identity if the matrix has less than rank two.
pub fn nearest_rotation(m: &Matrix3<f64>) -> Rotation3<f64> {
    let Some(svd) = m.try_svd(true, true, 1e-15, 200) else {
        return Rotation3::identity();
    };
    let (Some(U), Some(Vt)) = (svd.u, svd.v_t) else {
        return Rotation3::identity();
    };
    let sign = (U.determinant() * Vt.determinant()).signum();
    let R = U * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * Vt;
    Rotation3::from_matrix_unchecked(R)
}

/// The rotation that best takes the first ray of each pair to the second; pairs with errors above `scale` lose weight.
pub fn rotation_between_rays(pairs: &[(Vector3<f64>, Vector3<f64>)], scale: f64) -> Rotation3<f64> {
    let mut R = Rotation3::identity();
    let mut weights = vec![1.0; pairs.len()];
    // The width of the weights starts large and shrinks, so that only the pairs that agree keep their weight.
    for round in 0..8 {
        let mut sum = Matrix3::zeros();
        for ((x, y), w) in pairs.iter().zip(&weights) {
            sum += y.normalize() * x.normalize().transpose() * *w;
        }
        R = nearest_rotation(&sum);
        let width = scale * f64::powi(2.0, 6 - round).max(1.0);
        for ((x, y), w) in pairs.iter().zip(&mut weights) {
            let off = (R * x.normalize() - y.normalize()).norm() / width;
            *w = 1.0 / (1.0 + off * off);
        }
    }
    R
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::exp_so3;

    #[test]
    fn the_right_jacobian_matches_finite_differences() {
        for size in [1e-9, 5e-3, 0.02, 1.0, 2.8] {
            let u = Vector3::new(0.6, -0.64, 0.48) * size;
            let J = right_jacobian(&u);
            assert!((J * right_jacobian_inverse(&u) - Matrix3::identity()).norm() < 1e-9);
            for k in 0..3 {
                let h = Vector3::ith(k, 1e-6);
                let numeric = ((exp_so3(&u).inverse() * exp_so3(&(u + h))).scaled_axis()
                    - (exp_so3(&u).inverse() * exp_so3(&(u - h))).scaled_axis())
                    / 2e-6;
                assert!((numeric - J.column(k)).norm() < 1e-8, "{size}");
            }
        }
    }

    #[test]
    fn the_nearest_rotation_of_a_reflected_rotation_is_proper() {
        let R = Rotation3::from_scaled_axis(Vector3::new(0.3, 0.9, -0.4));
        assert!((nearest_rotation(&(R.matrix() * 3.0)).matrix() - R.matrix()).norm() < 1e-14);
        let mirrored = nearest_rotation(&-R.matrix());
        assert!((mirrored.matrix().determinant() - 1.0).abs() < 1e-14);
    }
}
