//! Maximum-likelihood fit of a torque-free motion to measured angular velocities.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::bundle::{
    AttitudeSample, BodyRate, FreeMotion, PARAMETERS, SHAPE_SPREAD, SegmentAttitude, Widths,
    fastest_tumbling, fit_attitudes, fit_inertia_and_momentum, report_of_state, responses,
    rotation_between, shape_of, shape_times,
};
use super::masutani1995::Rate;
use super::motion_state::{MotionState, OtherMotions, STATES, StateCovariance};
use super::{EstimateError, Estimated, EstimationMethod};

/// Unknowns: those of the free motion, and a constant angular acceleration.
const UNKNOWNS: usize = PARAMETERS + 3;

/// Least number of samples.
const MIN_SAMPLES: usize = 6;

/// Largest number of steps of an adjustment.
const STEPS: usize = 60;

/// Least standard deviation of an angular velocity that is accepted, relative to the largest angular velocity: below
/// it, rounding of the numbers dominates.
const LEAST_NOISE: f64 = 1e-9;

/// A fit to the samples.
#[derive(Clone)]
struct Fit {
    motion: FreeMotion,
    acceleration: Vector3<f64>,
    /// Sum of squares of the residuals \[rad²/s²\].
    squares: f64,
}

/// Estimates a motion from angular velocities in inertial axes at ascending times.
///
/// # Errors
/// [`EstimateError`] if there are too few, or no free rotation has them.
pub fn fit_rates(rates: &[Rate], widths: &Widths) -> Result<Estimated, EstimateError> {
    if rates.len() < MIN_SAMPLES {
        return Err(EstimateError::TooFewRates {
            have: rates.len(),
            need: MIN_SAMPLES,
        });
    }
    let is_finite = |(t, w): &Rate| t.is_finite() && w.iter().all(|w| w.is_finite());
    let is_right = |k: usize| is_finite(&rates[k]) && (k == 0 || rates[k].0 > rates[k - 1].0);
    if let Some(k) = (0..rates.len()).find(|k| !is_right(*k)) {
        let problem = format!("sample {k} is not finite, or not later than the one before");
        return Err(EstimateError::Rates(problem));
    }
    let size = rates.iter().map(|(_, w)| w.norm()).fold(0.0, f64::max);
    let fits_from = |starts: Vec<FreeMotion>| {
        let fits = starts.into_iter();
        fits.filter_map(|start| adjust(rates, start, widths, size))
            .collect::<Vec<_>>()
    };
    let mut fits = fits_from(starts(rates));
    for _ in 0..2 {
        fits.sort_by(|a, b| a.squares.total_cmp(&b.squares));
        let more = fits.first().map(|fit| other_shapes(&fit.motion));
        fits.extend(more.map(fits_from).unwrap_or_default());
    }
    fits.sort_by(|a, b| a.squares.total_cmp(&b.squares));
    let best = (!fits.is_empty()).then(|| fits.remove(0));
    let not_free = |rms: f64| EstimateError::NotFreeRates { rms, size };
    let found = best.ok_or_else(|| not_free(size))?;
    let count = 3.0 * rates.len() as f64;
    let freedom = (count - PARAMETERS as f64).max(1.0);
    let variance = found.squares / freedom;
    // Noise between successive samples, which no motion explains.
    let white = third_differences(rates);
    if variance.sqrt() > MOST_NOISE * size || variance > NOT_FREE * white.max((1e-3 * size).powi(2))
    {
        return Err(not_free(variance.sqrt()));
    }
    let variance = variance.max((LEAST_NOISE * size).powi(2));
    let mut state =
        state_at_end(rates, &found, variance, widths).ok_or_else(|| not_free(variance.sqrt()))?;
    state.others =
        other_motions(rates, &found, fits, variance, widths).map(|motions| OtherMotions {
            motions,
            conditional: state.covariance,
        });
    let rms = (found.squares / count).sqrt();
    let report = report_of_state(&state, rms).ok_or_else(|| not_free(rms))?;
    let mut diagnosis = report.diagnosis;
    diagnosis.push(format!(
        "the noise of the angular velocities is {:.1e} rad/s, from the residuals",
        variance.sqrt()
    ));
    let motion = report.motion;
    Ok(Estimated {
        method: EstimationMethod::MaximumLikelihood,
        w_IB_I: rates
            .iter()
            .map(|(t, _)| (*t, motion.angular_velocity(*t)))
            .collect(),
        motion,
        solution: None,
        state: Some(state),
        diagnosis,
    })
}

