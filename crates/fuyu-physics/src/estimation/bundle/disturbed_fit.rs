//! The last stage of the global adjustment: a fit with disturbances, and the state at the last frame with its
//! covariance.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::CentreMotion;
use super::adjust::{AdjustOptions, adjust, reduced_normal};
use super::autocorrelation_factor::autocorrelation_factor;
use super::body_samples::BodySamples;
use super::free_motion::SHAPE_SPREAD;
use super::information::Inverse;
use super::inlier_gate::{INLIER_GATE, gate_and_evaluate};
use super::intrinsics::INTRINSICS;
use super::model_fit::{ModelFit, dispersion, refine_with_rounding};
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::disturbed::{DisturbedMotion, Scales};
use super::pose_model::{FramePose, PoseModel};
use super::prior_scales::best_scales;
use super::scene::Scene;
use super::structure::SolverSettings;
use crate::estimation::motion_state::{MotionState, StateCovariance};

/// Rounds of adjustment and selection of the prior widths.
const ROUNDS: usize = 2;

/// A solution of the rounding likelihood is trusted if its attitude and momentum differ from those of least squares by
/// less than this many standard deviations of the latter.
const AGREEING: f64 = 5.0;

/// A sphere is kept as the estimate unless another shape lowers the cost by more than this (in units of the noise
/// variance): half the 95 % point of a chi-squared variable of five degrees of freedom.
const SHAPE_GAIN: f64 = 5.5;

/// Largest number of searches for a more probable body, and the difference of the costs below which two minima are the
/// same (in units of the noise variance).
const SEARCHES: usize = 4;
const NEARBY: f64 = 3.0;

/// The fit and its results for the last frame.
pub struct DisturbedFit {
    /// The model.
    pub model: DisturbedMotion,
    /// The points in body axes.
    pub points: Vec<Vector3<f64>>,
    /// Covariance of each point in body axes; empty if not requested.
    pub point_covariances: Vec<Matrix3<f64>>,
    /// Statistics of the residuals.
    pub residuals: super::inlier_gate::Residuals,
    /// Factor on the image variance for time-correlated errors; the covariances include it.
    pub lasting: f64,
    /// Poses by frame.
    pub poses: Vec<FramePose>,
    /// State at the last frame; its covariance is not yet inflated.
    pub state: MotionState,
    /// Position and velocity of the centre of mass at the last frame; `None` unless the path is smooth.
    pub centre: Option<CentreMotion>,
    /// Standard deviations of the intrinsics.
    pub intrinsic_deviations: SVector<f64, INTRINSICS>,
}

/// A fit with the prior widths that the images support.
#[derive(Debug, Clone)]
pub struct EvaluatedFit<const G: usize> {
    /// The fit.
    pub fit: ModelFit<DisturbedMotion>,
    /// Factor on the image variance for time-correlated errors.
    pub lasting: f64,
    /// Covariance of the common unknowns.
    pub covariance: SMatrix<f64, G, G>,
}

/// Options of the adjustments of this stage.
fn adjust_options(settings: &SolverSettings) -> AdjustOptions {
    AdjustOptions {
        likelihood: PixelLikelihood::Huber(4.0 * settings.noise),
        steps: 8,
        tolerance: 1e-5,
    }
}

/// Fits `start` with disturbances and evaluates it. `None` if the normal equations cannot be solved.
pub fn fit_with_disturbances<const L: usize, const G: usize>(
    scene: &mut Scene,
    start: DisturbedMotion,
    points: Vec<Vector3<f64>>,
    settings: &SolverSettings,
    with_points: bool,
) -> Option<DisturbedFit>
where
    DisturbedMotion: PoseModel<L, G>,
{
    let likelihood = PixelLikelihood::Huber(4.0 * settings.noise);
    let (first, samples) = search::<L, G>(scene, start, points, settings)?;
    let lasting = first.lasting;
    let mut fit = first.fit.clone();
    let deviations = fit.motion.deviations::<L, G>(fit.motion.scales);
    let share =
        |k: usize| (first.covariance[(k, k)] / deviations[k].max(1e-9).powi(2)).clamp(0.0, 1.0);
    fit.motion.held = (0..G).map(share).sum();
    let by_least_squares = fit.clone();
    let mut rounding = refine_with_rounding::<L, G, _>(scene, &mut fit, settings);
    let mut covariance = first.covariance;
    if rounding != likelihood {
        let refined = covariance_of::<L, G>(scene, &fit, &rounding, lasting);
        let agrees = |refined: &SMatrix<f64, G, G>| {
            differs_by::<L, G>(&by_least_squares.motion, &fit.motion, &first.covariance) < AGREEING
                && refined.trace().is_finite()
        };
        match refined.filter(agrees) {
            Some(refined) => covariance = refined,
            None => (fit, rounding) = (by_least_squares, likelihood),
        }
    }
    let point_covariances = match with_points {
        true => {
            let variance = lasting * dispersion::<L, G, _>(scene, &fit, &rounding);
            let normal =
                reduced_normal::<L, G, _>(scene, &fit.motion, &fit.points, &rounding, true)?;
            normal.points.iter().map(|c| c * variance).collect()
        }
        false => Vec::new(),
    };
    let model = fit.motion;
    let (motion, acceleration, by_common) = model.last_state::<G>();
    let others = samples.and_then(|s| s.motions(scene, &model, &covariance, &rounding));
    let state: StateCovariance = by_common * covariance * by_common.transpose();
    let widths = model.widths();
    let walk = widths.acceleration * model.scales.torque * (2.0 / widths.correlation_time).sqrt();
    let deviations = SVector::<f64, INTRINSICS>::from_fn(|k, _| {
        let at = G - INTRINSICS + k;
        covariance[(at, at)].max(0.0).sqrt()
    });
    let centre = model
        .last_centre::<G>()
        .map(|(position, velocity, by_common)| {
            let spread: SMatrix<f64, 6, 6> = by_common * covariance * by_common.transpose();
            CentreMotion {
                position,
                velocity,
                covariance: (spread + spread.transpose()) * 0.5,
            }
        });
    let frames = model.times().len();
    Some(DisturbedFit {
        poses: (0..frames)
            .map(|i| PoseModel::<L, G>::pose(&model, i))
            .collect(),
        state: MotionState {
            motion,
            acceleration,
            covariance: (state + state.transpose()) * 0.5,
            acceleration_walk: walk,
            others,
        },
        centre,
        intrinsic_deviations: deviations,
        points: fit.points,
        point_covariances,
        residuals: fit.residuals,
        lasting,
        model,
    })
}

