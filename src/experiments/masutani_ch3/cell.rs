//! One motion under one condition: the model chosen and the errors made. Masutani 1995 sec. 3.5.

use super::{Condition, HORIZON, INTERVAL, INTERVALS, rates};
use crate::estimation::evaluation::{PredictionError, parameter_error, prediction_error};
use crate::estimation::free_body::FreeRotation;
use crate::estimation::masutani1995::{Analysis, EstimateError, Options};
use crate::estimation::{MotionEstimate, MotionModel};

/// Instants at which a prediction is judged.
const INSTANTS: u32 = 101;

/// What came of one motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// The model chosen; `None` if the data allowed no choice.
    pub model: Option<MotionModel>,
    /// Errors of the estimate, or why there is none.
    pub result: Result<CellErrors, EstimateError>,
}

/// Errors of one estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellErrors {
    /// Relative error `r` of the dynamic parameters.
    pub parameters: f64,
    /// Errors `Theta` and `Phi` of the prediction over [`HORIZON`] after the observation \[rad\].
    pub prediction: PredictionError,
}

/// The algorithm's options in chapter 3, which does without the aperiodic model. With turns that slip, the largest errors
/// that it reports do not come out.
pub fn options() -> Options {
    Options {
        aperiodic: false,
        steady_turns: true,
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
        prediction: prediction_error(estimate.rotation(), truth, end, HORIZON, INSTANTS),
    }
}
