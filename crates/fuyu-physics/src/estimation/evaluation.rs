//! How wrong an estimate is: Masutani 1995 sec. 3.5.

use nalgebra::Vector3;

use super::free_body::FreeRotation;
use super::{MotionEstimate, MotionModel};

/// Largest errors of a prediction over its horizon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictionError {
    /// `Theta` \[rad\], (3.18)-(3.23): of the turn since the prediction began. It does not ask where the body's
    /// axes are.
    pub attitude: f64,
    /// `Phi` \[rad\], (3.25): of the direction of the estimated z axis, the one that the angular velocity circles
    /// and a gripper would aim at.
    pub axis: f64,
}

/// Relative error `r` of the dynamic parameters, (3.15)-(3.17): over those that the estimate's model tells. `None`
/// if the truth's moments are not known.
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

/// Largest errors of the predicted motion from `start` \[s\] over `horizon` \[s\], at `samples` instants evenly
/// spread over it, both ends included.
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
