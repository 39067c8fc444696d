//! A motion fitted to a scene: adjusted, judged, made no more complicated than it need be.

use nalgebra::{UnitQuaternion, Vector3};

use super::adjust::{AdjustOptions, PoseModel, adjust};
use super::pixel_likelihood::{PixelLikelihood, Rounding};
use super::scene::{Scene, residual};
use super::structure::{INLIER_GATE, SolverSettings};
use super::uncertainty::Residuals;

/// Below this angle between angular velocity and momentum \[rad\] it is asked whether there is any.
const SLIGHT_NUTATION: f64 = 0.05;

/// By how much a shape must lower the cost (in units of the noise) to be believed rather than a sphere: its five
/// parameters lower it by 2.5 if there is nothing to see.
const WORTH: f64 = 20.0;

/// Noise before rounding that is tried, in pixels: ever less, as long as the images become more likely.
const SOFTNESS: [f64; 3] = [0.06, 0.02, 0.007];

/// So many coordinates next to the edges of their pixels must there be for each unknown.
const BOUNDED: f64 = 0.7;

/// A motion of which it may be asked whether another looks alike.
pub trait TumblingModel: Sized {
    /// By how much the body turns over all frames \[rad\].
    fn turn(&self) -> f64;
    /// Angular velocity in the frame in the middle, inertial axes \[rad/s\].
    fn rate(&self) -> Vector3<f64>;
    /// Body axes in camera axes in the frame in the middle.
    fn middle(&self) -> UnitQuaternion<f64>;
    /// With a sphere as the body, its origin at `centre` (body axes), and so much less of the rate across the line of
    /// observation as depths become more.
    fn with_depths(&self, times: f64, centre: &Vector3<f64>) -> Option<Self>;
    /// How far the angular velocity leans from the momentum \[rad\].
    fn nutation(&self) -> f64;
    /// The same with a sphere as the body.
    fn spherical(&self) -> Option<Self>;
}

/// A motion and the points that belong to it.
#[derive(Debug, Clone)]
pub struct ModelFit<M> {
    /// The motion.
    pub motion: M,
    /// The points.
    pub points: Vec<Vector3<f64>>,
    /// How well the images are explained.
    pub residuals: Residuals,
    /// ½ Σ of the losses \[px²\].
    pub cost: f64,
}

/// Fits from a start that may be off by much: each round believes what is less far off than in the one before.
pub fn settle<const L: usize, const G: usize, M: PoseModel<L, G>>(
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
        let now = judge(scene, &motion, &points, limit);
        let settled = round >= 2 && (now.outliers - outliers).abs() < 1e-9;
        outliers = now.outliers;
        if settled {
            break;
        }
        let adjust_options = AdjustOptions {
            loss: PixelLikelihood::Huber(width * 4.0 * settings.noise),
            steps: if round == 0 { 25 } else { 8 },
            tolerance: if round < 1 { 1e-3 } else { 1e-5 },
        };
        cost = adjust(scene, &mut motion, &mut points, &adjust_options)?.cost;
    }
    let residuals = judge(scene, &motion, &points, INLIER_GATE * settings.noise);
    Some(ModelFit {
        motion,
        points,
        residuals,
        cost,
    })
}

/// The fit with a sphere as the body if the images do not ask for more.
pub fn simplest<const L: usize, const G: usize, M: PoseModel<L, G> + TumblingModel>(
    scene: &Scene,
    fit: ModelFit<M>,
    settings: &SolverSettings,
) -> ModelFit<M> {
    if fit.motion.nutation() > SLIGHT_NUTATION {
        return fit;
    }
    let Some(mut motion) = fit.motion.spherical() else {
        return fit;
    };
    let adjust_options = AdjustOptions {
        loss: PixelLikelihood::Huber(4.0 * settings.noise),
        steps: 6,
        tolerance: 1e-4,
    };
    let mut points = fit.points.clone();
    let worth = WORTH * fit.residuals.deviation.powi(2);
    match adjust(scene, &mut motion, &mut points, &adjust_options) {
        Some(reached) if reached.cost < fit.cost + worth => ModelFit {
            motion,
            points,
            cost: reached.cost,
            ..fit
        },
        _ => fit,
    }
}

