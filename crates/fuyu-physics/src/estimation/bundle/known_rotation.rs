//! Structure from known rotations, by linear least squares in points and translations.
//!
//! With `R` known, `f x = u z` for `x = R p + t` is linear in all `p` and `t` together, so no initial values are
//! needed. The weak prior on depths (see [`Scene`]) fixes the scale, and the depths that the images do not determine:
//! in a nearly pure rotation about the optical axis two views contain no depth.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::pose_model::FramePose;
use super::scene::{MIN_DEPTH, Scene, residual};
use super::schur::{FRAME, System};

/// Points and poses from the attitudes `R_CB` of all frames. `None` if the images do not determine them, or if the
/// points are far outside the scene.
pub fn structure(
    scene: &Scene,
    attitudes: &[UnitQuaternion<f64>],
    noise: f64,
) -> Option<(Vec<Vector3<f64>>, Vec<FramePose>)> {
    let mut points = vec![Vector3::zeros(); scene.points];
    let mut translations = vec![Vector3::z(); scene.len()];
    // The first round assumes depth one for all points; later rounds weight with the depths found and with Cauchy's
    // weights.
    for round in 0..6 {
        let mut system = System::<3, 1>::new(scene.points, 0);
        for (i, R_CB) in attitudes.iter().enumerate() {
            let R = *R_CB.to_rotation_matrix().matrix();
            // For frames whose only unknown is the translation.
            let mut H = SMatrix::<f64, FRAME, FRAME>::zeros();
            let mut g = SVector::<f64, FRAME>::zeros();
            let mut H_tt = Matrix3::identity() * 1e-9;
            for observation in scene.frame(i).iter().filter(|s| s.inlier) {
                let m = observation.pixel;
                let x = R * points[observation.point] + translations[i];
                let weight = if round == 0 {
                    1.0
                } else {
                    let off = residual(&scene.focal, &x, &m);
                    let width = noise * f64::from(40 >> round).max(3.0);
                    let loss =
                        off.map_or(1e-3, |r| 1.0 / (1.0 + r.norm_squared() / (width * width)));
                    loss.sqrt() / x.z.max(0.2)
                };
                // Ten times as strong as in the adjustment, but still weak compared with the images.
                let anchor = 10.0 * scene.anchor(observation.point);
                #[rustfmt::skip]
                let by_x = Matrix3::new(
                    weight * scene.focal.x, 0.0, -weight * m.x,
                    0.0, weight * scene.focal.y, -weight * m.y,
                    0.0, 0.0, anchor,
                );
                let r = by_x * x - Vector3::new(0.0, 0.0, anchor);
                let by_p = by_x * R;
                system.add_point(observation.point, &by_p.tr_mul(&by_p), &by_p.tr_mul(&r));
                let mut H_fp = SMatrix::<f64, FRAME, 3>::zeros();
                H_fp.fixed_rows_mut::<3>(3).copy_from(&by_x.tr_mul(&by_p));
                system.couple(observation.point, H_fp);
                H_tt += by_x.tr_mul(&by_x);
                let mut g_t = g.fixed_rows_mut::<3>(3);
                g_t += by_x.tr_mul(&r);
            }
            H.fixed_view_mut::<3, 3>(3, 3).copy_from(&H_tt);
            system.add_frame(H, g, &SMatrix::zeros());
        }
        // The system needs at least one common unknown; this one is unused.
        system.add_common(&SVector::<f64, 1>::repeat(1.0), &SVector::zeros());
        let step = system.step(1e-9)?;
        for (p, d) in points.iter_mut().zip(&step.points) {
            *p += d;
        }
        for (t, d) in translations.iter_mut().zip(&step.frames) {
            *t += d;
        }
    }
    let poses: Vec<_> = attitudes
        .iter()
        .zip(&translations)
        .map(|(&R_CB, &t_C)| FramePose { R_CB, t_C })
        .collect();
    let finite = points.iter().chain(&translations).all(|v| v.norm() < 1e3);
    finite.then_some((points, poses))
}

/// Marks observations of points behind the camera as outliers; returns the number of inliers.
pub fn drop_points_behind_camera(
    scene: &mut Scene,
    points: &[Vector3<f64>],
    poses: &[FramePose],
) -> usize {
    let mut inliers = 0;
    for (i, pose) in poses.iter().enumerate() {
        for observation in scene.frame_mut(i) {
            let x = pose.R_CB * points[observation.point] + pose.t_C;
            observation.inlier &= x.z > 10.0 * MIN_DEPTH;
            inliers += usize::from(observation.inlier);
        }
    }
    inliers
}

/// Triangulates a point from observations in frames with known poses. `None` if they do not determine a point in front
/// of the camera.
pub fn triangulate(
    observations: &[(FramePose, nalgebra::Vector2<f64>)],
    focal: &nalgebra::Vector2<f64>,
    noise: f64,
) -> Option<Vector3<f64>> {
    let mut p = Vector3::zeros();
    let anchor = 2.0 * noise / (observations.len().max(1) as f64).sqrt();
    for round in 0..5 {
        let (mut H, mut g) = (Matrix3::zeros(), Vector3::zeros());
        for (pose, m) in observations {
            let R = *pose.R_CB.to_rotation_matrix().matrix();
            let x = R * p + pose.t_C;
            let weight = if round == 0 {
                1.0 / pose.t_C.z.max(0.2)
            } else {
                let width = noise * f64::from(80 >> round).max(3.0);
                let off = residual(focal, &x, m);
                let loss = off.map_or(1e-3, |r| 1.0 / (1.0 + r.norm_squared() / (width * width)));
                loss.sqrt() / x.z.max(0.2)
            };
            #[rustfmt::skip]
            let by_x = Matrix3::new(
                weight * focal.x, 0.0, -weight * m.x,
                0.0, weight * focal.y, -weight * m.y,
                0.0, 0.0, anchor,
            );
            let r = by_x * x - Vector3::new(0.0, 0.0, anchor * pose.t_C.z);
            let by_p = by_x * R;
            H += by_p.tr_mul(&by_p);
            g += by_p.tr_mul(&r);
        }
        p -= H.cholesky()?.solve(&g);
    }
    let in_front = observations
        .iter()
        .all(|(s, _)| (s.R_CB * p + s.t_C).z > 10.0 * MIN_DEPTH);
    (in_front && p.norm() < 1e3).then_some(p)
}
