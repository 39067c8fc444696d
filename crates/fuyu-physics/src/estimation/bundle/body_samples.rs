//! Samples of bodies with different inertia that explain the same images, drawn where the images do not determine the
//! inertia.
//!
//! After a short rotation, or one about nearly one axis, the estimate is one of many bodies, and its linearised
//! covariance does not describe how differently the others go on rotating. So the fit is repeated for samples by randomized
//! maximum likelihood (Oliver, He and Reynolds 1996, Conditioning permeability fields to pressure data): each sample has its
//! own prior mean of the inertia's shape, drawn from the prior, and random errors added to the images and to the expected
//! centre of mass. In a linear problem the samples would be distributed like the posterior of the shape; here each
//! fits its own images. Errors that are not drawn (priors of torques, path and camera) are covered by a linearised
//! covariance, and so are rounding errors of pixels, which added noise would not represent.
//!
//! After a short rotation, samples start from other shapes and are fitted to the images first, so they are a global search
//! as well. Minima are compared by their evidence (Laplace's approximation: likelihood times the square root of the
//! covariance's determinant), not by their least cost: an extremely thin rod may cost least, but only with exactly one
//! inertia. After other rotations all samples start from the estimate, and have equal weights.

use nalgebra::{SMatrix, SVector, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::adjust::{AdjustOptions, adjust};
use super::disturbed_fit::{EvaluatedFit, information_of};
use super::free_motion::{SHAPE_SPREAD, shape_of};
use super::information::Inverse;
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::PoseModel;
use super::pose_model::disturbed::DisturbedMotion;
use super::scene::Scene;
use crate::estimation::motion_state::OtherMotions;

/// Samples are drawn if a standard deviation of the shape exceeds this. The norm of a thin plate's shape is 0.9.
const OPEN: f64 = 0.15;

/// A rotation by less than this \[rad\] may fit more than one region of shapes, so the samples start in all of them.
const SHORT: f64 = 3.0;

/// Number of samples after a short rotation, after other rotations, and the least number.
const SAMPLES: usize = 20;
const AFTER_LONG: usize = 12;
const LEAST: usize = 8;

/// Largest number of image points in all samples together; only [`LEAST`] samples may exceed it.
const IMAGE_POINTS: usize = 100_000;

/// Number of image points above which a scene is large, and steps of an adjustment for small and for large ones.
const LARGE: usize = 4000;
const STEPS: [usize; 2] = [12, 6];

/// Steps of the adjustment to images with random errors, and of the adjustment to rounded pixels.
const STEPS_AFTER_ERRORS: usize = 6;
const STEPS_AFTER_ROUNDING: [usize; 2] = [6, 4];

/// Largest number of draws of a shape, until a body can have it.
const DRAWS: usize = 100;

/// Differences of the logarithm of the evidence. A sample that started at another shape and is worse than the estimate
/// by more than [`NOT_FOUND`] has found no minimum. A sample has full weight if it is worse than the best by no more
/// than [`AS_GOOD`], and none if it is worse by [`NEGLIGIBLE`] more. A sample that is better than the estimate by
/// [`BETTER`] replaces it.
const NOT_FOUND: f64 = 4.0;
const AS_GOOD: f64 = 2.0;
const BETTER: f64 = 0.5;
const NEGLIGIBLE: f64 = 7.0;

/// A body, fitted to the images or about to be.
struct Sample {
    model: DisturbedMotion,
    points: Vec<Vector3<f64>>,
    /// Logarithm of its evidence: without the prior of the shape, and with the nominal prior of the shape (mean zero).
    log_evidence: f64,
    log_posterior: f64,
}

/// Fits of one scene.
struct Sampler<'a> {
    scene: &'a Scene,
    /// Assumed image noise \[px\].
    noise: f64,
    /// Variance of the image noise, including the factor for time-correlated errors \[px²\].
    variance: f64,
    /// Steps of an adjustment.
    steps: usize,
}