/// Refines the fit by what rounding tells, if the pixels are whole and the noise before rounding is less than what
/// rounding does. The loss that it minimises then.
pub fn sharpen<const L: usize, const G: usize, M: PoseModel<L, G> + Clone>(
    scene: &Scene,
    fit: &mut ModelFit<M>,
    settings: &SolverSettings,
) -> PixelLikelihood {
    let mut loss = PixelLikelihood::Huber(4.0 * settings.noise);
    if !scene.is_rounded() {
        return loss;
    }
    let variance = fit.residuals.rms.powi(2).max(f64::MIN_POSITIVE);
    let gaussian = 0.5 * (1.0 + (std::f64::consts::TAU * variance).ln());
    let unknowns = unknowns::<L, G>(scene);
    let mut least = f64::INFINITY;
    let (mut motion, mut points) = (fit.motion.clone(), fit.points.clone());
    for softness in SOFTNESS {
        let rounding = Rounding::new(0.5, softness, settings.noise.powi(2));
        let tried = PixelLikelihood::Rounded(rounding);
        let adjust_options = AdjustOptions {
            loss: tried,
            steps: 6,
            tolerance: 1e-3,
        };
        if adjust(scene, &mut motion, &mut points, &adjust_options).is_none() {
            break;
        }
        let (mut sum, mut bounded, mut count) = (0.0, 0.0, 0usize);
        each_residual(scene, &motion, &points, |r| {
            sum += rounding.surprise(r);
            bounded += rounding.bounded(r);
            count += 1;
        });
        let surprise = sum / count.max(1) as f64;
        if surprise > least || bounded < BOUNDED * unknowns {
            break;
        }
        least = surprise;
        if surprise < gaussian {
            loss = tried;
            (fit.motion, fit.points) = (motion.clone(), points.clone());
        }
    }
    loss
}

/// Covariance of a fit by `loss` over the inverse of its information \[px²\]: the residuals' squared slopes over
/// their curvatures.
pub fn dispersion<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    fit: &ModelFit<M>,
    loss: &PixelLikelihood,
) -> f64 {
    let PixelLikelihood::Rounded(rounding) = loss else {
        return fit.residuals.deviation.powi(2);
    };
    let (mut squares, mut curvature, mut bounded) = (0.0, 0.0, 0.0);
    each_residual(scene, &fit.motion, &fit.points, |r| {
        let expansion = loss.expand(r);
        squares += expansion.slope.norm_squared();
        curvature += expansion.curvature.sum();
        bounded += rounding.bounded(r);
    });
    // What the unknowns could fit of the few that bound them is not seen in their slopes.
    let unknowns = unknowns::<L, G>(scene);
    squares / curvature * (1.0 + unknowns / f64::max(bounded, 1.0))
}

/// How many unknowns a fit to the scene has.
fn unknowns<const L: usize, const G: usize>(scene: &Scene) -> f64 {
    (L * scene.len() + 3 * scene.points + G) as f64
}

/// Calls `visit` with every believed residual \[px\].
fn each_residual<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &M,
    points: &[Vector3<f64>],
    mut visit: impl FnMut(&nalgebra::Vector2<f64>),
) {
    let focal = scene.focal * motion.log_focal().exp();
    for i in 0..scene.len() {
        let pose = motion.pose(i);
        let R = pose.R_CB.to_rotation_matrix();
        for observation in scene.frame(i).iter().filter(|s| s.inlier) {
            let x = R * points[observation.point] + pose.t_C;
            if let Some(r) = residual(&focal, &x, &observation.pixel) {
                visit(&r);
            }
        }
    }
}

/// Believes what is less than `limit` \[px\] off; how far off it is.
fn judge<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &mut Scene,
    motion: &M,
    points: &[Vector3<f64>],
    limit: f64,
) -> Residuals {
    let focal = scene.focal * motion.log_focal().exp();
    let (mut sum, mut kept, mut all) = (0.0, 0usize, 0usize);
    for i in 0..scene.len() {
        let pose = motion.pose(i);
        let R = pose.R_CB.to_rotation_matrix();
        for observation in scene.frame_mut(i) {
            let x = R * points[observation.point] + pose.t_C;
            let off = residual(&focal, &x, &observation.pixel).map(|r| r.norm_squared());
            observation.inlier = off.is_some_and(|o| o < limit * limit);
            all += 1;
            if let Some(off) = off.filter(|_| observation.inlier) {
                kept += 1;
                sum += off;
            }
        }
    }
    let freedom = (2.0 * kept as f64 - unknowns::<L, G>(scene)).max(1.0);
    Residuals {
        rms: (sum / (2 * kept.max(1)) as f64).sqrt(),
        deviation: (sum / freedom).sqrt(),
        outliers: 1.0 - kept as f64 / all.max(1) as f64,
    }
}
