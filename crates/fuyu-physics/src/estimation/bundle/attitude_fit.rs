//! The free motion nearest to measured attitudes, by least squares on the rotation group.

use std::cell::OnceCell;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned, SVector, UnitQuaternion, Vector3};

use super::free_motion::{FreeMotion, PARAMETERS, SHAPE_SPREAD, Sensitivity, shape_of};
use super::linear_inertia::AttitudeSample;
use super::rotations::{right_jacobian, right_jacobian_inverse};
use crate::spatial::exp_so3;

/// Most attitudes that are fitted at once: what follows takes them all.
const MOST_SAMPLES: usize = 200;

/// By what factor the span grows at most, and at least.
const GROWTH: f64 = 2.0;
const SLOWEST: f64 = 1.1;

/// A longer span that leaves so many times what a shorter one left, and more than the least \[rad\] that counts, is
/// fitted wrongly; one that leaves hardly more is surely not.
const WORSE: f64 = 2.5;
const AS_GOOD: f64 = 1.2;
const LEAST: f64 = 2e-4;

/// How often a fit may be worse than a shorter one before it is given up.
const PATIENCE: usize = 1;

/// Angles \[rad\] that do not yet count as wrong when the span has just grown.
const TOLERATED: f64 = 0.3;

/// A motion that leaves so much \[rad\] does not hold, and no longer span helps it.
const LOST: f64 = 0.5;

/// An attitude of the body axes of one segment: each segment has axes of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentAttitude {
    /// Time, and the segment's axes in inertial axes.
    pub attitude: AttitudeSample,
    /// Which segment, from 0.
    pub segment: usize,
}

/// A motion, and each segment's axes in its body axes.
#[derive(Debug, Clone, PartialEq)]
pub struct AttitudeFit {
    /// The motion.
    pub motion: FreeMotion,
    /// `R_BS` of each segment.
    pub segments: Vec<UnitQuaternion<f64>>,
    /// Root mean square of the angles left, over samples that agree \[rad\].
    pub rms: f64,
    /// How far from the motion's time it holds \[s\]: a longer span leaves more than shorter ones do.
    pub span: f64,
    /// Whether that is all.
    pub holds: bool,
}

/// Fits the motion to `samples` (in the order of time), from a start that need only hold near its own time: the
/// span that is fitted grows until it holds all. Next to the separatrix errors grow exponentially: where the fit
/// becomes worse the span is to grow more slowly. If it never holds all, the fit is that of the longest span
/// that it held.
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
        holds: true,
    };
    let reach = |s: &SegmentAttitude| (s.attitude.time - start.time).abs();
    let whole = samples.iter().map(reach).fold(0.0, f64::max);
    // A few turns are short enough for any start.
    let rate = start.w_WB_B(&start.R_WB).norm();
    let mut span = (12.0 / rate.max(1e-9)).max(0.02 * whole).min(whole);
    let mut known = vec![false; segments];
    let mut growth = GROWTH;
    let (mut least, mut worse) = (f64::INFINITY, 0);
    let mut held = None;
    loop {
        let before = (current.clone(), known.clone());
        let within: Vec<SegmentAttitude> = samples
            .iter()
            .filter(|s| reach(s) <= span)
            .copied()
            .collect();
        align(&mut current, &within, &mut known);
        let stride = within.len().div_ceil(MOST_SAMPLES);
        let within: Vec<SegmentAttitude> = within.into_iter().step_by(stride.max(1)).collect();
        for tolerated in [TOLERATED, 0.0] {
            current = improve(current, &within, tolerated)?;
        }
        current.holds = current.rms < WORSE * least.max(LEAST);
        if !current.holds && growth > SLOWEST {
            let reached = span / growth;
            (current, known) = before;
            growth = 1.0 + 0.4 * (growth - 1.0);
            span = growth * reached;
            continue;
        }
        if current.rms < AS_GOOD * least.max(LEAST) {
            current.span = span;
            held = Some(AttitudeFit {
                holds: false,
                ..current.clone()
            });
        }
        least = least.min(current.rms);
        worse += usize::from(!current.holds);
        if span >= whole || worse > PATIENCE || current.rms > LOST {
            current.holds &= span >= whole;
            // A motion that the rest has not bent.
            return if current.holds { Some(current) } else { held };
        }
        growth = (1.2 * growth).min(GROWTH).min(whole / span);
        span = (growth * span).min(whole);
    }
}

