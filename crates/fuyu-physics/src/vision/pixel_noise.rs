//! Accuracy of a pose fitted to image points.

use nalgebra::{Matrix2x3, Matrix6, Vector3, Vector6};

use crate::spatial::Pose;

/// Standard deviations of a measured pose, in camera axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseAccuracy {
    /// Standard deviation of each coordinate of the position \[m\]; z is the distance.
    pub position: Vector3<f64>,
    /// Standard deviation of each component of the small rotation \[rad\].
    pub attitude: Vector3<f64>,
}

impl PoseAccuracy {
    /// Accuracy of the pose `X_CD` of a frame D in the camera's optical frame, fitted to the images of `points`, which
    /// are known in D \[m\]. Each image coordinate has a standard deviation of `pixels` \[px\]; the focal length is
    /// `focal_length` \[px\].
    ///
    /// This is the Cramér-Rao bound, which a least-squares fit reaches for small noise: the inverse of the information
    /// `Σ Gᵀ G / σ²`, `G` being the derivative of the image point with respect to the pose. For `n` points around D's
    /// origin with a root mean square of `ρ` per coordinate, at a distance `Z` much larger than `ρ`, it is
    ///
    /// ```text
    /// across the line of sight   σ Z / (f √n)            distance   σ Z² / (f ρ √2n)
    /// rotation about it          σ Z / (f ρ √2n)         tilt       σ Z / (f ρ √n)
    /// ```
    ///
    /// `None` where the points do not determine the pose: fewer than three, on a line, or behind the camera.
    pub fn of_points(
        X_CD: &Pose,
        points: &[Vector3<f64>],
        focal_length: f64,
        pixels: f64,
    ) -> Option<Self> {
        let mut information = Matrix6::zeros();
        for p_D in points {
            let arm = X_CD.rotation * p_D;
            let p = X_CD.translation.vector + arm;
            if p.z <= 0.0 {
                return None;
            }
            #[rustfmt::skip]
            let by_point = Matrix2x3::new(
                1.0, 0.0, -p.x / p.z,
                0.0, 1.0, -p.y / p.z,
            ) * (focal_length / (pixels * p.z));
            for row in by_point.row_iter() {
                let (g, turn) = (row.transpose(), arm.cross(&row.transpose()));
                let g = Vector6::new(g.x, g.y, g.z, turn.x, turn.y, turn.z);
                information += g * g.transpose();
            }
        }
        let variance = information.cholesky()?.inverse().diagonal().map(f64::sqrt);
        let accuracy = Self {
            position: variance.fixed_rows::<3>(0).into(),
            attitude: variance.fixed_rows::<3>(3).into(),
        };
        let known = variance.iter().all(|s| s.is_finite());
        known.then_some(accuracy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::exp_so3;
    use nalgebra::{DMatrix, DVector, Rotation3, Translation3};
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    use rand_distr::StandardNormal;

    fn points() -> Vec<Vector3<f64>> {
        let mut random = StdRng::seed_from_u64(3);
        let mut normal = || random.sample::<f64, _>(StandardNormal);
        let mut points: Vec<_> = (0..20)
            .map(|_| Vector3::new(normal(), normal(), normal()) * 0.4)
            .collect();
        let mean = points.iter().sum::<Vector3<f64>>() / 20.0;
        points.iter_mut().for_each(|p| *p -= mean);
        points
    }

    fn image(X: &Pose, points: &[Vector3<f64>], f: f64) -> DVector<f64> {
        let seen = points.iter().flat_map(|p| {
            let p = X.rotation * p + X.translation.vector;
            [f * p.x / p.z, f * p.y / p.z]
        });
        DVector::from_iterator(2 * points.len(), seen)
    }

    fn moved(X: &Pose, by: &[f64]) -> Pose {
        let turn = exp_so3(&Vector3::from_column_slice(&by[3..]));
        Pose::from_parts(
            Translation3::from(X.translation.vector + Vector3::from_column_slice(&by[..3])),
            turn.to_rotation_matrix() * X.rotation,
        )
    }

    /// Gauss-Newton with a Jacobian by differences: shares nothing with the formula but the pinhole.
    fn fitted(start: &Pose, points: &[Vector3<f64>], f: f64, seen: &DVector<f64>) -> Pose {
        let mut X = *start;
        for _ in 0..4 {
            let h = 1e-6;
            let mut J = DMatrix::zeros(seen.len(), 6);
            for k in 0..6 {
                let mut by = [0.0; 6];
                by[k] = h;
                let ahead = image(&moved(&X, &by), points, f);
                by[k] = -h;
                J.set_column(
                    k,
                    &((ahead - image(&moved(&X, &by), points, f)) / (2.0 * h)),
                );
            }
            let off = seen - image(&X, points, f);
            let step = (J.transpose() * &J)
                .cholesky()
                .unwrap()
                .solve(&(J.transpose() * off));
            X = moved(&X, step.as_slice());
        }
        X
    }

    #[test]
    fn fits_to_noisy_points_scatter_as_stated() {
        let (points, f, pixels) = (points(), 1024.0, 1.0);
        let X = Pose::from_parts(
            Translation3::new(0.5, -0.3, 5.0),
            Rotation3::from_euler_angles(0.3, -0.5, 1.0),
        );
        let stated = PoseAccuracy::of_points(&X, &points, f, pixels).unwrap();
        let mut random = StdRng::seed_from_u64(1);
        let runs = 400;
        let mut squares = Vector6::<f64>::zeros();
        for _ in 0..runs {
            let noisy =
                image(&X, &points, f).map(|x| x + random.sample::<f64, _>(StandardNormal) * pixels);
            let found = fitted(&X, &points, f, &noisy);
            let p = found.translation.vector - X.translation.vector;
            let turn = (found.rotation * X.rotation.inverse()).scaled_axis();
            let off = Vector6::new(p.x, p.y, p.z, turn.x, turn.y, turn.z);
            squares += off.component_mul(&off);
        }
        let scatter = (squares / f64::from(runs)).map(f64::sqrt);
        for k in 0..3 {
            // 400 runs determine a deviation to 3.5 %.
            assert!(
                (scatter[k] / stated.position[k] - 1.0).abs() < 0.12,
                "{k}: {scatter} {stated:?}"
            );
            assert!(
                (scatter[k + 3] / stated.attitude[k] - 1.0).abs() < 0.12,
                "{k}"
            );
        }
        // The approximations in the doc comment, for a cloud without preferred direction.
        let (n, rho, Z) = (20.0, 0.4, 5.0);
        let distance = pixels * Z * Z / (f * rho * f64::sqrt(2.0 * n));
        assert!((stated.position.z / distance - 1.0).abs() < 0.3);
    }

    #[test]
    fn a_pose_that_the_points_do_not_determine_has_no_accuracy() {
        let X = Pose::from_parts(Translation3::new(0.0, 0.0, 5.0), Rotation3::identity());
        let line = [Vector3::x(), Vector3::zeros(), -Vector3::x()];
        assert_eq!(PoseAccuracy::of_points(&X, &line, 1024.0, 1.0), None);
        assert!(PoseAccuracy::of_points(&X, &points(), 1024.0, 1.0).is_some());
        let behind = Pose::from_parts(Translation3::new(0.0, 0.0, -5.0), Rotation3::identity());
        assert_eq!(
            PoseAccuracy::of_points(&behind, &points(), 1024.0, 1.0),
            None
        );
    }
}
