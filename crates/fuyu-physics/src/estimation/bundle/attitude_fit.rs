//! Fit of a torque-free rotation to measured attitudes, by least squares on the rotation group.

use std::cell::OnceCell;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned, SVector, UnitQuaternion, Vector3};

use super::free_motion::{FreeMotion, PARAMETERS, SHAPE_SPREAD, Sensitivity, shape_of};
use super::linear_inertia::AttitudeSample;
use super::rotations::{right_jacobian, right_jacobian_inverse};
use crate::spatial::exp_so3;

/// Largest number of attitudes that are fitted at once; the global adjustment uses all of them.
const MOST_SAMPLES: usize = 200;

/// Largest and smallest factor by which the fitted span grows.
const MAX_GROWTH: f64 = 2.0;
const MIN_GROWTH: f64 = 1.1;

/// A fit is wrong if its residual exceeds that of shorter spans by the first factor, and right below the second factor;
/// residuals below the third constant \[rad\] count as equal to it.
const WRONG_RATIO: f64 = 2.5;
const RIGHT_RATIO: f64 = 1.2;
const MIN_RESIDUAL: f64 = 2e-4;

/// Number of wrong fits before the growth is given up.
const PATIENCE: usize = 1;

/// Angles below this are not down-weighted when the span has just grown \[rad\].
const TOLERATED: f64 = 0.3;

/// A motion with a larger residual does not fit, and a longer span does not help \[rad\].
const LOST: f64 = 0.5;

/// A measured attitude, in the body axes of its segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentAttitude {
    /// Time, and attitude of the segment's axes in inertial axes.
    pub attitude: AttitudeSample,
    /// Index of the segment.
    pub segment: usize,
}

/// A fitted motion, with the axes of each segment in its body axes.
#[derive(Debug, Clone, PartialEq)]
pub struct AttitudeFit {
    /// The motion.
    pub motion: FreeMotion,
    /// `R_BS` of each segment.
    pub segments: Vec<UnitQuaternion<f64>>,
    /// Root mean square of the smallest nine tenths of the residual angles \[rad\].
    pub rms: f64,
    /// Largest distance from the motion's reference time at which it fits \[s\].
    pub span: f64,
    /// Whether the motion fits all samples.
    pub fits_all: bool,
}

/// Fits the motion to `samples` (in the order of time). The start need only be right near its reference time: the
/// fitted span grows until it contains all samples. Near the separatrix errors grow exponentially; where the fit
/// becomes worse, the span grows more slowly. If no fit contains all samples, returns the fit with the longest span
/// that was right.
pub fn fit_attitudes(
    start: &FreeMotion,
    samples: &[SegmentAttitude],
    segments: usize,
) -> Option<AttitudeFit> {
    let mut current = AttitudeFit {
        motion: *start,
        segments: vec![UnitQuaternion::identity(); segments],
        rms: f64::INFINITY,
        span: 0.0,
        fits_all: true,
    };
    let distance = |s: &SegmentAttitude| (s.attitude.time - start.time).abs();
    let full_span = samples.iter().map(distance).fold(0.0, f64::max);
    // Two revolutions are short enough for any start.
    let rate = start.w_WB_B(&start.R_WB).norm();
    let mut span = (12.0 / rate.max(1e-9)).max(0.02 * full_span).min(full_span);
    let mut known = vec![false; segments];
    let mut growth = MAX_GROWTH;
    let (mut least, mut worse) = (f64::INFINITY, 0);
    let mut longest = None;
    loop {
        let previous = (current.clone(), known.clone());
        let within: Vec<SegmentAttitude> = samples
            .iter()
            .filter(|s| distance(s) <= span)
            .copied()
            .collect();
        align(&mut current, &within, &mut known);
        let stride = within.len().div_ceil(MOST_SAMPLES);
        let within: Vec<SegmentAttitude> = within.into_iter().step_by(stride.max(1)).collect();
        for tolerated in [TOLERATED, 0.0] {
            current = improve(current, &within, tolerated)?;
        }
        current.fits_all = current.rms < WRONG_RATIO * least.max(MIN_RESIDUAL);
        if !current.fits_all && growth > MIN_GROWTH {
            let reached = span / growth;
            (current, known) = previous;
            growth = 1.0 + 0.4 * (growth - 1.0);
            span = growth * reached;
            continue;
        }
        if current.rms < RIGHT_RATIO * least.max(MIN_RESIDUAL) {
            current.span = span;
            longest = Some(AttitudeFit {
                fits_all: false,
                ..current.clone()
            });
        }
        least = least.min(current.rms);
        worse += usize::from(!current.fits_all);
        if span >= full_span || worse > PATIENCE || current.rms > LOST {
            current.fits_all &= span >= full_span;
            // A fit to all samples, or the longest right fit, which samples beyond its span have not distorted.
            return if current.fits_all {
                Some(current)
            } else {
                longest
            };
        }
        growth = (1.2 * growth).min(MAX_GROWTH).min(full_span / span);
        span = (growth * span).min(full_span);
    }
}

