//! Evaluation of an estimate against the true motion: Masutani 1995 sec. 3.5.

use nalgebra::Vector3;

use super::free_body::FreeRotation;
use super::{MotionEstimate, MotionModel};

/// Largest errors of a prediction over its horizon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictionError {
    /// `Theta` \[rad\], (3.18)-(3.23): error of the rotation since the start of the prediction, independent of the choice
    /// of body axes.
    pub attitude: f64,
    /// `Phi` \[rad\], (3.25): error of the direction of the estimated z axis, which the angular velocity circles and at
    /// which a gripper would aim.
    pub axis: f64,
}

/// Relative error `r` of the dynamic parameters, (3.15)-(3.17): mean over those that the estimate's model determines.
/// `None` if the true moments are not known.
pub fn parameter_error(estimate: &MotionEstimate, truth: &FreeRotation) -> Option<f64> {
    let relative = |estimated: f64, true_: f64| (estimated - true_).abs() / true_;
    let alpha = relative(estimate.alpha(), truth.alpha());
    let J = truth.parameters()?.J();
    Some(match (estimate.model(), estimate.J()) {
        (MotionModel::Asymmetric, Some(found)) => {
            (relative(found.x, J.x) + relative(found.y, J.y) + relative(found.z, J.z) + alpha) / 4.0
        }
        (MotionModel::Axisymmetric, Some(found)) => {
            (relative(found.x, 0.5 * (J.x + J.y)) + relative(found.z, J.z) + alpha) / 3.0
        }
        _ => alpha,
    })
}

/// Largest errors of the predicted motion from `start` \[s\] over `horizon` \[s\], at `samples` evenly
/// spaced times including both ends.
pub fn prediction_error(
    estimate: &FreeRotation,
    truth: &FreeRotation,
    start: f64,
    horizon: f64,
    samples: u32,
) -> PredictionError {
    let (estimated_start, true_start) = (estimate.attitude(start), truth.attitude(start));
    let axis_start = estimate.solution_attitude(start) * Vector3::z();
    let mut worst = PredictionError {
        attitude: 0.0,
        axis: 0.0,
    };
    for i in 0..samples {
        let time = start + horizon * f64::from(i) / f64::from((samples - 1).max(1));
        let turned = truth.attitude(time) / true_start;
        let predicted = estimate.attitude(time) / estimated_start;
        worst.attitude = worst.attitude.max(predicted.angle_to(&turned));
        let axis = estimate.solution_attitude(time) * Vector3::z();
        worst.axis = worst.axis.max(axis.angle(&(turned * axis_start)));
    }
    worst
}