/// Residuals above this fraction of the angular velocity are not noise.
const MOST_NOISE: f64 = 0.3;

/// Ratio of the residuals' variance to that of the noise between samples above which the motion is not free.
const NOT_FREE: f64 = 30.0;

/// Variance of the noise from third differences, in which smooth motion cancels.
fn third_differences(rates: &[Rate]) -> f64 {
    let each = rates
        .windows(4)
        .map(|w| (w[3].1 - w[2].1 * 3.0 + w[1].1 * 3.0 - w[0].1).norm_squared() / 60.0);
    let mut all: Vec<f64> = each.collect();
    all.sort_by(f64::total_cmp);
    // The median of a chi-squared variable of three degrees of freedom is 2.37.
    all.get(all.len() / 2).map_or(0.0, |m| m * 3.0 / 2.37)
}

/// Approximate motions. Attitudes are integrated from the angular velocities; the angular momentum is constant.
fn starts(rates: &[Rate]) -> Vec<FreeMotion> {
    let mut R_WB = UnitQuaternion::identity();
    let mut series = vec![AttitudeSample {
        time: rates[0].0,
        R_WB,
    }];
    for pair in rates.windows(2) {
        // The angular velocities are in inertial axes: the rotation between two samples acts from the left. For rates
        // in body axes, the second term of the expansion has the other sign.
        let back = |r: &Rate| (r.0, -r.1);
        let turn = rotation_between(&back(&pair[0]), &back(&pair[1])).inverse();
        R_WB = turn * R_WB;
        R_WB.renormalize();
        series.push(AttitudeSample {
            time: pair[1].0,
            R_WB,
        });
    }
    let body: Vec<BodyRate> = (series.iter().zip(rates))
        .map(|(attitude, (_, w))| BodyRate {
            attitude: *attitude,
            w_WB_B: attitude.R_WB.inverse() * w,
        })
        .collect();
    let samples: Vec<SegmentAttitude> = (series.iter())
        .map(|attitude| SegmentAttitude {
            attitude: *attitude,
            segment: 0,
        })
        .collect();
    let mut found = Vec::new();
    for along in [0.5, fastest_tumbling(&body), 0.1, 0.9] {
        if let Some(start) = fit_inertia_and_momentum(&body, along) {
            let fit = fit_attitudes(&start, &samples, 1);
            found.extend(fit.map(|f| f.motion));
            found.push(start);
        }
    }
    // A spherical body, for data too noisy to determine a shape.
    let middle = series[series.len() / 2];
    let mean = rates.iter().map(|(_, w)| w).sum::<Vector3<f64>>() / rates.len() as f64;
    let sphere = FreeMotion::new(&SVector::zeros(), mean, middle.time, middle.R_WB);
    found.extend(sphere);
    found
}

/// Other bodies that explain the angular velocities nearly as well as the best fit, with weights proportional to their
/// likelihood. `others` are ordered by their sums of squares.
fn other_motions(
    rates: &[Rate],
    best: &Fit,
    others: Vec<Fit>,
    variance: f64,
    widths: &Widths,
) -> Option<Vec<(f64, FreeMotion)>> {
    let mut distinct = vec![best.clone()];
    for fit in others {
        let shape = shape_of(&fit.motion.inertia);
        let is_new = |known: &Fit| (shape_of(&known.motion.inertia) - shape).norm() > SAME_SHAPE;
        if (fit.squares - best.squares) < MOST_EXCESS * variance && distinct.iter().all(is_new) {
            distinct.push(fit);
        }
    }
    let weight = |fit: &Fit| (-(fit.squares - best.squares) / (2.0 * variance)).exp();
    let all: f64 = distinct.iter().map(weight).sum();
    let motions = distinct[1..].iter().filter_map(|fit| {
        let state = state_at_end(rates, fit, variance, widths)?;
        Some((weight(fit) / all, state.motion))
    });
    let motions: Vec<_> = motions.collect();
    (!motions.is_empty()).then_some(motions)
}