impl Sampler<'_> {
    /// Adjusts `model` and `points` and evaluates the evidence.
    fn fitted<const L: usize, const G: usize>(
        &self,
        mut model: DisturbedMotion,
        mut points: Vec<Vector3<f64>>,
    ) -> Option<Sample>
    where
        DisturbedMotion: PoseModel<L, G>,
    {
        let (scene, variance) = (self.scene, self.variance);
        let likelihood = PixelLikelihood::Huber(4.0 * self.noise);
        let adjust_options = AdjustOptions {
            likelihood,
            steps: self.steps,
            tolerance: 1e-4,
        };
        let reached = adjust::<L, G, _>(scene, &mut model, &mut points, &adjust_options)?;
        let (weights, distances) = PoseModel::<L, G>::prior(&model);
        let of_shape: f64 = (0..5).map(|k| weights[k] * distances[k].powi(2)).sum();
        let of_images = reached.cost - 0.5 * of_shape;
        let shape_weight = 0.5 * (self.noise / SHAPE_SPREAD).powi(2);
        let prior = shape_weight * shape_of(&model.motion.inertia).norm_squared();
        let information = information_of::<L, G>(scene, &model, &points, &likelihood, variance)?;
        let log_volume = Inverse::of(&information)?.log_volume;
        Some(Sample {
            log_evidence: log_volume - of_images / variance,
            log_posterior: log_volume - (of_images + prior) / variance,
            model,
            points,
        })
    }
}

/// The largest standard deviation of the shape in any direction, from a covariance of the common unknowns.
fn widest_of_shape<const G: usize>(covariance: &SMatrix<f64, G, G>) -> f64 {
    let of_shape = covariance.fixed_view::<5, 5>(0, 0).into_owned();
    let eigenvalues = (of_shape + of_shape.transpose()).symmetric_eigenvalues();
    (eigenvalues.max() * 0.5).max(0.0).sqrt()
}

/// A shape drawn from its prior, and `model` with that shape; `None` if no body can have any of the drawn shapes.
fn drawn_body(
    model: &DisturbedMotion,
    rng: &mut StdRng,
) -> Option<(SVector<f64, 5>, DisturbedMotion)> {
    (0..DRAWS).find_map(|_| {
        let normal = |_, _| rng.sample::<f64, _>(StandardNormal);
        let shape = SVector::<f64, 5>::from_fn(normal) * SHAPE_SPREAD;
        Some((shape, model.with_shape(&shape)?))
    })
}

/// Samples of bodies that explain the same images.
pub struct BodySamples<const L: usize, const G: usize> {
    samples: Vec<Sample>,
    /// The largest `log_evidence` of the samples and the estimate, and the estimate's `log_posterior`.
    best: f64,
    estimate: f64,
    /// Variance of the image noise, including the factor for time-correlated errors \[px²\].
    variance: f64,
    is_large: bool,
}

