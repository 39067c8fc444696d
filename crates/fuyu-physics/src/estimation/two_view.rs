//! Motion of a rigid body between two views: rotation and direction of translation from at least eight points, by
//! linear least squares. Masutani 1995 app. A, after Weng, Huang and Ahuja.

use nalgebra::{
    Matrix2, Matrix3, Matrix4, Rotation3, SMatrix, SVector, SymmetricEigen, UnitQuaternion,
    UnitVector3, Vector2, Vector3,
};

use crate::vision::{FeatureFrame, Pinhole};

/// Least number of points that determine the motion: the essential matrix has eight unknown ratios.
pub const MIN_POINTS: usize = 8;

/// Image points are collinear if their scatter across a line is less than this fraction of that along the line: one
/// pixel in two hundred.
const COLLINEAR: f64 = 5e-3;

/// A view is constant if no ray moves by more than this \[rad\].
const CONSTANT: f64 = 1e-9;

/// Motion between two views, eq. (2.1): a point at `x` in the first view is at `x' = R x + T` in the second,
/// both in the camera's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoViewMotion {
    /// Rotation `R`.
    pub R: Rotation3<f64>,
    /// Direction of the translation `T`; its length is not observable. Without translation (a body that turns about the
    /// optical axis) the direction is arbitrary, while `R` is still valid.
    pub direction: UnitVector3<f64>,
}

/// Why two views do not determine the motion.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TwoViewError {
    /// Too few common points.
    #[error("the two views have {0} points in common; at least {MIN_POINTS} are needed")]
    TooFewPoints(usize),
    /// A ray is NaN or infinite.
    #[error("point {0} of the two views is not finite")]
    NotFinite(usize),
    /// The points are on a line in one of the views.
    #[error("the points lie on a line in the image; they must spread in two directions")]
    Collinear,
    /// No point moved.
    #[error("the two views are the same: no point moved")]
    Constant,
}

/// Rays (z = 1) of the points that two frames share, in the first and in the second frame.
pub fn common_rays(
    camera: &Pinhole,
    first: &FeatureFrame,
    second: &FeatureFrame,
) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let rays = |(a, b): (&crate::vision::Feature, &crate::vision::Feature)| {
        (camera.ray(a.u, a.v), camera.ray(b.u, b.v))
    };
    first.common(second).map(rays).collect()
}

/// The motion between two views from the `rays` (z = 1) of their common points in the first and in the second view.
///
/// # Errors
/// [`TwoViewError`] if the points do not determine the motion.
pub fn two_view_motion(
    rays: &[(Vector3<f64>, Vector3<f64>)],
) -> Result<TwoViewMotion, TwoViewError> {
    check(rays)?;
    let E = essential_matrix(rays);
    // Direction of translation, up to its sign: the null direction of Eᵀ.
    let eigen = SymmetricEigen::new(E * E.transpose());
    let mut T: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
    // (A.10): the points determine the sign of E = [T×] R.
    let agreement: f64 = rays.iter().map(|(x, y)| T.cross(y).dot(&(E * x))).sum();
    if agreement < 0.0 {
        T = -T;
    }
    let R = nearest_rotation(&rotation_from_essential(&E, &T));
    let motion = TwoViewMotion {
        R,
        direction: UnitVector3::new_normalize(T),
    };
    // Points are in front of the camera in both views: this determines the sign of T.
    let in_front: f64 = rays
        .iter()
        .map(|(x, y)| {
            motion
                .depths(x, y)
                .map_or(0.0, |(a, b)| a.signum() + b.signum())
        })
        .sum();
    Ok(if in_front < 0.0 {
        TwoViewMotion {
            direction: -motion.direction,
            ..motion
        }
    } else {
        motion
    })
}

impl TwoViewMotion {
    /// Depths of a point in the first and in the second view, in units of the translation's length, from its
    /// rays (z = 1) there; eq. (2.2). `None` if the rays are parallel.
    pub fn depths(&self, first: &Vector3<f64>, second: &Vector3<f64>) -> Option<(f64, f64)> {
        let turned = self.R * first;
        let normal = turned.cross(second);
        let squared = normal.norm_squared();
        (squared > 0.0).then(|| {
            let T = self.direction.into_inner();
            let first = T.cross(second).dot(&-normal) / squared;
            let second = T.cross(&turned).dot(&-normal) / squared;
            (first, second)
        })
    }
}

fn check(rays: &[(Vector3<f64>, Vector3<f64>)]) -> Result<(), TwoViewError> {
    if rays.len() < MIN_POINTS {
        return Err(TwoViewError::TooFewPoints(rays.len()));
    }
    let bad = |(x, y): &(Vector3<f64>, Vector3<f64>)| !(x + y).iter().all(|c| c.is_finite());
    if let Some(at) = rays.iter().position(bad) {
        return Err(TwoViewError::NotFinite(at));
    }
    if rays.iter().all(|(x, y)| (x - y).amax() < CONSTANT) {
        return Err(TwoViewError::Constant);
    }
    if on_a_line(rays.iter().map(|(x, _)| x)) || on_a_line(rays.iter().map(|(_, y)| y)) {
        return Err(TwoViewError::Collinear);
    }
    Ok(())
}

fn on_a_line<'a>(points: impl Iterator<Item = &'a Vector3<f64>> + Clone) -> bool {
    let count = points.clone().count() as f64;
    let mean = points.clone().map(|p| p.xy()).sum::<Vector2<f64>>() / count;
    let scatter: Matrix2<f64> = points
        .map(|p| (p.xy() - mean) * (p.xy() - mean).transpose())
        .sum();
    let spread = SymmetricEigen::new(scatter)
        .eigenvalues
        .map(|s| s.max(0.0).sqrt());
    spread.min() <= COLLINEAR * spread.max()
}