/// The most probable fit found from `start`, and samples of other bodies if the images do not determine the inertia.
fn search<const L: usize, const G: usize>(
    scene: &mut Scene,
    start: DisturbedMotion,
    points: Vec<Vector3<f64>>,
    settings: &SolverSettings,
) -> Option<(EvaluatedFit<G>, Option<BodySamples<L, G>>)>
where
    DisturbedMotion: PoseModel<L, G>,
{
    let adjust_options = adjust_options(settings);
    let limit = INLIER_GATE * settings.noise;
    let (mut model, mut points) = (start, points);
    let mut cost = adjust::<L, G, _>(scene, &mut model, &mut points, &adjust_options)?.cost;
    if model.shape_spread < SHAPE_SPREAD {
        let residuals = gate_and_evaluate::<L, G, _>(&mut scene.clone(), &model, &points, limit);
        let (mut other, mut moved) = (model.clone(), points.clone());
        other.shape_spread = SHAPE_SPREAD;
        let reached = adjust::<L, G, _>(scene, &mut other, &mut moved, &adjust_options);
        let gain = SHAPE_GAIN * residuals.deviation.powi(2);
        if let Some(reached) = reached.filter(|r| r.cost + gain < cost) {
            (model, points, cost) = (other, moved, reached.cost);
        }
    }
    let mut found = with_chosen_widths::<L, G>(scene, model, points, cost, settings)?;
    let mut samples = BodySamples::<L, G>::draw(scene, &found, settings.noise);
    for _ in 0..SEARCHES {
        let Some((mut model, mut points)) = samples.as_ref().and_then(BodySamples::more_probable)
        else {
            break;
        };
        let adjust_options = AdjustOptions {
            steps: 40,
            ..adjust_options
        };
        let reached = adjust::<L, G, _>(scene, &mut model, &mut points, &adjust_options)?;
        let variance = found.lasting * found.fit.residuals.deviation.powi(2);
        let change = (found.fit.cost - reached.cost).abs();
        found = with_chosen_widths::<L, G>(scene, model, points, reached.cost, settings)?;
        // The same minimum: the samples remain valid.
        if change < NEARBY * variance {
            break;
        }
        samples = BodySamples::draw(scene, &found, settings.noise);
    }
    Some((found, samples))
}

/// Selects the prior widths by the evidence of the images, and adjusts again. `cost` is the cost of `model` before.
fn with_chosen_widths<const L: usize, const G: usize>(
    scene: &mut Scene,
    mut model: DisturbedMotion,
    mut points: Vec<Vector3<f64>>,
    mut cost: f64,
    settings: &SolverSettings,
) -> Option<EvaluatedFit<G>>
where
    DisturbedMotion: PoseModel<L, G>,
{
    let adjust_options = adjust_options(settings);
    let likelihood = adjust_options.likelihood;
    let limit = INLIER_GATE * settings.noise;
    for _ in 0..ROUNDS {
        let residuals = gate_and_evaluate::<L, G, _>(scene, &model, &points, limit);
        let lasting = autocorrelation_factor::<L, G, _>(scene, &model, &points);
        let variance = (lasting * residuals.deviation.powi(2)).max(f64::MIN_POSITIVE);
        let (hessian, gradient) = of_images::<L, G>(scene, &model, &points, &likelihood)?;
        let scales = best_scales(
            &(hessian / variance),
            &(gradient / variance),
            &model.distances::<L, G>(),
            |scales| model.deviations::<L, G>(scales),
            model.scales,
        );
        if scales == model.scales {
            break;
        }
        model.scales = scales;
        cost = adjust::<L, G, _>(scene, &mut model, &mut points, &adjust_options)?.cost;
    }
    let residuals = gate_and_evaluate::<L, G, _>(scene, &model, &points, limit);
    let lasting = autocorrelation_factor::<L, G, _>(scene, &model, &points);
    let fit = ModelFit {
        motion: model,
        points,
        residuals,
        cost,
    };
    Some(EvaluatedFit {
        covariance: covariance_of::<L, G>(scene, &fit, &likelihood, lasting)?,
        fit,
        lasting,
    })
}

