//! Resection (perspective-n-point): the body's pose in one frame from known points, with wrong correspondences among them.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::pose_model::FramePose;
use super::scene::residual;
use crate::spatial::exp_so3;

/// Least number of points for a resection; three determine the pose, the others test it.
pub const MIN_POINTS: usize = 5;

/// A point in body axes and its image, relative to the principal point \[px\].
pub type Correspondence = (Vector3<f64>, Vector2<f64>);

/// A pose with the number of correspondences that agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resection {
    /// The pose.
    pub pose: FramePose,
    /// Number of correspondences with a residual below `6 noise`.
    pub inliers: usize,
}

/// Pose of the body from `correspondences`, searched near `guess`; if most disagree there and `search` is set, the
/// search covers all attitudes. `None` if no pose agrees with two thirds of the correspondences, and with at least
/// five.
pub fn resect(
    focal: &Vector2<f64>,
    correspondences: &[Correspondence],
    guess: &FramePose,
    noise: f64,
    search: bool,
) -> Option<Resection> {
    if correspondences.len() < MIN_POINTS {
        return None;
    }
    let is_accepted =
        |p: &Resection| p.inliers >= MIN_POINTS && 3 * p.inliers >= 2 * correspondences.len();
    let near = refine(focal, correspondences, *guess, noise);
    if let Some(resected) = near.filter(is_accepted) {
        return Some(resected);
    }
    if !search {
        return None;
    }
    let mut starts = attitudes().into_iter().filter_map(|R_CB| {
        let start = FramePose {
            R_CB,
            t_C: translation(focal, correspondences, &R_CB)?,
        };
        refine(focal, correspondences, start, noise)
    });
    starts.find(is_accepted)
}

/// Iteratively reweighted least squares with Cauchy weights, whose width shrinks to a few times the noise.
fn refine(
    focal: &Vector2<f64>,
    correspondences: &[Correspondence],
    start: FramePose,
    noise: f64,
) -> Option<Resection> {
    let mut pose = start;
    let mut sizes = Vec::with_capacity(correspondences.len());
    let mut width = f64::INFINITY;
    for _ in 0..20 {
        let mut H = SMatrix::<f64, 6, 6>::zeros();
        let mut g = SVector::<f64, 6>::zeros();
        let R = *pose.R_CB.to_rotation_matrix().matrix();
        sizes.clear();
        let x = |p: &Vector3<f64>| R * p + pose.t_C;
        sizes.extend(
            correspondences
                .iter()
                .filter_map(|(p, m)| Some(residual(focal, &x(p), m)?.norm())),
        );
        if sizes.len() < MIN_POINTS {
            return None;
        }
        // Half of the correspondences are below the median residual: the width need not be larger to keep them.
        let middle = sizes.len() / 2;
        let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
        width = (3.0 * noise).max(3.0 * median).min(width);
        for (p, m) in correspondences {
            let x = x(p);
            let Some(r) = residual(focal, &x, m) else {
                continue;
            };
            let weight = 1.0 / (1.0 + r.norm_squared() / (width * width));
            let inverse = 1.0 / x.z;
            let (u, v) = (focal.x * x.x * inverse, focal.y * x.y * inverse);
            #[rustfmt::skip]
            let by_x = SMatrix::<f64, 2, 3>::new(
                focal.x * inverse, 0.0, -u * inverse,
                0.0, focal.y * inverse, -v * inverse,
            );
            let by_turn = -by_x * R * p.cross_matrix();
            let mut J = SMatrix::<f64, 2, 6>::zeros();
            J.fixed_columns_mut::<3>(0).copy_from(&by_turn);
            J.fixed_columns_mut::<3>(3).copy_from(&by_x);
            H += J.tr_mul(&J) * weight;
            g += J.tr_mul(&r) * weight;
        }
        for k in 0..6 {
            H[(k, k)] *= 1.0 + 1e-6;
        }
        let mut step = -H.cholesky()?.solve(&g);
        // Limit the rotation to where the linearisation is valid.
        let turn = step.fixed_rows::<3>(0).norm();
        step *= (0.7 / turn).min(1.0);
        pose.R_CB *= exp_so3(&step.fixed_rows::<3>(0).into_owned());
        pose.R_CB.renormalize_fast();
        pose.t_C += step.fixed_rows::<3>(3);
        if step.norm() < 1e-8 {
            break;
        }
    }
    let R = pose.R_CB.to_rotation_matrix();
    let agrees = |(p, m): &&Correspondence| {
        residual(focal, &(R * p + pose.t_C), m).is_some_and(|r| r.norm() < 6.0 * noise)
    };
    let inliers = correspondences.iter().filter(agrees).count();
    let finite = pose.t_C.iter().all(|t| t.is_finite());
    finite.then_some(Resection { pose, inliers })
}