/// Shapes that differ by less than this are the same body.
const SAME_SHAPE: f64 = 0.03;

/// A fit whose sum of squares exceeds the best by more than this, in units of the noise variance, is excluded.
const MOST_EXCESS: f64 = 25.0;

/// Motions with the angular velocity of `motion` and bodies of other shapes. An adjustment cannot change a flat body
/// into a long one, because it would have to pass the sphere, whose axis of rotation does not move.
fn other_shapes(motion: &FreeMotion) -> Vec<FreeMotion> {
    let shape = shape_of(&motion.inertia);
    let w_W = motion.R_WB * motion.w_WB_B(&motion.R_WB);
    let w_B = motion.R_WB.inverse() * w_W;
    let along = |factor: f64| {
        // Stretched along the axis of rotation.
        let axis = w_B.normalize();
        let stretched = (axis * axis.transpose() - Matrix3::identity() / 3.0) * factor;
        shape_of(&(Matrix3::identity() + stretched))
    };
    let shapes = [-1.0, -0.5, 0.4]
        .map(|factor| shape * factor)
        .into_iter()
        .chain([-0.6, 0.4].map(along));
    let motions = shapes.filter_map(|shape| {
        let motion = FreeMotion::new(&shape, w_W, motion.time, motion.R_WB)?;
        let momentum = motion.R_WB * (motion.inertia * w_B);
        Some(FreeMotion { momentum, ..motion })
    });
    motions.collect()
}

/// Angular velocities (inertial axes) at the samples and their derivatives by the unknowns.
fn predicted(rates: &[Rate], fit: &Fit) -> Option<Vec<(Vector3<f64>, SMatrix<f64, 3, UNKNOWNS>)>> {
    let motion = &fit.motion;
    let inverse = motion.inertia.try_inverse()?;
    let times: Vec<f64> = rates.iter().map(|r| r.0).collect();
    let attitudes = motion.attitudes_and_sensitivities(&times);
    let disturbed = responses(motion, &times, &attitudes, |_, _| [Matrix3::identity()]);
    let each = attitudes.iter().zip(&disturbed).map(|((R, S), response)| {
        let turn = response.turn[0] * fit.acceleration;
        let R = (R * UnitQuaternion::from_scaled_axis(turn)).to_rotation_matrix();
        let R = *R.matrix();
        let momentum = motion.momentum + response.impulse[0] * fit.acceleration;
        let h = R.tr_mul(&momentum);
        let w = inverse * h;
        let by_turn = R * (inverse * h.cross_matrix() - w.cross_matrix());
        let by_momentum = R * inverse * R.transpose();
        let mut J = SMatrix::<f64, 3, UNKNOWNS>::zeros();
        J.fixed_columns_mut::<PARAMETERS>(0)
            .copy_from(&(by_turn * S));
        let mut shape = J.fixed_columns_mut::<5>(0);
        shape -= R * inverse * shape_times(&w);
        let mut by_L = J.fixed_columns_mut::<3>(5);
        by_L += by_momentum;
        J.fixed_columns_mut::<3>(PARAMETERS)
            .copy_from(&(by_turn * response.turn[0] + by_momentum * response.impulse[0]));
        (R * w, J)
    });
    Some(each.collect())
}

/// Weights of the prior for residuals of variance `variance`, and distances from the prior's mean.
fn prior(fit: &Fit, variance: f64, widths: &Widths) -> [SVector<f64, UNKNOWNS>; 2] {
    let shape = shape_of(&fit.motion.inertia);
    let weights = SVector::from_fn(|k, _| match k {
        0..5 => variance / SHAPE_SPREAD.powi(2),
        _ if k < PARAMETERS => 0.0,
        _ => variance / widths.acceleration.max(1e-12).powi(2),
    });
    let distances = SVector::from_fn(|k, _| match k {
        0..5 => shape[k],
        _ if k < PARAMETERS => 0.0,
        _ => fit.acceleration[k - PARAMETERS],
    });
    [weights, distances]
}

