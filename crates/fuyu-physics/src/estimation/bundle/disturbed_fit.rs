//! The last stage of the global adjustment: a fit with disturbances, and the state at the last frame with its
//! covariance.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::CentreMotion;
use super::adjust::{AdjustOptions, adjust, reduced_normal};
use super::free_motion::SHAPE_SPREAD;
use super::inlier_gate::{INLIER_GATE, gate_and_evaluate};
use super::intrinsics::INTRINSICS;
use super::lasting_errors::lasting_errors;
use super::model_fit::{ModelFit, dispersion, refine_with_rounding};
use super::other_shapes::other_shapes;
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::disturbed::{Disturbed, Scales};
use super::pose_model::{FramePose, PoseModel};
use super::prior_scales::best_scales;
use super::scene::Scene;
use super::structure::SolverSettings;
use crate::estimation::motion_state::{MotionState, OtherMotions, StateCovariance};

/// Rounds of adjustment and choice of the priors' widths.
const ROUNDS: usize = 2;

/// A solution of the rounding likelihood is trusted if it is as near to that of least squares as this, in standard
/// deviations of the latter, of eight parameters.
const AGREEING: f64 = 5.0;

/// A sphere is kept as the estimate unless another shape lowers the cost by more than this (in units of the noise
/// variance): half the 95 % point of a chi-squared variable of five degrees of freedom.
const SHAPE_GAIN: f64 = 5.5;

/// Information that is added to directions which vanish in rounding, relative to that of single unknowns.
const LEAST_INFORMATION: [f64; 4] = [0.0, 1e-14, 1e-12, 1e-10];

/// The fit and what it says about the last frame.
pub struct DisturbedFit {
    /// The model.
    pub model: Disturbed,
    /// Points, statistics of the residuals.
    pub points: Vec<Vector3<f64>>,
    /// Covariance of each point in body axes, in units of `factor`; empty if not wanted.
    pub point_covariances: Vec<Matrix3<f64>>,
    /// Statistics of the residuals.
    pub residuals: super::inlier_gate::Residuals,
    /// Factor on the variance of the images for errors that last; the covariances include it.
    pub lasting: f64,
    /// Poses by frame.
    pub poses: Vec<FramePose>,
    /// State at the last frame; its covariance is in units of `factor`, without inflation.
    pub state: MotionState,
    /// Position and velocity of the centre of mass at the last frame, with a smooth path.
    pub centre: Option<CentreMotion>,
    /// Standard deviations of the intrinsics.
    pub intrinsic_deviations: SVector<f64, INTRINSICS>,
}