/// Axes of the segments that come into reach, from the motion so far.
fn align(fit: &mut AttitudeFit, samples: &[SegmentAttitude], known: &mut [bool]) {
    let times: Vec<f64> = samples.iter().map(|s| s.attitude.time).collect();
    let attitudes = fit.motion.attitudes(&times);
    for (segment, known) in known.iter_mut().enumerate().filter(|(_, k)| !**k) {
        let own = samples
            .iter()
            .zip(&attitudes)
            .filter(|(s, _)| s.segment == segment);
        // The nearest attitudes say most: there the motion has run away least.
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
        if let Some(mean) = middle(&turns) {
            fit.segments[segment] = mean;
            *known = true;
        }
    }
}

/// The rotation of a few with the least sum of angles to the others.
fn middle(turns: &[(f64, UnitQuaternion<f64>)]) -> Option<UnitQuaternion<f64>> {
    let spread = |q: &UnitQuaternion<f64>| turns.iter().map(|(_, o)| o.angle_to(q)).sum::<f64>();
    let all = turns.iter().map(|(_, q)| *q);
    all.min_by(|a, b| spread(a).total_cmp(&spread(b)))
}

/// One round of least squares with weights from the residuals before; angles below `tolerated` \[rad\] keep theirs.
fn improve(fit: AttitudeFit, samples: &[SegmentAttitude], tolerated: f64) -> Option<AttitudeFit> {
    let mut problem = Problem::new(fit, samples);
    let errors: Vec<f64> = (problem.errors().as_ref()?.iter().map(|e| e.norm())).collect();
    let mut sorted = errors.clone();
    sorted.sort_by(f64::total_cmp);
    let typical = sorted[sorted.len() / 2].max(3e-7);
    // Half of the vectors of three such errors are longer than 1.5 deviations.
    problem.prior = typical / 1.5 / SHAPE_SPREAD;
    let width = (3.0 * typical).max(tolerated);
    problem.weights = errors
        .iter()
        .map(|e| 1.0 / (1.0 + (e / width).powi(2)).sqrt())
        .collect();
    // What follows starts here; no more digits are needed.
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

/// Parameters: steps of the motion's eight, then a rotation vector for each segment.
struct Problem<'a> {
    samples: &'a [SegmentAttitude],
    times: Vec<f64>,
    weights: Vec<f64>,
    /// Holds the inertia's shape to a sphere where the attitudes say nothing \[rad\].
    prior: f64,
    start: AttitudeFit,
    parameters: DVector<f64>,
    /// What the parameters leave, once it has been asked for.
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
            holds: self.start.holds,
        })
    }

    /// Rotation vectors from measured to modelled attitudes.
    fn errors(&self) -> &Option<Vec<Vector3<f64>>> {
        self.errors.get_or_init(|| self.find_errors())
    }

    fn find_errors(&self) -> Option<Vec<Vector3<f64>>> {
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
        // Where there is no such body the way back is shown by residuals that are too large.
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
    fn a_rough_start_reaches_the_motion_and_ties_the_segments() {
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
    fn the_jacobian_is_that_of_differences() {
        let samples = samples(&UnitQuaternion::identity());
        let start = AttitudeFit {
            motion: truth(),
            segments: vec![UnitQuaternion::identity(); 2],
            rms: 0.0,
            span: 0.0,
            holds: true,
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