/// Hessian and gradient of the images' cost without the priors, after elimination of all but the common unknowns
/// \[px²\].
fn of_images<const L: usize, const G: usize>(
    scene: &Scene,
    model: &DisturbedMotion,
    points: &[Vector3<f64>],
    likelihood: &PixelLikelihood,
) -> Option<(SMatrix<f64, G, G>, SVector<f64, G>)>
where
    DisturbedMotion: PoseModel<L, G>,
{
    let normal = reduced_normal::<L, G, _>(scene, model, points, likelihood, false)?;
    let (weights, distances) = PoseModel::<L, G>::prior(model);
    let hessian = normal.hessian - SMatrix::from_diagonal(&weights);
    Some((hessian, normal.gradient - weights.component_mul(&distances)))
}

/// Covariance of the common unknowns. `lasting` is the variance factor of time-correlated errors.
fn covariance_of<const L: usize, const G: usize>(
    scene: &Scene,
    fit: &ModelFit<DisturbedMotion>,
    likelihood: &PixelLikelihood,
    lasting: f64,
) -> Option<SMatrix<f64, G, G>>
where
    DisturbedMotion: PoseModel<L, G>,
{
    let dispersion = dispersion::<L, G, _>(scene, fit, likelihood);
    let variance = (lasting * dispersion).max(f64::MIN_POSITIVE);
    let information =
        information_of::<L, G>(scene, &fit.motion, &fit.points, likelihood, variance)?;
    Some(Inverse::of(&information)?.covariance)
}

/// Information matrix of the common unknowns: that of images with noise of this `variance` \[px²\] plus that of the
/// priors.
pub fn information_of<const L: usize, const G: usize>(
    scene: &Scene,
    model: &DisturbedMotion,
    points: &[Vector3<f64>],
    likelihood: &PixelLikelihood,
    variance: f64,
) -> Option<SMatrix<f64, G, G>>
where
    DisturbedMotion: PoseModel<L, G>,
{
    let normal = reduced_normal::<L, G, _>(scene, model, points, likelihood, false)?;
    let (weights, _) = PoseModel::<L, G>::prior(model);
    // The residuals scale the information of the images, not that of the priors.
    let deviations = model.deviations::<L, G>(model.scales);
    let mut information = (normal.hessian - SMatrix::from_diagonal(&weights)) / variance;
    for k in 0..G {
        information[(k, k)] += deviations[k].max(1e-9).powi(-2);
    }
    Some(information)
}

/// Mahalanobis distance of two models at the last frame, in attitude and momentum.
fn differs_by<const L: usize, const G: usize>(
    a: &DisturbedMotion,
    b: &DisturbedMotion,
    covariance: &SMatrix<f64, G, G>,
) -> f64
where
    DisturbedMotion: PoseModel<L, G>,
{
    let (from, _, by_common) = a.last_state::<G>();
    let (to, _, _) = b.last_state::<G>();
    let state: StateCovariance = by_common * covariance * by_common.transpose();
    // Momentum and attitude, which the images determine best.
    let turn: Vector3<f64> = (from.R_WB.inverse() * to.R_WB).scaled_axis();
    let momentum = to.momentum - from.momentum;
    let pick = |k: usize| if k < 3 { k } else { k + 5 };
    let spread = SMatrix::<f64, 6, 6>::from_fn(|i, j| state[(pick(i), pick(j))]);
    let off = SVector::<f64, 6>::from_fn(|k, _| if k < 3 { turn[k] } else { momentum[k - 3] });
    spread
        .cholesky()
        .map_or(f64::INFINITY, |c| off.dot(&c.solve(&off)).max(0.0).sqrt())
}

/// Notes for the user on prior widths that the images have increased.
pub fn describe(scales: &Scales, is_smooth: bool, acceleration: f64) -> Vec<String> {
    let mut notes = Vec::new();
    if scales.torque >= 10.0 {
        notes.push(format!(
            "torques act: angular accelerations of the order of {:.0e} rad/s² (usual: {acceleration:.0e}); predictions are less \
             certain for it",
            acceleration * scales.torque
        ));
    }
    if scales.other >= 10.0 {
        notes.push(if is_smooth {
            "the centre of mass does not move on a straight line: its path is fitted by a polynomial".to_owned()
        } else {
            format!(
                "the errors of the gyro are about {:.0} times as large as assumed",
                scales.other
            )
        });
    }
    notes
}
