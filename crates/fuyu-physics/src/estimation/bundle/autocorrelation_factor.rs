//! Time-correlated errors of image points.
//!
//! A tracker that places a point slightly wrong repeats this error in the next frames. Such errors average out more slowly
//! than independent ones: the variance of a quantity that many frames determine is larger by the factor
//! `1 + 2 (r_1 + r_2 + ...)`, with the autocorrelation `r_k` at lag `k` (Bartlett 1946). The autocorrelation is computed
//! from residuals after a free correction of each frame's pose, so that unmodelled motion does not contribute.

use nalgebra::{Matrix2x3, Matrix2x6, Matrix6, Vector2, Vector3, Vector6};

use super::pose_model::PoseModel;
use super::scene::{MIN_DEPTH, Scene};

/// Longest lag \[frames\].
const LAGS: usize = 120;

/// Fewest points of a frame: a pose takes six of their coordinates.
const FEWEST: usize = 6;

/// Smaller factors are replaced by 1. The autocorrelation of independent errors is sometimes significant by chance,
/// with a factor near 1; such solutions must not change at all.
const LEAST_FACTOR: f64 = 2.0;

/// The sum ends at an autocorrelation below this many of its standard deviations for independent errors.
const SIGNIFICANT: f64 = 3.0;

/// Variance factor of a solution for time-correlated errors; exactly 1 without them. Also 1 for coordinates rounded to
/// whole pixels, which have a likelihood of their own.
pub fn autocorrelation_factor<const L: usize, const G: usize, M: PoseModel<L, G>>(
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

/// Variance factor from the residuals of each point, with their frames.
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

/// Residuals of the inliers in frame `i` after a free correction of its pose, with the indices of their points \[px\].
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

    /// Errors of 50 points over 300 frames: each is `memory` times the previous one plus independent noise.
    fn random_residuals(memory: f64) -> Vec<Vec<(usize, Vector2<f64>)>> {
        let mut rng = StdRng::seed_from_u64(4);
        let course = |_| {
            let mut error = Vector2::zeros();
            let each = (0..400).map(|k: usize| {
                let mut noise = || rng.sample::<f64, _>(StandardNormal);
                error = error * memory + Vector2::new(noise(), noise());
                (k, error)
            });
            // The first errors have not reached their stationary variance.
            each.skip(100).collect()
        };
        (0..50).map(course).collect()
    }

    // Fails if a small autocorrelation counts, which independent errors have by chance: solutions for independent
    // errors would change.
    #[test]
    fn independent_errors_change_nothing() {
        for memory in [0.0, 0.1] {
            assert_eq!(of_series(&random_residuals(memory)), 1.0);
        }
    }

    // The variance factor of a first-order autoregressive process is (1 + a) / (1 - a).
    #[test]
    fn errors_that_last_count_less() {
        for memory in [0.5, 0.9] {
            let expected = (1.0 + memory) / (1.0 - memory);
            let factor = of_series(&random_residuals(memory));
            assert!(
                (factor / expected - 1.0).abs() < 0.15,
                "{factor} {expected}"
            );
        }
    }
}
