//! Errors of image points that last from frame to frame.
//!
//! A tracker that has aligned a point a little off its place does so in the next frames as well. Such errors do not average out as
//! independent ones do: the variance of what many frames determine is larger by `1 + 2 (r_1 + r_2 + ...)` with their autocorrelation `r`
//! (Bartlett 1946). It is measured in the residuals that a pose of each frame leaves, so that a motion that the model does
//! not know does not count.

use nalgebra::{Matrix2x3, Matrix2x6, Matrix6, Vector2, Vector3, Vector6};

use super::pose_model::PoseModel;
use super::scene::{MIN_DEPTH, Scene};

/// Longest lag \[frames\].
const LAGS: usize = 120;

/// Fewest points of a frame: a pose takes six of their coordinates.
const FEWEST: usize = 6;

/// Least factor that counts. The autocorrelation of independent errors is sometimes significant by chance, and then makes a factor near 1;
/// their solutions remain exactly the same.
const LEAST_FACTOR: f64 = 2.0;

/// A smaller autocorrelation, in its standard deviations for independent errors, ends the sum.
const SIGNIFICANT: f64 = 3.0;

/// Factor on the variance of a solution for errors that last; exactly 1 if they do not. Coordinates that are rounded to whole pixels are left to
/// their own likelihood.
pub fn lasting_errors<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &M,
    points: &[Vector3<f64>],
) -> f64 {
    if scene.is_rounded() {
        return 1.0;
    }
    let mut series: Vec<Vec<(usize, Vector2<f64>)>> = vec![Vec::new(); points.len()];
    for i in 0..scene.len() {
        for (point, residual) in
            residuals_with_free_pose(scene, motion, points, i).unwrap_or_default()
        {
            series[point].push((i, residual));
        }
    }
    of_series(&series)
}

/// The same for the residuals of each point, with their frames.
fn of_series(all: &[Vec<(usize, Vector2<f64>)>]) -> f64 {
    let mut sums = [0.0; LAGS + 1];
    let mut count = 0.0;
    for series in all {
        count += 2.0 * series.len() as f64;
        for (k, (from, a)) in series.iter().enumerate() {
            for (to, b) in &series[k..] {
                let Some(sum) = sums.get_mut(to - from) else {
                    break;
                };
                *sum += a.dot(b);
            }
        }
    }
    let least = SIGNIFICANT / f64::sqrt(f64::max(count, 1.0)) * sums[0];
    let lasting = sums[1..].iter().take_while(|sum| **sum > least);
    let factor = 1.0 + 2.0 * lasting.sum::<f64>() / sums[0];
    // Also false if all residuals are zero.
    match factor >= LEAST_FACTOR {
        true => factor,
        false => 1.0,
    }
}

/// Residuals of the inliers in frame `i` that a change of its pose would leave, with their points \[px\].
fn residuals_with_free_pose<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &M,
    points: &[Vector3<f64>],
    i: usize,
) -> Option<Vec<(usize, Vector2<f64>)>> {
    let lens = motion.intrinsics().lens(&scene.focal);
    let pose = motion.pose(i);
    let R = pose.R_CB.to_rotation_matrix();
    let mut found = Vec::new();
    let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
    for observation in scene.frame(i).iter().filter(|s| s.inlier) {
        let arm = R * points[observation.point];
        let x = arm + pose.t_C;
        let (Some(m), true) = (lens.project(&x), x.z > MIN_DEPTH) else {
            continue;
        };
        let residual = observation.pixel - m;
        let (fx, fy) = (scene.focal.x / x.z, scene.focal.y / x.z);
        let by_place = Matrix2x3::new(fx, 0.0, -fx * x.x / x.z, 0.0, fy, -fy * x.y / x.z);
        let mut by_pose = Matrix2x6::zeros();
        by_pose.fixed_columns_mut::<3>(0).copy_from(&by_place);
        let by_turn = by_place * -arm.cross_matrix();
        by_pose.fixed_columns_mut::<3>(3).copy_from(&by_turn);
        normal += by_pose.transpose() * by_pose;
        right += by_pose.transpose() * residual;
        found.push((observation.point, residual, by_pose));
    }
    if found.len() < FEWEST {
        return None;
    }
    let change = normal.cholesky()?.solve(&right);
    let rest = found.into_iter();
    Some(
        rest.map(|(point, residual, by_pose)| (point, residual - by_pose * change))
            .collect(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    use rand_distr::StandardNormal;

    /// Errors of 50 points over 300 frames, each `memory` of the last one and independent noise.
    fn courses(memory: f64) -> Vec<Vec<(usize, Vector2<f64>)>> {
        let mut rng = StdRng::seed_from_u64(4);
        let course = |_| {
            let mut error = Vector2::zeros();
            let each = (0..400).map(|k: usize| {
                let mut noise = || rng.sample::<f64, _>(StandardNormal);
                error = error * memory + Vector2::new(noise(), noise());
                (k, error)
            });
            // The first ones have not yet their usual size.
            each.skip(100).collect()
        };
        (0..50).map(course).collect()
    }

    // Would break if a small autocorrelation counted, as independent errors have it by chance: solutions without a tracker would change.
    #[test]
    fn independent_errors_change_nothing() {
        for memory in [0.0, 0.1] {
            assert_eq!(of_series(&courses(memory)), 1.0);
        }
    }

    // An autoregressive process of first order: (1 + a) / (1 - a).
    #[test]
    fn errors_that_last_count_less() {
        for memory in [0.5, 0.9] {
            let expected = (1.0 + memory) / (1.0 - memory);
            let factor = of_series(&courses(memory));
            assert!(
                (factor / expected - 1.0).abs() < 0.15,
                "{factor} {expected}"
            );
        }
    }
}
