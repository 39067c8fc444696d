//! Errors in the description of a robot's flexible parts.

use fuyu_structures::StructureError;
use thiserror::Error;

/// Why flexible parts, wheels or thrusters are refused. Each message is one line that names the field, its value and
/// the allowed range.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum FlexibleError {
    /// A number outside of its range, or not a number.
    #[error("{field} is {value}; it must be {requirement}")]
    Value {
        /// Name of the number, such as `joint2, stiffness [N m/rad]`.
        field: String,
        /// The number.
        value: f64,
        /// The allowed range.
        requirement: &'static str,
    },
    /// A part in a place that the equations do not cover.
    #[error("{part}: {problem}")]
    Part {
        /// Name of the part.
        part: String,
        /// The problem and its remedy.
        problem: String,
    },
    /// A deformable body that is physically impossible.
    #[error(transparent)]
    Structure(#[from] StructureError),
    /// A vibration that the integration method cannot follow at this step.
    #[error(
        "the step of {step} s is above the stability limit of {limit:.3e} s for {part} at {frequency_hz:.3} Hz; reduce the step, or use fewer modes"
    )]
    Unstable {
        /// The part that vibrates most in this mode.
        part: String,
        /// Its frequency \[Hz\].
        frequency_hz: f64,
        /// The step \[s\].
        step: f64,
        /// Largest stable step \[s\].
        limit: f64,
    },
    /// A damper that the integration method cannot follow at this step.
    #[error(
        "the step of {step} s is above the stability limit of {limit:.3e} s for the damping of {part}, whose motion decays at {rate:.3e} 1/s; reduce the step or the damping"
    )]
    StiffDamping {
        /// The part that moves most in this decay.
        part: String,
        /// Decay rate \[1/s\].
        rate: f64,
        /// The step \[s\].
        step: f64,
        /// Largest stable step \[s\].
        limit: f64,
    },
    /// An integration whose steps became too small or too many.
    #[error(
        "the step fell to {step:.1e} s at time {time} s; the motion is too fast for a tolerance of {tolerance:e}"
    )]
    StepTooSmall {
        /// Time \[s\].
        time: f64,
        /// The last step tried \[s\].
        step: f64,
        /// The relative tolerance.
        tolerance: f64,
    },
}

impl FlexibleError {
    /// An error of the part called `part`.
    pub(super) fn part(part: &str, problem: impl Into<String>) -> Self {
        Self::Part {
            part: part.to_owned(),
            problem: problem.into(),
        }
    }
}

/// Refuses a number that is NaN or for which `right` is false.
pub(super) fn require(
    field: impl FnOnce() -> String,
    value: f64,
    right: bool,
    requirement: &'static str,
) -> Result<(), FlexibleError> {
    if right && !value.is_nan() {
        return Ok(());
    }
    Err(FlexibleError::Value {
        field: field(),
        value,
        requirement,
    })
}
