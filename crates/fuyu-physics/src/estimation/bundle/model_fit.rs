//! Fit of a pose model to a scene: robust adjustment, preference for a spherical inertia, refinement by pixel rounding.

use nalgebra::Vector3;

use super::adjust::{AdjustOptions, adjust};
use super::inlier_gate::{
    INLIER_GATE, Residuals, each_inlier_residual, gate_and_evaluate, unknowns,
};
use super::pixel_likelihood::{PixelLikelihood, Rounding};
use super::pose_model::{PoseModel, TumblingModel};
use super::scene::Scene;
use super::structure::SolverSettings;

/// Below this angle between angular velocity and angular momentum \[rad\] a spherical body is tried.
const SMALL_NUTATION: f64 = 0.05;

/// An inertia shape is preferred to a sphere if it lowers the cost by more than this (in units of the noise variance).
/// For a spherical body the five parameters of the shape lower the cost by 2.5 on average.
const SHAPE_GAIN: f64 = 20.0;

/// Scales of the noise before rounding \[px\], tried in this order while the likelihood rises.
const NOISE_SCALES: [f64; 3] = [0.06, 0.02, 0.007];

/// Least number of coordinates near the edges of their pixels, per unknown, for a refinement by rounding.
const BOUNDED_PER_UNKNOWN: f64 = 0.7;

/// A fitted pose model with its points.
#[derive(Debug, Clone)]
pub struct ModelFit<M> {
    /// The pose model.
    pub motion: M,
    /// The points in body axes.
    pub points: Vec<Vector3<f64>>,
    /// Statistics of the residuals.
    pub residuals: Residuals,
    /// Cost of all image residuals and of the priors \[px²\].
    pub cost: f64,
}

/// Robust fit from a rough start: each round has a narrower inlier gate than the one before.
pub fn fit_robustly<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &mut Scene,
    mut motion: M,
    mut points: Vec<Vector3<f64>>,
    settings: &SolverSettings,
) -> Option<ModelFit<M>> {
    let mut outliers = f64::INFINITY;
    let mut cost = f64::INFINITY;
    let widths = [8.0, 2.0, 1.0, 1.0];
    for (round, width) in widths.into_iter().enumerate() {
        let limit = width * INLIER_GATE * settings.noise;
        let current = gate_and_evaluate(scene, &motion, &points, limit);
        let converged = round >= 2 && (current.outliers - outliers).abs() < 1e-9;
        outliers = current.outliers;
        if converged {
            break;
        }
        let adjust_options = AdjustOptions {
            likelihood: PixelLikelihood::Huber(width * 4.0 * settings.noise),
            steps: if round == 0 { 25 } else { 8 },
            tolerance: if round < 1 { 1e-3 } else { 1e-5 },
        };
        cost = adjust(scene, &mut motion, &mut points, &adjust_options)?.cost;
    }
    let residuals = gate_and_evaluate(scene, &motion, &points, INLIER_GATE * settings.noise);
    Some(ModelFit {
        motion,
        points,
        residuals,
        cost,
    })
}

/// The fit with spherical inertia, if the images support no other shape; otherwise `fit`.
pub fn prefer_sphere<const L: usize, const G: usize, M: PoseModel<L, G> + TumblingModel>(
    scene: &Scene,
    fit: ModelFit<M>,
    settings: &SolverSettings,
) -> ModelFit<M> {
    if fit.motion.nutation() > SMALL_NUTATION {
        return fit;
    }
    let Some(mut motion) = fit.motion.with_spherical_inertia() else {
        return fit;
    };
    let adjust_options = AdjustOptions {
        likelihood: PixelLikelihood::Huber(4.0 * settings.noise),
        steps: 6,
        tolerance: 1e-4,
    };
    let mut points = fit.points.clone();
    let gain = SHAPE_GAIN * fit.residuals.deviation.powi(2);
    match adjust(scene, &mut motion, &mut points, &adjust_options) {
        Some(reached) if reached.cost < fit.cost + gain => ModelFit {
            motion,
            points,
            cost: reached.cost,
            ..fit
        },
        _ => fit,
    }
}

/// Refines the fit with the likelihood of rounded pixels, if the pixels are whole numbers and the noise before
/// rounding is less than the rounding error. Returns the likelihood that the fit maximises.
pub fn refine_with_rounding<const L: usize, const G: usize, M: PoseModel<L, G> + Clone>(
    scene: &Scene,
    fit: &mut ModelFit<M>,
    settings: &SolverSettings,
) -> PixelLikelihood {
    let mut likelihood = PixelLikelihood::Huber(4.0 * settings.noise);
    if !scene.is_rounded() {
        return likelihood;
    }
    let variance = fit.residuals.rms.powi(2).max(f64::MIN_POSITIVE);
    let gaussian = 0.5 * (1.0 + (std::f64::consts::TAU * variance).ln());
    let unknowns = unknowns(scene, &fit.motion);
    let mut least = f64::INFINITY;
    let (mut motion, mut points) = (fit.motion.clone(), fit.points.clone());
    for scale in NOISE_SCALES {
        let rounding = Rounding::new(0.5, scale, settings.noise.powi(2));
        let tried = PixelLikelihood::Rounded(rounding);
        let adjust_options = AdjustOptions {
            likelihood: tried,
            // Near the separatrix, six steps and 1e-3 end many deviations away from the least cost.
            steps: 30,
            tolerance: 1e-5,
        };
        if adjust(scene, &mut motion, &mut points, &adjust_options).is_none() {
            break;
        }
        let (mut sum, mut bounded, mut count) = (0.0, 0.0, 0usize);
        each_inlier_residual(scene, &motion, &points, |r| {
            sum += rounding.negative_log_density(r);
            bounded += rounding.bounded(r);
            count += 1;
        });
        let negative_log_density = sum / count.max(1) as f64;
        if negative_log_density > least || bounded < BOUNDED_PER_UNKNOWN * unknowns {
            break;
        }
        least = negative_log_density;
        if negative_log_density < gaussian {
            likelihood = tried;
            (fit.motion, fit.points) = (motion.clone(), points.clone());
        }
    }
    likelihood
}

/// Factor between the inverse of a fit's information and its covariance \[px²\]: the mean square of the cost's slopes
/// over the mean of its curvatures. Unlike least squares, the likelihood of rounding needs no correction for degrees of
/// freedom: the fit moves coordinates away from the edges of their pixels, which reduces the curvatures as well as the
/// slopes, and so already increases the inverse of the information.
pub fn dispersion<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    fit: &ModelFit<M>,
    likelihood: &PixelLikelihood,
) -> f64 {
    let PixelLikelihood::Rounded(_) = likelihood else {
        return fit.residuals.deviation.powi(2);
    };
    let (mut squares, mut curvature) = (0.0, 0.0);
    each_inlier_residual(scene, &fit.motion, &fit.points, |r| {
        let expansion = likelihood.expand(r);
        squares += expansion.slope.norm_squared();
        curvature += expansion.curvature.sum();
    });
    squares / curvature
}
