//! One motion under one condition: chosen model, and errors of the estimate. Masutani 1995 sec. 3.5.

use super::{Condition, HORIZON, INTERVAL, INTERVALS, rates};
use crate::estimation::evaluation::{PredictionError, parameter_error, prediction_error};
use crate::estimation::free_body::FreeRotation;
use crate::estimation::masutani1995::{Analysis, MasutaniError, Options};
use crate::estimation::{MotionEstimate, MotionModel};

/// Number of times at which a prediction is evaluated.
const SAMPLES: u32 = 101;

/// Result for one motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// The chosen model; `None` if the data allow no choice.
    pub model: Option<MotionModel>,
    /// Errors of the estimate, or the reason for its failure.
    pub result: Result<CellErrors, MasutaniError>,
}

/// Errors of one estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellErrors {
    /// Relative error `r` of the dynamic parameters.
    pub parameters: f64,
    /// Errors `Theta` and `Phi` of the prediction over [`HORIZON`] after the observation \[rad\].
    pub prediction: PredictionError,
}

/// The algorithm's options in chapter 3, which does not use the aperiodic model. The largest errors reported in the
/// chapter are reproduced only with unwrapping to a line.
pub fn options() -> Options {
    Options {
        aperiodic: false,
        unwrap_to_line: true,
        ..Default::default()
    }
}

/// Estimates one motion by the thesis's method.
pub fn cell(motion: &FreeRotation, condition: Condition<'_>) -> Cell {
    let options = options();
    let analysis =
        rates(motion, condition).and_then(|rates| Ok((Analysis::new(&rates, &options)?, rates)));
    match analysis {
        Err(error) => Cell {
            model: None,
            result: Err(error),
        },
        Ok((analysis, rates)) => Cell {
            model: Some(analysis.model),
            result: (analysis.solve(&rates, &options))
                .map(|(estimate, _)| judge(&estimate, motion)),
        },
    }
}

/// The errors of an estimate after the whole observation.
pub fn judge(estimate: &MotionEstimate, truth: &FreeRotation) -> CellErrors {
    let end = INTERVAL * f64::from(INTERVALS);
    CellErrors {
        parameters: parameter_error(estimate, truth).unwrap_or(f64::NAN),
        prediction: prediction_error(estimate.rotation(), truth, end, HORIZON, SAMPLES),
    }
}