/// The translation that fits a given attitude best, by linear least squares: `f (x + t_x) - u (z + t_z) = 0`.
pub fn translation(
    focal: &Vector2<f64>,
    correspondences: &[Correspondence],
    R_CB: &UnitQuaternion<f64>,
) -> Option<Vector3<f64>> {
    let R = R_CB.to_rotation_matrix();
    let mut weights = vec![1.0; correspondences.len()];
    let mut t = Vector3::zeros();
    for _ in 0..4 {
        let (mut H, mut g) = (Matrix3::zeros(), Vector3::zeros());
        for ((p, m), w) in correspondences.iter().zip(&weights) {
            let x = R * p;
            for (row, value) in [
                (Vector3::new(focal.x, 0.0, -m.x), m.x * x.z - focal.x * x.x),
                (Vector3::new(0.0, focal.y, -m.y), m.y * x.z - focal.y * x.y),
            ] {
                H += row * row.transpose() * *w;
                g += row * (value * w);
            }
        }
        t = H.cholesky()?.solve(&g);
        let errors = correspondences
            .iter()
            .map(|(p, m)| residual(focal, &(R * p + t), m).map(|r| r.norm()));
        let errors: Vec<f64> = errors.map(|e| e.unwrap_or(f64::INFINITY)).collect();
        let mut sorted = errors.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted[sorted.len() / 2].max(1e-9);
        for (w, e) in weights.iter_mut().zip(errors) {
            *w = 1.0 / (1.0 + (e / median).powi(2));
        }
    }
    t.iter().all(|t| t.is_finite()).then_some(t)
}

/// Sixty attitudes, the rotations of an icosahedron: every attitude is within 45 degrees of one.
fn attitudes() -> Vec<UnitQuaternion<f64>> {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let by_fifth = UnitQuaternion::new(
        Vector3::new(0.0, 1.0, golden).normalize() * std::f64::consts::TAU / 5.0,
    );
    let by_third =
        UnitQuaternion::new(Vector3::new(1.0, 1.0, 1.0).normalize() * std::f64::consts::TAU / 3.0);
    // The group that the two generate.
    let mut all = vec![UnitQuaternion::identity()];
    let mut next = 0;
    while next < all.len() {
        for generator in [by_fifth, by_third] {
            let candidate = all[next] * generator;
            if all.iter().all(|known| known.angle_to(&candidate) > 0.1) {
                all.push(candidate);
            }
        }
        next += 1;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn correspondences(
        R_CB: &UnitQuaternion<f64>,
        t_C: &Vector3<f64>,
        wrong: usize,
    ) -> Vec<Correspondence> {
        let focal = 800.0;
        (0..20)
            .map(|j| {
                let a = f64::from(j);
                let p = Vector3::new((2.1 * a).sin(), (1.3 * a).cos(), (3.7 * a).sin()) * 0.4;
                let x = R_CB * p + t_C;
                let mut m = x.xy() * (focal / x.z);
                if (j as usize) < wrong {
                    m = Vector2::new(300.0 * a.sin(), 200.0 * (5.0 * a).cos());
                }
                (p, m)
            })
            .collect()
    }

    #[test]
    fn the_sixty_attitudes_are_the_icosahedral_group() {
        let all = attitudes();
        assert_eq!(all.len(), 60);
    }

    #[test]
    fn a_body_is_resected_from_any_attitude_with_wrong_correspondences() {
        let t_C = Vector3::new(0.05, -0.03, 1.1);
        for k in 0..20 {
            let a = f64::from(k);
            let axis = Vector3::new(a.sin(), a.cos(), (1.7 * a).sin()) * 1.6;
            let R_CB = UnitQuaternion::from_scaled_axis(axis);
            let correspondences = correspondences(&R_CB, &t_C, 4);
            let guess = FramePose {
                R_CB: UnitQuaternion::identity(),
                t_C: Vector3::z(),
            };
            let resected = resect(
                &Vector2::new(800.0, 800.0),
                &correspondences,
                &guess,
                0.3,
                true,
            )
            .unwrap();
            assert!(resected.pose.R_CB.angle_to(&R_CB) < 1e-3, "{k}");
            assert!((resected.pose.t_C - t_C).norm() < 1e-3, "{k}");
            assert!(resected.inliers >= 16);
        }
    }

    #[test]
    fn correspondences_that_fit_no_pose_are_refused() {
        let R_CB = UnitQuaternion::identity();
        let correspondences = correspondences(&R_CB, &Vector3::z(), 12);
        let guess = FramePose {
            R_CB,
            t_C: Vector3::z(),
        };
        assert_eq!(
            resect(
                &Vector2::new(800.0, 800.0),
                &correspondences,
                &guess,
                0.3,
                true
            ),
            None
        );
    }
}