/// Determines the axes of segments that come into the span, from the current motion.
fn align(fit: &mut AttitudeFit, samples: &[SegmentAttitude], known: &mut [bool]) {
    let times: Vec<f64> = samples.iter().map(|s| s.attitude.time).collect();
    let attitudes = fit.motion.attitudes(&times);
    for (segment, known) in known.iter_mut().enumerate().filter(|(_, k)| !**k) {
        let own = samples
            .iter()
            .zip(&attitudes)
            .filter(|(s, _)| s.segment == segment);
        // The attitudes nearest to the reference time, where the motion is most accurate.
        let mut turns: Vec<(f64, UnitQuaternion<f64>)> = own
            .map(|(s, R)| {
                (
                    (s.attitude.time - fit.motion.time).abs(),
                    R.inverse() * s.attitude.R_WB,
                )
            })
            .collect();
        turns.sort_by(|a, b| a.0.total_cmp(&b.0));
        turns.truncate(5);
        if let Some(mean) = median_rotation(&turns) {
            fit.segments[segment] = mean;
            *known = true;
        }
    }
}

/// The rotation with the least sum of angles to the others.
fn median_rotation(turns: &[(f64, UnitQuaternion<f64>)]) -> Option<UnitQuaternion<f64>> {
    let spread = |q: &UnitQuaternion<f64>| turns.iter().map(|(_, o)| o.angle_to(q)).sum::<f64>();
    let all = turns.iter().map(|(_, q)| *q);
    all.min_by(|a, b| spread(a).total_cmp(&spread(b)))
}

/// One iteration of least squares, weighted by the previous residuals; angles below `tolerated` \[rad\] keep full
/// weight.
fn improve(fit: AttitudeFit, samples: &[SegmentAttitude], tolerated: f64) -> Option<AttitudeFit> {
    let mut problem = Problem::new(fit, samples);
    let errors: Vec<f64> = (problem.errors().as_ref()?.iter().map(|e| e.norm())).collect();
    let mut sorted = errors.clone();
    sorted.sort_by(f64::total_cmp);
    let typical = sorted[sorted.len() / 2].max(3e-7);
    // The median length of a vector of three Gaussian errors is 1.5 standard deviations.
    problem.prior = typical / 1.5 / SHAPE_SPREAD;
    let width = (3.0 * typical).max(tolerated);
    problem.weights = errors
        .iter()
        .map(|e| 1.0 / (1.0 + (e / width).powi(2)).sqrt())
        .collect();
    // The global adjustment refines the result, so low tolerances suffice.
    let solver = LevenbergMarquardt::new()
        .with_patience(1)
        .with_ftol(1e-3)
        .with_xtol(1e-5)
        .with_gtol(0.0);
    let (solved, _) = solver.minimize(problem);
    let errors = solved.errors().as_ref()?;
    let mut squares: Vec<f64> = errors.iter().map(|e| e.norm_squared()).collect();
    squares.sort_by(f64::total_cmp);
    let most = &squares[..(9 * squares.len()).div_ceil(10)];
    let rms = (most.iter().sum::<f64>() / most.len() as f64).sqrt();
    Some(AttitudeFit {
        rms,
        ..solved.current()?
    })
}

/// Least-squares problem. Parameters: step in the motion's eight parameters, then a rotation vector for each segment.
struct Problem<'a> {
    samples: &'a [SegmentAttitude],
    times: Vec<f64>,
    weights: Vec<f64>,
    /// Weight of the prior on a spherical inertia, for shapes that the attitudes do not determine \[rad\].
    prior: f64,
    start: AttitudeFit,
    parameters: DVector<f64>,
    /// Errors at the current parameters, computed on demand.
    errors: OnceCell<Option<Vec<Vector3<f64>>>>,
}

impl<'a> Problem<'a> {
    fn new(start: AttitudeFit, samples: &'a [SegmentAttitude]) -> Self {
        Self {
            samples,
            times: samples.iter().map(|s| s.attitude.time).collect(),
            weights: vec![1.0; samples.len()],
            prior: 0.0,
            parameters: DVector::zeros(PARAMETERS + 3 * start.segments.len()),
            start,
            errors: OnceCell::new(),
        }
    }

    fn turn(&self, segment: usize) -> Vector3<f64> {
        let at = PARAMETERS + 3 * segment;
        self.parameters.fixed_rows::<3>(at).into_owned()
    }

    fn current(&self) -> Option<AttitudeFit> {
        let step: SVector<f64, PARAMETERS> =
            self.parameters.fixed_rows::<PARAMETERS>(0).into_owned();
        let segments = self.start.segments.iter().enumerate();
        Some(AttitudeFit {
            motion: self.start.motion.moved(&step)?,
            segments: segments.map(|(k, R)| R * exp_so3(&self.turn(k))).collect(),
            rms: self.start.rms,
            span: self.start.span,
            fits_all: self.start.fits_all,
        })
    }