impl<const L: usize, const G: usize> BodySamples<L, G>
where
    DisturbedMotion: PoseModel<L, G>,
{
    /// Draws samples after a short rotation, or if the images do not determine the shape; otherwise `None`. `noise` is
    /// the assumed image noise \[px\].
    pub fn draw(scene: &Scene, estimate: &EvaluatedFit<G>, noise: f64) -> Option<Self> {
        let fit = &estimate.fit;
        let is_short = fit.motion.turn() < SHORT;
        if !is_short && widest_of_shape(&estimate.covariance) < OPEN {
            return None;
        }
        let image_points = scene.observations().len();
        let is_large = image_points > LARGE;
        let variance = (estimate.lasting * fit.residuals.deviation.powi(2)).max(f64::MIN_POSITIVE);
        let sampler = Sampler {
            scene,
            noise,
            variance,
            steps: STEPS[usize::from(is_large)],
        };
        let own = sampler.fitted::<L, G>(fit.motion.clone(), fit.points.clone())?;
        let most = if is_short { SAMPLES } else { AFTER_LONG };
        let count = (IMAGE_POINTS / image_points.max(1)).clamp(LEAST, most);
        let mut rng = StdRng::seed_from_u64(11);
        let mut samples = Vec::with_capacity(count);
        for _ in 0..count {
            let Some((shape, there)) = drawn_body(&fit.motion, &mut rng) else {
                continue;
            };
            let model = own.model.with_expected_shape(&shape);
            if !is_short {
                samples.push(Sample {
                    model,
                    points: own.points.clone(),
                    ..own
                });
                continue;
            }
            let from_there = sampler.fitted::<L, G>(there, fit.points.clone());
            let found = from_there.filter(|s| s.log_evidence > own.log_evidence - NOT_FOUND);
            let from_here = || sampler.fitted::<L, G>(model, own.points.clone());
            samples.extend(found.or_else(from_here));
        }
        let evidences = samples.iter().map(|s| s.log_evidence);
        Some(Self {
            best: evidences.fold(own.log_evidence, f64::max),
            estimate: own.log_posterior,
            samples,
            variance,
            is_large,
        })
    }

    /// The sample with the largest posterior, and its points, if it is more probable than the estimate.
    pub fn more_probable(&self) -> Option<(DisturbedMotion, Vec<Vector3<f64>>)> {
        let best =
            (self.samples.iter()).max_by(|a, b| a.log_posterior.total_cmp(&b.log_posterior))?;
        let model = best.model.with_expected_shape(&SVector::zeros());
        (best.log_posterior > self.estimate + BETTER).then(|| (model, best.points.clone()))
    }

    /// Motions of the samples at the last frame. `covariance` is that of the common unknowns of `estimate`, which
    /// maximises `likelihood`.
    pub fn motions(
        &self,
        scene: &Scene,
        estimate: &DisturbedMotion,
        covariance: &SMatrix<f64, G, G>,
        likelihood: &PixelLikelihood,
    ) -> Option<OtherMotions> {
        let mut rng = StdRng::seed_from_u64(12);
        let mut motions = Vec::new();
        for sample in &self.samples {
            let log_weight = (sample.log_evidence - self.best + AS_GOOD).min(0.0);
            if log_weight > -NEGLIGIBLE
                && let Some(model) = self.with_errors(sample, scene, likelihood, &mut rng)
            {
                motions.push((log_weight.exp(), model.last_state::<G>().0));
            }
        }
        let all: f64 = motions.iter().map(|(weight, _)| weight).sum();
        for (weight, _) in &mut motions {
            *weight /= all;
        }
        // Covariance of the errors that the samples do not vary: errors of images and of all priors but the shape's
        // (rounded pixels), or of the other priors only. Errors of the mean of a prior with information Λ contribute C
        // Λ C to the covariance C.
        let deviations = estimate.deviations::<L, G>(estimate.scales);
        let information = |is_wanted: fn(usize) -> bool| {
            let of = |k: usize, _| match is_wanted(k) {
                true => deviations[k].max(1e-9).powi(-2),
                false => 0.0,
            };
            SMatrix::<f64, G, G>::from_diagonal(&SVector::<f64, G>::from_fn(of))
        };
        let of_common = match likelihood {
            PixelLikelihood::Rounded(_) => {
                covariance - covariance * information(|k| k < 5) * covariance
            }
            PixelLikelihood::Huber(_) => covariance * information(|k| k >= 5) * covariance,
        };
        let by_common = estimate.last_state::<G>().2;
        let conditional = by_common * of_common * by_common.transpose();
        (all > 0.0).then(|| OtherMotions {
            motions,
            conditional: (conditional + conditional.transpose()) * 0.5,
        })
    }

    /// The sample after adjustment to images with random errors, or to rounded pixels without added errors.
    fn with_errors(
        &self,
        sample: &Sample,
        scene: &Scene,
        likelihood: &PixelLikelihood,
        rng: &mut StdRng,
    ) -> Option<DisturbedMotion> {
        let (mut model, mut points) = (sample.model.clone(), sample.points.clone());
        let adjusted = |steps| AdjustOptions {
            likelihood: *likelihood,
            steps,
            tolerance: 1e-4,
        };
        match likelihood {
            PixelLikelihood::Rounded(_) => {
                let adjust_options = adjusted(STEPS_AFTER_ROUNDING[usize::from(self.is_large)]);
                adjust::<L, G, _>(scene, &mut model, &mut points, &adjust_options)?;
            }
            PixelLikelihood::Huber(_) => {
                let adjust_options = adjusted(STEPS_AFTER_ERRORS);
                let other = scene.with_random_errors(self.variance.sqrt(), rng);
                adjust::<L, G, _>(&other, &mut model, &mut points, &adjust_options)?;
            }
        }
        Some(model)
    }
}
