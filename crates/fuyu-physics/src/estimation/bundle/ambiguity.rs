//! Ambiguity hypotheses: other rotations and depths of the body that explain the images of a short rotation.
//!
//! From a distance, a small rotation about an axis across the line of sight moves a point by rate times depth. Twice
//! the depth at half the rate looks the same, and so does a body mirrored in depth. Perspective and the curvature of
//! the points' paths distinguish them, but these may be less than the noise. An adjustment may then converge to any
//! of these motions.
//!
//! Hypotheses are first fitted to a subset of the frames. Those that the subset does not refute, and that differ from
//! the motion already known, are then fitted to all frames.

use nalgebra::Vector3;

use super::adjust::{AdjustOptions, adjust};
use super::inlier_gate::{INLIER_GATE, Residuals};
use super::model_fit::{ModelFit, fit_robustly};
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::{PoseModel, TumblingModel};
use super::scene::Scene;
use super::structure::SolverSettings;

/// A rotation by more than this \[rad\] is unambiguous. (Between 1 rad and this, rotations seen from far away or with
/// the far side hidden may be ambiguous.)
pub const UNAMBIGUOUS_TURN: f64 = 3.0;

/// Bodies that hypotheses start from: depth (1: as deep as wide; negative: mirrored in depth), and displacement of the
/// points in depth relative to the depth's standard deviation, which differs from point to point. Displaced points can
/// leave a minimum that the others converge to.
const BODIES: [(f64, f64); 12] = [
    (1.0, 0.0),
    (-1.0, 0.0),
    (0.5, 0.0),
    (-0.5, 0.0),
    (2.0, 0.0),
    (-2.0, 0.0),
    (0.25, 0.0),
    (-0.25, 0.0),
    (4.0, 0.0),
    (-4.0, 0.0),
    (1.0, 0.6),
    (-1.0, 0.6),
];

/// Number of rounds; each starts from the best hypothesis of the one before.
const ROUNDS: usize = 3;

/// Hypotheses are tried on at most about this number of frames, evenly spaced.
const TRIAL_FRAMES: usize = 100;

/// Width of Huber's cost in the first adjustment of a hypothesis, as a multiple of the noise.
const START_WIDTH: f64 = 60.0;

/// Hypotheses count as equally good unless their sums of squares differ by this many noise variances (five standard
/// deviations, squared).
const SIGNIFICANT: f64 = 25.0;

/// Angular velocities that differ by less than this share are the same motion.
const SAME_RATE: f64 = 0.2;

/// Trial fits whose angular velocities differ by less than this share have found the same minimum.
const SAME_MINIMUM: f64 = 0.01;

/// The best of a fit and its hypotheses, and the angular rate \[rad/s\] of a different motion that explains the images
/// equally well, if there is one.
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
        let before = mean_square(&best.0, settings);
        all.push(best);
        all.sort_by(|a, b| mean_square(&a.0, settings).total_cmp(&mean_square(&b.0, settings)));
        best = all.remove(0);
        let least = mean_square(&best.0, settings);
        let count = (2 * best.1.observations().len()).max(1) as f64;
        let rate = best.0.motion.rate();
        let alternative = all.iter().find(|(f, _)| {
            let alike = mean_square(f, settings) < least * (1.0 + SIGNIFICANT / count);
            alike && (f.motion.rate() - rate).norm() > SAME_RATE * rate.norm()
        });
        other = alternative.map(|(f, _)| f.motion.rate().norm());
        if least > before * (1.0 - SIGNIFICANT / count) {
            break;
        }
    }
    *scene = best.1;
    (best.0, other)
}

/// Mean square of the residuals \[px²\]; an outlier counts as a residual at the limit of the inlier gate.
fn mean_square<M>(fit: &ModelFit<M>, settings: &SolverSettings) -> f64 {
    let Residuals {
        deviation,
        outliers,
        ..
    } = fit.residuals;
    deviation.powi(2) * (1.0 - outliers) + (INLIER_GATE * settings.noise).powi(2) * outliers
}

/// Fits of the hypotheses to all frames, each started from `fit` with other depths.
fn hypotheses<const L: usize, const G: usize, M>(
    scene: &Scene,
    fit: &ModelFit<M>,
    settings: &SolverSettings,
) -> Vec<(ModelFit<M>, Scene)>
where
    M: PoseModel<L, G> + TumblingModel,
{
    try_on_some_frames(scene, fit, settings).unwrap_or_else(|| other_depths(scene, fit, settings))
}

