//! Inlier gate: which observations agree with poses and points, and statistics of their residuals.

use nalgebra::{Vector2, Vector3};

use super::pose_model::PoseModel;
use super::pose_model::independent_poses::IndependentPoses;
use super::scene::{Scene, residual};

/// An observation is an inlier if its residual is less than this many times the noise.
pub const INLIER_GATE: f64 = 6.0;

/// Statistics of the residuals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residuals {
    /// Root mean square of the inliers' components \[px\].
    pub rms: f64,
    /// Root mean square per degree of freedom: the estimated standard deviation of the noise \[px\].
    pub deviation: f64,
    /// Fraction of all observations that are outliers.
    pub outliers: f64,
}

/// Marks as inliers the observations with a residual below `limit` \[px\], and no others.
pub fn gate_inliers(
    scene: &mut Scene,
    motion: &IndependentPoses,
    points: &[Vector3<f64>],
    limit: f64,
) {
    let focal = scene.focal * motion.log_focal.exp();
    for (i, pose) in motion.poses.iter().enumerate() {
        let R = pose.R_CB.to_rotation_matrix();
        for observation in scene.frame_mut(i) {
            let x = R * points[observation.point] + pose.t_C;
            let off = residual(&focal, &x, &observation.pixel);
            observation.inlier = off.is_some_and(|r| r.norm() < limit);
        }
    }
}

/// Root mean square of the inliers' residual components per degree of freedom \[px\]; the degrees of freedom are at
/// least a fifth of the components.
pub fn rms(scene: &Scene, motion: &IndependentPoses, points: &[Vector3<f64>]) -> f64 {
    let focal = scene.focal * motion.log_focal.exp();
    let (mut sum, mut count) = (0.0, 0);
    for (i, pose) in motion.poses.iter().enumerate() {
        for observation in scene.frame(i).iter().filter(|s| s.inlier) {
            let x = pose.R_CB * points[observation.point] + pose.t_C;
            if let Some(r) = residual(&focal, &x, &observation.pixel) {
                sum += r.norm_squared();
                count += 2;
            }
        }
    }
    let unknowns = 6 * motion.poses.len() + 3 * points.len();
    (sum / f64::from(count).max(1.0) * f64::from(count)
        / (f64::from(count) - unknowns as f64)
            .max(0.2 * f64::from(count))
            .max(1.0))
    .sqrt()
}

/// Marks as inliers the observations with a residual below `limit` \[px\]; returns the statistics.
pub fn gate_and_evaluate<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &mut Scene,
    motion: &M,
    points: &[Vector3<f64>],
    limit: f64,
) -> Residuals {
    let lens = motion.intrinsics().lens(&scene.focal);
    let (mut sum, mut inliers, mut all) = (0.0, 0usize, 0usize);
    for i in 0..scene.len() {
        let pose = motion.pose(i);
        let R = pose.R_CB.to_rotation_matrix();
        for observation in scene.frame_mut(i) {
            let x = R * points[observation.point] + pose.t_C;
            let off = lens
                .project(&x)
                .map(|m| (m - observation.pixel).norm_squared());
            observation.inlier = off.is_some_and(|o| o < limit * limit);
            all += 1;
            if let Some(off) = off.filter(|_| observation.inlier) {
                inliers += 1;
                sum += off;
            }
        }
    }
    let freedom = (2.0 * inliers as f64 - unknowns(scene, motion)).max(1.0);
    Residuals {
        rms: (sum / (2 * inliers.max(1)) as f64).sqrt(),
        deviation: (sum / freedom).sqrt(),
        outliers: 1.0 - inliers as f64 / all.max(1) as f64,
    }
}

/// Number of unknowns of a fit to the scene that the images determine, not the priors.
pub fn unknowns<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &M,
) -> f64 {
    (L * scene.len() + 3 * scene.points + G) as f64 - motion.held()
}

/// Calls `visit` with the residual of every inlier \[px\].
pub fn each_inlier_residual<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &M,
    points: &[Vector3<f64>],
    mut visit: impl FnMut(&Vector2<f64>),
) {
    let lens = motion.intrinsics().lens(&scene.focal);
    for i in 0..scene.len() {
        let pose = motion.pose(i);
        let R = pose.R_CB.to_rotation_matrix();
        for observation in scene.frame(i).iter().filter(|s| s.inlier) {
            let x = R * points[observation.point] + pose.t_C;
            if let Some(m) = lens.project(&x) {
                visit(&(m - observation.pixel));
            }
        }
    }
}