    /// Rotation vectors from measured to modelled attitudes.
    fn errors(&self) -> &Option<Vec<Vector3<f64>>> {
        self.errors.get_or_init(|| self.compute_errors())
    }

    fn compute_errors(&self) -> Option<Vec<Vector3<f64>>> {
        let now = self.current()?;
        let attitudes = now.motion.attitudes(&self.times);
        let each = self.samples.iter().zip(&attitudes);
        let error = |(s, R): (&SegmentAttitude, &UnitQuaternion<f64>)| {
            (s.attitude.R_WB.inverse() * R * now.segments[s.segment]).scaled_axis()
        };
        Some(each.map(error).collect())
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.parameters.copy_from(x);
        self.errors.take();
    }

    fn params(&self) -> DVector<f64> {
        self.parameters.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        // No body has these parameters: large residuals make the solver step back.
        let Some(errors) = self.errors() else {
            return Some(DVector::from_element(3 * self.samples.len() + 5, 10.0));
        };
        let weighted = errors
            .iter()
            .zip(&self.weights)
            .flat_map(|(e, w)| [e.x * w, e.y * w, e.z * w]);
        let shape = shape_of(&self.current()?.motion.inertia) * self.prior;
        let all = weighted.chain(shape.iter().copied());
        Some(DVector::from_iterator(3 * self.samples.len() + 5, all))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let now = self.current()?;
        let swept: Vec<(UnitQuaternion<f64>, Sensitivity)> =
            now.motion.attitudes_and_sensitivities(&self.times);
        let turns: Vec<_> = (0..now.segments.len())
            .map(|k| right_jacobian(&self.turn(k)))
            .collect();
        let mut J = DMatrix::zeros(3 * self.samples.len() + 5, self.parameters.len());
        for k in 0..5 {
            J[(3 * self.samples.len() + k, k)] = self.prior;
        }
        for (i, (sample, (R, S))) in self.samples.iter().zip(&swept).enumerate() {
            let k = sample.segment;
            let error = (sample.attitude.R_WB.inverse() * R * now.segments[k]).scaled_axis();
            let outer = right_jacobian_inverse(&error) * self.weights[i];
            let to_segment = now.segments[k].to_rotation_matrix().matrix().transpose();
            J.fixed_view_mut::<3, PARAMETERS>(3 * i, 0)
                .copy_from(&(outer * to_segment * S));
            J.fixed_view_mut::<3, 3>(3 * i, PARAMETERS + 3 * k)
                .copy_from(&(outer * turns[k]));
        }
        Some(J)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth() -> FreeMotion {
        let shape = SVector::<f64, 5>::new(0.3, -0.2, 0.1, 0.05, -0.15);
        let R = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.7, 1.1));
        FreeMotion::new(&shape, Vector3::new(0.3, -0.5, 0.6), 60.0, R).unwrap()
    }

    fn samples(other: &UnitQuaternion<f64>) -> Vec<SegmentAttitude> {
        let times: Vec<f64> = (0..200).map(|i| 0.6 * f64::from(i)).collect();
        let all = truth().attitudes(&times).into_iter().zip(times);
        all.map(|(R, time)| {
            let segment = usize::from(time > 90.0);
            let R_WB = if segment == 1 { R * other } else { R };
            SegmentAttitude {
                attitude: AttitudeSample { time, R_WB },
                segment,
            }
        })
        .collect()
    }

    #[test]
    fn a_rough_start_converges_and_aligns_the_segments() {
        let other = UnitQuaternion::from_scaled_axis(Vector3::new(-1.0, 2.0, 0.3));
        let step =
            SVector::<f64, PARAMETERS>::from([0.01, -0.02, 0.01, 0.0, 0.02, 0.005, 0.01, -0.005]);
        let start = truth().moved(&step).unwrap();
        let fit = fit_attitudes(&start, &samples(&other), 2).unwrap();
        assert!((fit.motion.inertia - truth().inertia).norm() < 1e-6);
        assert!(fit.segments[1].angle_to(&other) < 1e-6);
        assert!(fit.rms < 1e-6);
    }

    #[test]
    fn the_jacobian_matches_finite_differences() {
        let samples = samples(&UnitQuaternion::identity());
        let start = AttitudeFit {
            motion: truth(),
            segments: vec![UnitQuaternion::identity(); 2],
            rms: 0.0,
            span: 0.0,
            fits_all: true,
        };
        let mut problem = Problem::new(start, &samples[145..157]);
        let x = DVector::from_fn(PARAMETERS + 6, |i, _| 0.004 * (i as f64 - 5.0));
        problem.set_params(&x);
        problem.prior = 0.5;
        let analytic = problem.jacobian().unwrap();
        let numeric = levenberg_marquardt::differentiate_numerically(&mut problem).unwrap();
        assert!((&analytic - &numeric).norm() < 1e-5 * numeric.norm());
    }
}