type Normal = (
    SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    SVector<f64, UNKNOWNS>,
    f64,
);

/// Hessian, gradient and sum of squares.
fn normal(rates: &[Rate], fit: &Fit) -> Option<Normal> {
    let (mut H, mut g) = (SMatrix::zeros(), SVector::zeros());
    let mut squares = 0.0;
    for ((w, J), (_, measured)) in predicted(rates, fit)?.iter().zip(rates) {
        let r = w - measured;
        H += J.tr_mul(J);
        g += J.tr_mul(&r);
        squares += r.norm_squared();
    }
    squares.is_finite().then_some((H, g, squares))
}

/// Levenberg-Marquardt from a start. The noise variance is estimated from the residuals.
fn adjust(rates: &[Rate], start: FreeMotion, widths: &Widths, size: f64) -> Option<Fit> {
    let mut fit = Fit {
        motion: start,
        acceleration: Vector3::zeros(),
        squares: 0.0,
    };
    let (mut H, mut g, mut squares) = normal(rates, &fit)?;
    let mut damping = 1e-4;
    for _ in 0..STEPS {
        let variance = (squares / (3 * rates.len()) as f64).max((LEAST_NOISE * size).powi(2));
        let [weights, distances] = prior(&fit, variance, widths);
        let cost = |squares: f64, distances: &SVector<f64, UNKNOWNS>| {
            squares + weights.component_mul(distances).dot(distances)
        };
        let mut damped = H + SMatrix::from_diagonal(&weights);
        for k in 0..UNKNOWNS {
            damped[(k, k)] *= 1.0 + damping;
            damped[(k, k)] += f64::MIN_POSITIVE;
        }
        let slope = g + weights.component_mul(&distances);
        let step = -damped.cholesky()?.solve(&slope);
        let moved = fit
            .motion
            .moved(&step.fixed_rows::<PARAMETERS>(0).into_owned())
            .map(|motion| Fit {
                motion,
                acceleration: fit.acceleration + step.fixed_rows::<3>(PARAMETERS),
                squares: 0.0,
            });
        let tried = moved.and_then(|moved| Some((normal(rates, &moved)?, moved)));
        let before = cost(squares, &distances);
        match tried {
            Some((found, moved)) if cost(found.2, &prior(&moved, variance, widths)[1]) < before => {
                let gain = before - cost(found.2, &prior(&moved, variance, widths)[1]);
                fit = moved;
                (H, g, squares) = found;
                damping = (damping * 0.2).max(1e-12);
                if gain < 1e-12 * before {
                    break;
                }
            }
            _ => {
                damping *= 10.0;
                if damping > 1e8 {
                    break;
                }
            }
        }
    }
    Some(Fit { squares, ..fit })
}