/// The essential matrix with norm √2, up to its sign: the unit vector h with the least |A h|, (A.7)-(A.9).
/// The print fills E by rows; (A.7) has the entries by columns.
fn essential_matrix(rays: &[(Vector3<f64>, Vector3<f64>)]) -> Matrix3<f64> {
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (x, y) in rays {
        let row = SVector::<f64, 9>::from_iterator((y * x.transpose()).iter().copied());
        normal.ger(1.0, &row, &row, 1.0);
    }
    let eigen = SymmetricEigen::new(normal);
    let h = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    Matrix3::from_iterator(h.iter().map(|h| h * 2f64.sqrt()))
}

/// (A.11): without noise this is the rotation itself.
fn rotation_from_essential(E: &Matrix3<f64>, T: &Vector3<f64>) -> Matrix3<f64> {
    let e = |i: usize| Vector3::from(E.column(i));
    let column = |i: usize, j: usize, k: usize| e(i).cross(T) + e(j).cross(&e(k));
    Matrix3::from_columns(&[column(0, 1, 2), column(1, 2, 0), column(2, 0, 1)])
}

/// The rotation nearest to `W`: the unit quaternion q with the least qᵀ B q, (A.12)-(A.15). The print has
/// I - W in the lower left of (A.13), which would invert the rotation.
fn nearest_rotation(W: &Matrix3<f64>) -> Rotation3<f64> {
    let mut B = Matrix4::zeros();
    for i in 0..3 {
        let (unit, w) = (Vector3::ith(i, 1.0), Vector3::from(W.column(i)));
        let mut Bi = Matrix4::zeros();
        Bi.fixed_view_mut::<1, 3>(0, 1)
            .copy_from(&(unit - w).transpose());
        Bi.fixed_view_mut::<3, 1>(1, 0).copy_from(&(w - unit));
        Bi.fixed_view_mut::<3, 3>(1, 1)
            .copy_from(&(w + unit).cross_matrix());
        B += Bi.transpose() * Bi;
    }
    let eigen = SymmetricEigen::new(B);
    let q = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    UnitQuaternion::new_normalize(nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]))
        .to_rotation_matrix()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on and in a ball before the camera, seen before and after `R`, `T`.
    fn views(R: &Rotation3<f64>, T: &Vector3<f64>) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let points = (0..12).map(|i| {
            let a = f64::from(i);
            let p = Vector3::new((2.1 * a).sin(), (3.7 * a).cos(), (1.3 * a + 0.4).sin());
            p * 0.25 + Vector3::new(0.05, -0.1, 1.0)
        });
        let ray = |p: Vector3<f64>| p / p.z;
        points.map(|x| (ray(x), ray(R * x + T))).collect()
    }

    #[test]
    fn exact_views_give_the_motion_exactly() {
        for (axis, T) in [
            (Vector3::new(0.3, -0.2, 0.4), Vector3::new(0.1, 0.05, -0.02)),
            (Vector3::new(-0.05, 0.5, 0.1), Vector3::new(-0.3, 0.1, 0.2)),
            (Vector3::new(0.0, 0.01, 0.0), Vector3::new(0.01, 0.0, 0.0)),
        ] {
            let R = Rotation3::new(axis);
            let motion = two_view_motion(&views(&R, &T)).unwrap();
            let wrong = (motion.R.matrix() - R.matrix()).norm();
            assert!(wrong < 1e-9, "{wrong}");
            // A wrong sign in (A.10) or of the depths would reverse the direction.
            assert!((motion.direction.into_inner() - T.normalize()).norm() < 1e-7);
            let (x, y) = views(&R, &T)[3];
            let (near, far) = motion.depths(&x, &y).unwrap();
            let length = T.norm();
            assert!((R * x * near * length + T - y * far * length).norm() < 1e-7);
        }
    }

    #[test]
    fn rotation_is_found_without_translation() {
        // About the optical axis through the camera: the geometry of Masutani 1995 ch. 3.
        let R = Rotation3::new(Vector3::new(0.0, 0.0, 0.5));
        let motion = two_view_motion(&views(&R, &Vector3::zeros())).unwrap();
        assert!((motion.R.matrix() - R.matrix()).norm() < 1e-9);
    }

    #[test]
    fn views_that_do_not_determine_the_motion_are_refused() {
        let R = Rotation3::new(Vector3::new(0.3, -0.2, 0.4));
        let T = Vector3::new(0.1, 0.0, 0.0);
        let good = views(&R, &T);
        assert_eq!(
            two_view_motion(&good[..7]),
            Err(TwoViewError::TooFewPoints(7))
        );
        assert_eq!(two_view_motion(&[]), Err(TwoViewError::TooFewPoints(0)));
        let same: Vec<_> = good.iter().map(|(x, _)| (*x, *x)).collect();
        assert_eq!(two_view_motion(&same), Err(TwoViewError::Constant));
        let mut nan = good.clone();
        nan[5].1.x = f64::NAN;
        assert_eq!(two_view_motion(&nan), Err(TwoViewError::NotFinite(5)));
        // A line in space is a line in both images, up to rounding to pixels.
        let line = (0..10)
            .map(|i| Vector3::new(0.05, 0.1, 1.0) + Vector3::new(0.04, 0.03, 0.02) * f64::from(i));
        let ray = |p: Vector3<f64>| {
            let pixel = |x: f64| (x / p.z * 800.0).round() / 800.0;
            Vector3::new(pixel(p.x), pixel(p.y), 1.0)
        };
        let line: Vec<_> = line.map(|x| (ray(x), ray(R * x + T))).collect();
        assert_eq!(two_view_motion(&line), Err(TwoViewError::Collinear));
    }
}