/// Fits `start` with disturbances and evaluates it. `None` if the normal equations cannot be solved.
pub fn fit_with_disturbances<const L: usize, const G: usize>(
    scene: &mut Scene,
    start: Disturbed,
    points: Vec<Vector3<f64>>,
    settings: &SolverSettings,
    with_points: bool,
) -> Option<DisturbedFit>
where
    Disturbed: PoseModel<L, G>,
{
    let likelihood = PixelLikelihood::Huber(4.0 * settings.noise);
    let adjust_options = AdjustOptions {
        likelihood,
        steps: 8,
        tolerance: 1e-5,
    };
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
    for _ in 0..ROUNDS {
        let residuals = gate_and_evaluate::<L, G, _>(scene, &model, &points, limit);
        let lasting = lasting_errors::<L, G, _>(scene, &model, &points);
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
    let lasting = lasting_errors::<L, G, _>(scene, &model, &points);
    let mut fit = ModelFit {
        motion: model,
        points,
        residuals,
        cost,
    };
    let first = covariance_of::<L, G>(scene, &fit, &likelihood, lasting, false)?;
    let deviations = fit.motion.deviations::<L, G>(fit.motion.scales);
    let share = |k: usize| (first.0[(k, k)] / deviations[k].max(1e-9).powi(2)).clamp(0.0, 1.0);
    fit.motion.held = (0..G).map(share).sum();
    let by_least_squares = fit.clone();
    let mut rounding = refine_with_rounding::<L, G, _>(scene, &mut fit, settings);
    let mut found = first.clone();
    if rounding != likelihood {
        let refined = covariance_of::<L, G>(scene, &fit, &rounding, lasting, false);
        let agrees = |refined: &(SMatrix<f64, G, G>, Vec<Matrix3<f64>>)| {
            differs_by::<L, G>(&by_least_squares.motion, &fit.motion, &first.0) < AGREEING
                && refined.0.trace().is_finite()
        };
        match refined.filter(agrees) {
            Some(refined) => found = refined,
            None => {
                fit = by_least_squares.clone();
                rounding = likelihood;
            }
        }
    }
    if with_points {
        found.1 = covariance_of::<L, G>(scene, &fit, &rounding, lasting, true)?.1;
    }
    let (covariance, point_covariances) = found;
    let others = other_shapes::<L, G>(
        scene,
        &by_least_squares,
        &covariance,
        settings.noise,
        lasting,
    );
    let model = fit.motion;
    let (motion, acceleration, by_common) = model.last_state::<G>();
    let of_state = |covariance: &SMatrix<f64, G, G>| -> StateCovariance {
        let state = by_common * covariance * by_common.transpose();
        (state + state.transpose()) * 0.5
    };
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
            covariance: of_state(&covariance),
            acceleration_walk: walk,
            others: others.map(|others| OtherMotions {
                motions: others.motions,
                conditional: of_state(&others.conditional),
            }),
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

/// Hessian and gradient of the images' cost without the prior's, everything but the common unknowns eliminated \[px²\].
fn of_images<const L: usize, const G: usize>(
    scene: &Scene,
    model: &Disturbed,
    points: &[Vector3<f64>],
    likelihood: &PixelLikelihood,
) -> Option<(SMatrix<f64, G, G>, SVector<f64, G>)>
where
    Disturbed: PoseModel<L, G>,
{
    let normal = reduced_normal::<L, G, _>(scene, model, points, likelihood, false)?;
    let (weights, distances) = PoseModel::<L, G>::prior(model);
    let hessian = normal.hessian - SMatrix::from_diagonal(&weights);
    Some((hessian, normal.gradient - weights.component_mul(&distances)))
}

/// Covariance of the common unknowns, and of the points if wanted. `lasting` is the factor for errors that last.
fn covariance_of<const L: usize, const G: usize>(
    scene: &Scene,
    fit: &ModelFit<Disturbed>,
    likelihood: &PixelLikelihood,
    lasting: f64,
    with_points: bool,
) -> Option<(SMatrix<f64, G, G>, Vec<Matrix3<f64>>)>
where
    Disturbed: PoseModel<L, G>,
{
    let dispersion = dispersion::<L, G, _>(scene, fit, likelihood);
    let variance = (lasting * dispersion).max(f64::MIN_POSITIVE);
    let normal =
        reduced_normal::<L, G, _>(scene, &fit.motion, &fit.points, likelihood, with_points)?;
    let (weights, _) = PoseModel::<L, G>::prior(&fit.motion);
    // The residuals scale the information of the images, not that of the prior.
    let deviations = fit.motion.deviations::<L, G>(fit.motion.scales);
    let mut information = (normal.hessian - SMatrix::from_diagonal(&weights)) / variance;
    for k in 0..G {
        information[(k, k)] += deviations[k].max(1e-9).powi(-2);
    }
    let covariance = inverse(&information)?;
    let points = normal.points.iter().map(|c| c * variance).collect();
    Some((covariance, points))
}

/// Inverse of an information matrix. Near the separatrix the unknowns' information differs by many orders of
/// magnitude: the matrix is scaled to a unit diagonal, and directions that vanish in rounding get the least information
/// for which the factorisation succeeds.
fn inverse<const G: usize>(information: &SMatrix<f64, G, G>) -> Option<SMatrix<f64, G, G>> {
    let scale = SVector::<f64, G>::from_fn(|k, _| {
        let own = information[(k, k)];
        own.max(f64::MIN_POSITIVE).sqrt().recip()
    });
    let scaled = SMatrix::<f64, G, G>::from_fn(|i, j| {
        0.5 * (information[(i, j)] + information[(j, i)]) * scale[i] * scale[j]
    });
    LEAST_INFORMATION.into_iter().find_map(|least| {
        let factor = (scaled + SMatrix::identity() * least).cholesky()?;
        let inverse = factor.inverse();
        Some(SMatrix::from_fn(|i, j| {
            inverse[(i, j)] * scale[i] * scale[j]
        }))
    })
}

/// Distance of two models in standard deviations of the state at the last frame.
fn differs_by<const L: usize, const G: usize>(
    a: &Disturbed,
    b: &Disturbed,
    covariance: &SMatrix<f64, G, G>,
) -> f64
where
    Disturbed: PoseModel<L, G>,
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

/// Whether the model's scales differ from the nominal ones, as text.
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