/// The state at the last sample.
fn state_at_end(rates: &[Rate], fit: &Fit, variance: f64, widths: &Widths) -> Option<MotionState> {
    let (H, ..) = normal(rates, fit)?;
    let [weights, _] = prior(fit, variance, widths);
    let information = (H + SMatrix::from_diagonal(&weights)) / variance;
    let covariance = information.cholesky()?.inverse();
    let motion = &fit.motion;
    let time = rates.last()?.0;
    let times: Vec<f64> = rates.iter().map(|r| r.0).collect();
    let attitudes = motion.attitudes_and_sensitivities(&times);
    let response = *responses(motion, &times, &attitudes, |_, _| [Matrix3::identity()]).last()?;
    let (R, S) = *attitudes.last()?;
    let mut by_unknowns = SMatrix::<f64, STATES, UNKNOWNS>::zeros();
    by_unknowns
        .fixed_view_mut::<3, PARAMETERS>(0, 0)
        .copy_from(&S);
    by_unknowns
        .fixed_view_mut::<3, 3>(0, PARAMETERS)
        .copy_from(&response.turn[0]);
    for k in 0..PARAMETERS {
        by_unknowns[(3 + k, k)] = 1.0;
    }
    for k in 0..3 {
        by_unknowns[(8 + k, PARAMETERS + k)] = response.impulse[0][(k, k)];
        by_unknowns[(11 + k, PARAMETERS + k)] = 1.0;
    }
    let spread: StateCovariance = by_unknowns * covariance * by_unknowns.transpose();
    let turn = response.turn[0] * fit.acceleration;
    Some(MotionState {
        motion: FreeMotion {
            time,
            R_WB: R * UnitQuaternion::from_scaled_axis(turn),
            momentum: motion.momentum + response.impulse[0] * fit.acceleration,
            ..*motion
        },
        acceleration: fit.acceleration,
        covariance: (spread + spread.transpose()) * 0.5,
        acceleration_walk: widths.acceleration * (2.0 / widths.correlation_time).sqrt(),
        others: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::free_body::FreeRotation;

    fn truth() -> FreeRotation {
        let inertia = Matrix3::from_diagonal(&Vector3::new(7.0, 4.0, 3.0));
        let rate = Vector3::new(0.1, 0.35, 0.2);
        FreeRotation::new(&inertia, UnitQuaternion::identity(), &rate, 0.0).unwrap()
    }

    #[test]
    fn exact_angular_velocities_give_the_motion() {
        let truth = truth();
        let rates: Vec<Rate> = (0..=600)
            .map(|k| 0.1 * f64::from(k))
            .map(|t| (t, truth.angular_velocity(t)))
            .collect();
        let found = fit_rates(&rates, &Widths::default()).unwrap();
        let turn = found.motion.attitude(90.0) / found.motion.attitude(60.0);
        let expected = truth.attitude(90.0) / truth.attitude(60.0);
        let error = turn.angle_to(&expected);
        assert!(error < 0.01f64.to_radians(), "{error}");
    }

    #[test]
    fn the_derivatives_match_finite_differences() {
        let shape = SVector::<f64, 5>::new(0.3, -0.2, 0.1, 0.05, -0.15);
        let R = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.7, 1.1));
        let fit = Fit {
            motion: FreeMotion::new(&shape, Vector3::new(0.3, -0.5, 0.6), 3.0, R).unwrap(),
            acceleration: Vector3::zeros(),
            squares: 0.0,
        };
        let times = (0..40).map(|k| (0.25 * f64::from(k), Vector3::zeros()));
        let rates: Vec<Rate> = times.collect();
        let all = predicted(&rates, &fit).unwrap();
        for k in 0..PARAMETERS {
            let mut step = SVector::<f64, PARAMETERS>::zeros();
            step[k] = 1e-6;
            let at = |step: &SVector<f64, PARAMETERS>| Fit {
                motion: fit.motion.moved(step).unwrap(),
                ..fit.clone()
            };
            let up = predicted(&rates, &at(&step)).unwrap();
            let down = predicted(&rates, &at(&-step)).unwrap();
            for i in [0, 20, 39] {
                let numeric = (up[i].0 - down[i].0) / 2e-6;
                let off = (numeric - all[i].1.column(k)).norm();
                assert!(off < 1e-5 * (1.0 + numeric.norm()), "{k} {i}: {off}");
            }
        }
    }

    // The wrong sample was named for a value, and a time that is no number passed the comparison of neighbours.
    #[test]
    fn the_wrong_sample_is_named() {
        let truth = truth();
        let times = (0..20).map(|k| 0.1 * f64::from(k));
        let right: Vec<Rate> = times.map(|t| (t, truth.angular_velocity(t))).collect();
        for (k, wrong) in [
            (7, (right[7].0, Vector3::repeat(f64::NAN))),
            (9, (f64::NAN, right[9].1)),
            (4, (right[3].0, right[4].1)),
        ] {
            let mut rates = right.clone();
            rates[k] = wrong;
            let message = fit_rates(&rates, &Widths::default()).unwrap_err();
            assert!(
                message.to_string().contains(&format!("sample {k} ")),
                "{message}"
            );
        }
    }
}
