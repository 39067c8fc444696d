//! Spread of the predictions over other inertias that explain the same images.
//!
//! After a rotation about nearly one axis the images hardly determine the inertia. The estimate is then a sphere, or
//! any other body near the prior's mean, and its linearised covariance does not describe how differently other bodies
//! go on rotating: a nutation that the images do not show grows or turns. So the fit is repeated with shapes drawn
//! from the covariance. Each gets the weight of its likelihood, and the spread of the motions is part of the
//! covariance of a prediction.

use nalgebra::{SMatrix, SVector, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::adjust::{AdjustOptions, adjust};
use super::free_motion::{FreeMotion, SHAPE_SPREAD, shape_of};
use super::model_fit::ModelFit;
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::PoseModel;
use super::pose_model::disturbed::Disturbed;
use super::scene::Scene;

/// A standard deviation of the shape above which other shapes are tried. The norm of a thin plate's shape is 0.9.
const LOOSE: f64 = 0.15;

/// Number of shapes, and for large scenes.
const SHAPES: usize = 12;
const FEW: usize = 8;

/// Number of image points above which a scene is large.
const LARGE: usize = 4000;

/// Standard deviation that holds a shape while everything else is adjusted.
const HELD: f64 = 0.08;

/// Other bodies, and the covariance of the unknowns if the shape were one of them.
pub struct OtherShapes<const G: usize> {
    /// Motions at the last frame with their weights, whose sum with that of the estimate is one.
    pub motions: Vec<(f64, FreeMotion)>,
    /// Covariance of the common unknowns for a known shape.
    pub conditional: SMatrix<f64, G, G>,
}

/// Fits bodies of other shapes, if the `covariance` of the common unknowns leaves the shape open. `None` if it does
/// not, or no other body explains the images. `lasting` is the factor on the variance of the images for errors that last.
pub fn other_shapes<const L: usize, const G: usize>(
    scene: &Scene,
    fit: &ModelFit<Disturbed>,
    covariance: &SMatrix<f64, G, G>,
    noise: f64,
    lasting: f64,
) -> Option<OtherShapes<G>>
where
    Disturbed: PoseModel<L, G>,
{
    let of_shape = covariance.fixed_view::<5, 5>(0, 0).into_owned();
    let eigen = (of_shape + of_shape.transpose())
        .scale(0.5)
        .symmetric_eigen();
    if eigen.eigenvalues.max() < LOOSE * LOOSE {
        return None;
    }
    let root = eigen.eigenvectors
        * SMatrix::<f64, 5, 5>::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()));
    let count = match scene.observations().len() > LARGE {
        true => FEW,
        false => SHAPES,
    };
    let adjust_options = AdjustOptions {
        likelihood: PixelLikelihood::Huber(4.0 * noise),
        steps: 8,
        tolerance: 1e-5,
    };
    let variance = (lasting * fit.residuals.deviation.powi(2)).max(f64::MIN_POSITIVE);
    let of_images = |cost: f64, model: &Disturbed| {
        let (weights, distances) = PoseModel::<L, G>::prior(model);
        let of_shape: f64 = (0..5).map(|k| weights[k] * distances[k].powi(2)).sum();
        cost - 0.5 * of_shape
    };
    // The estimate, adjusted in the same way.
    let (mut model, mut points) = (fit.motion.clone(), fit.points.clone());
    let reached = adjust::<L, G, _>(scene, &mut model, &mut points, &adjust_options)?;
    let least = of_images(reached.cost, &model);
    let mut rng = StdRng::seed_from_u64(11);
    let nominal = shape_of(&fit.motion.motion.inertia);
    let mut motions = Vec::new();
    let mut draw = SVector::<f64, 5>::zeros();
    for k in 0..count {
        draw = match k % 2 {
            0 => SVector::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal)),
            _ => -draw,
        };
        let Some(mut other) = possible(&fit.motion, &nominal, &(root * draw)) else {
            continue;
        };
        let mut points: Vec<Vector3<f64>> = fit.points.clone();
        let adjusted = adjust::<L, G, _>(scene, &mut other, &mut points, &adjust_options);
        let Some(reached) = adjusted else { continue };
        let excess = (of_images(reached.cost, &other) - least) / variance;
        let weight = (-excess).clamp(-40.0, 3.0).exp();
        motions.push((weight, other.last_state::<G>().0));
    }
    let all: f64 = 1.0 + motions.iter().map(|(weight, _)| weight).sum::<f64>();
    let squares: f64 = 1.0
        + motions
            .iter()
            .map(|(weight, _)| weight * weight)
            .sum::<f64>();
    for (weight, _) in &mut motions {
        *weight /= all;
    }
    // With few bodies of a likelihood near the best one, the linearised covariance of the shape counts instead.
    let share = ((all * all / squares - 1.0) / 4.0).clamp(0.0, 1.0);
    let by_shape = covariance.fixed_columns::<5>(0).into_owned();
    let held = of_shape + SMatrix::<f64, 5, 5>::identity() * (HELD * HELD);
    let known = covariance - by_shape * held.try_inverse()? * by_shape.transpose();
    Some(OtherShapes {
        motions,
        conditional: covariance * (1.0 - share) + known * share,
    })
}

/// The model with another shape, the nearest to it that a body can have.
fn possible(
    model: &Disturbed,
    nominal: &SVector<f64, 5>,
    step: &SVector<f64, 5>,
) -> Option<Disturbed> {
    [1.0, 0.75, 0.5, 0.25].into_iter().find_map(|part| {
        let step = step * (part * (SHAPE_SPREAD * 2.5 / step.norm().max(1e-9)).min(1.0));
        model.with_shape(&(nominal + step), HELD)
    })
}
