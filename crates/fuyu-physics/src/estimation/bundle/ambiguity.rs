//! Other motions that explain the images of a short turn.
//!
//! From afar a little turn about an axis across the line of observation moves a point by rate times depth: twice the depth
//! and half the rate look alike, and so does everything mirrored in depth. What tells them apart, perspective and the
//! turn's own curvature, may be less than the noise, and then it is luck in which of them an adjustment ends.

use nalgebra::Vector3;

use super::adjust::{AdjustOptions, PoseModel, adjust};
use super::model_fit::{ModelFit, TumblingModel, settle};
use super::pixel_likelihood::PixelLikelihood;
use super::scene::Scene;
use super::structure::{INLIER_GATE, SolverSettings};
use super::uncertainty::Residuals;

/// A turn by more than this \[rad\] has no rivals. (Between one and this it is from afar, or with the far side hidden,
/// that it has some.)
pub const UNAMBIGUOUS_TURN: f64 = 3.0;

/// Depths to try, as multiples of those that make the body as deep as it is wide.
const DEPTHS: [f64; 6] = [1.0, -1.0, 0.5, -0.5, 2.0, -2.0];

/// Rounds, each from the best of the one before.
const ROUNDS: usize = 3;

/// Rivals start this many times the noise from the images, or nearer.
const FAR: f64 = 60.0;

/// A sum of squares that is larger by so many variances is not as good: five standard deviations.
const UNLIKELY: f64 = 25.0;

/// Rates that differ by less than this part are the same.
const SAME: f64 = 0.2;

/// The best of a fit and its rivals. With it the other rate \[rad/s\] that explains the images as well, if there is one.
pub fn best_hypothesis<const L: usize, const G: usize, M>(
    scene: &mut Scene,
    fit: ModelFit<M>,
    settings: &SolverSettings,
) -> (ModelFit<M>, Option<f64>)
where
    M: PoseModel<L, G> + TumblingModel,
{
    let mut best = (fit, scene.clone());
    let mut other = None;
    for _ in 0..ROUNDS {
        if best.0.motion.turn() > UNAMBIGUOUS_TURN {
            break;
        }
        let mut all: Vec<_> = hypotheses(&best.1, &best.0, settings);
        let before = misfit(&best.0, settings);
        all.push(best);
        all.sort_by(|a, b| misfit(&a.0, settings).total_cmp(&misfit(&b.0, settings)));
        best = all.remove(0);
        let least = misfit(&best.0, settings);
        let count = (2 * best.1.observations().len()).max(1) as f64;
        let rate = best.0.motion.rate();
        let alternative = all.iter().find(|(f, _)| {
            let alike = misfit(f, settings) < least * (1.0 + UNLIKELY / count);
            alike && (f.motion.rate() - rate).norm() > SAME * rate.norm()
        });
        other = alternative.map(|(f, _)| f.motion.rate().norm());
        if least > before * (1.0 - UNLIKELY / count) {
            break;
        }
    }
    *scene = best.1;
    (best.0, other)
}

/// Mean square of the residuals \[px²\]. Points that are left out count as the farthest that are not.
fn misfit<M>(fit: &ModelFit<M>, settings: &SolverSettings) -> f64 {
    let Residuals {
        deviation,
        outliers,
        ..
    } = fit.residuals;
    deviation.powi(2) * (1.0 - outliers) + (INLIER_GATE * settings.noise).powi(2) * outliers
}

/// What an adjustment makes of the fit with other depths.
fn hypotheses<const L: usize, const G: usize, M>(
    scene: &Scene,
    fit: &ModelFit<M>,
    settings: &SolverSettings,
) -> Vec<(ModelFit<M>, Scene)>
where
    M: PoseModel<L, G> + TumblingModel,
{
    let centre = fit.points.iter().sum::<Vector3<f64>>() / fit.points.len().max(1) as f64;
    let R = fit.motion.middle().to_rotation_matrix();
    let seen: Vec<Vector3<f64>> = fit.points.iter().map(|p| R * (p - centre)).collect();
    let width: f64 = seen.iter().map(|p| 0.5 * p.xy().norm_squared()).sum();
    let depth: f64 = seen.iter().map(|p| p.z * p.z).sum();
    let round = (width / depth.max(f64::MIN_POSITIVE)).sqrt();
    let alternative = |times: f64| {
        let times = times * round;
        let mut motion = fit.motion.with_depths(times, &centre)?;
        let stretched = |p: &Vector3<f64>| R.inverse() * Vector3::new(p.x, p.y, times * p.z);
        let mut points = seen.iter().map(stretched).collect();
        let mut judged = scene.clone();
        for i in 0..judged.len() {
            judged.frame_mut(i).iter_mut().for_each(|s| s.inlier = true);
        }
        let adjust_options = AdjustOptions {
            loss: PixelLikelihood::Huber(FAR * settings.noise),
            steps: 20,
            tolerance: 1e-3,
        };
        adjust(&judged, &mut motion, &mut points, &adjust_options)?;
        let found = settle(&mut judged, motion, points, settings)?;
        Some((found, judged))
    };
    DEPTHS.into_iter().filter_map(alternative).collect()
}