/// Fits of [`other_depths`] to [`TRIAL_FRAMES`] frames, repeated on all frames for those that differ from `fit` and are
/// not refuted. `None` if the scene has no more frames than that, or if the trial frames alone do not determine a fit.
fn try_on_some_frames<const L: usize, const G: usize, M>(
    scene: &Scene,
    fit: &ModelFit<M>,
    settings: &SolverSettings,
) -> Option<Vec<(ModelFit<M>, Scene)>>
where
    M: PoseModel<L, G> + TumblingModel,
{
    let every = scene.len().div_ceil(TRIAL_FRAMES);
    if every < 2 {
        return None;
    }
    let mut chosen: Vec<usize> = (0..scene.len() - 1).step_by(every).collect();
    chosen.push(scene.len() - 1);
    let mut trial_scene = scene.of_frames(&chosen, settings.noise)?;
    let motion = fit.motion.in_frames(&chosen);
    let known = fit_robustly(&mut trial_scene, motion, fit.points.clone(), settings)?;
    let mut found = other_depths(&trial_scene, &known, settings);
    found.sort_by(|a, b| mean_square(&a.0, settings).total_cmp(&mean_square(&b.0, settings)));
    let significant = SIGNIFICANT / (2 * trial_scene.observations().len()).max(1) as f64;
    let least = mean_square(&known, settings);
    let mut rates = vec![known.motion.rate()];
    let mut hypotheses = Vec::new();
    for (trial, _) in &found {
        let (square, rate) = (mean_square(trial, settings), trial.motion.rate());
        if square > least * (1.0 + significant) {
            break;
        }
        let is_better = square < least * (1.0 - significant);
        let same = |r: &Vector3<f64>| (rate - r).norm() < SAME_MINIMUM * r.norm();
        // A better fit is kept even if its rate is that of the known fit, which has then not converged.
        let is_known = if is_better {
            rates[1..].iter().any(same)
        } else {
            rates.iter().any(same)
        };
        if is_known {
            continue;
        }
        rates.push(rate);
        let mut all_frames = all_inliers(scene);
        let motion = fit.motion.with_motion_of(&trial.motion);
        let fitted = fit_robustly(&mut all_frames, motion, trial.points.clone(), settings);
        hypotheses.extend(fitted.map(|fit| (fit, all_frames)));
    }
    Some(hypotheses)
}

/// The scene with all observations as inliers.
fn all_inliers(scene: &Scene) -> Scene {
    let mut all = scene.clone();
    for i in 0..all.len() {
        all.frame_mut(i).iter_mut().for_each(|s| s.inlier = true);
    }
    all
}

/// Fits to the frames of `scene`, each started from `fit` with other depths.
fn other_depths<const L: usize, const G: usize, M>(
    scene: &Scene,
    fit: &ModelFit<M>,
    settings: &SolverSettings,
) -> Vec<(ModelFit<M>, Scene)>
where
    M: PoseModel<L, G> + TumblingModel,
{
    let centre = fit.points.iter().sum::<Vector3<f64>>() / fit.points.len().max(1) as f64;
    let R = fit.motion.middle_attitude().to_rotation_matrix();
    let centred: Vec<Vector3<f64>> = fit.points.iter().map(|p| R * (p - centre)).collect();
    let width: f64 = centred.iter().map(|p| 0.5 * p.xy().norm_squared()).sum();
    let depth: f64 = centred.iter().map(|p| p.z * p.z).sum();
    let roundness = (width / depth.max(f64::MIN_POSITIVE)).sqrt();
    let hypothesis = |(factor, displacement): (f64, f64)| {
        let factor = factor * roundness;
        let mut motion = fit.motion.with_scaled_depths(factor, &centre)?;
        let stretched = |(k, p): (usize, &Vector3<f64>)| {
            // Different for each point, but the same in every run.
            let shift = displacement
                * (depth / centred.len().max(1) as f64).sqrt()
                * (2.4 * k as f64).sin();
            R.inverse() * Vector3::new(p.x, p.y, factor * (p.z + shift))
        };
        let mut points = centred.iter().enumerate().map(stretched).collect();
        let mut trial_scene = all_inliers(scene);
        let adjust_options = AdjustOptions {
            likelihood: PixelLikelihood::Huber(START_WIDTH * settings.noise),
            steps: 20,
            tolerance: 1e-3,
        };
        adjust(&trial_scene, &mut motion, &mut points, &adjust_options)?;
        let found = fit_robustly(&mut trial_scene, motion, points, settings)?;
        Some((found, trial_scene))
    };
    BODIES.into_iter().filter_map(hypothesis).collect()
}
