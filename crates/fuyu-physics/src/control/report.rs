//! Result of a control step.

use super::{ConvergenceFailure, IkError, PoseError};

/// Report of a controller on one step, in addition to its efforts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ControlReport {
    /// Deviation of the first tip on which the law acted; `None` without a camera measurement.
    pub error: Option<PoseError>,
    /// Deviation of the second tip of a robot with several arms; `None` without a camera measurement of it.
    pub second_error: Option<PoseError>,
    /// Whether the position error was saturated.
    pub position_saturated: bool,
    /// Whether the orientation error was saturated.
    pub orientation_saturated: bool,
    /// Why the tip does not converge to its goal, if it does not.
    pub convergence_failure: Option<ConvergenceFailure>,
    /// Whether the law's efforts act; otherwise the joints are only damped.
    pub active: bool,
}

/// Why a control step failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ControlError {
    /// A vector of the joint state does not fit the robot.
    #[error(
        "the measurement has {got} joint {quantity}s; the robot has {joints} joints, so give {joints}"
    )]
    JointCount {
        /// `position` or `rate`.
        quantity: &'static str,
        /// How many values were given.
        got: usize,
        /// How many joints the robot has.
        joints: usize,
    },
    /// A measured value is not finite.
    #[error("{quantity} is {value} in the measurement; it must be finite")]
    Measurement {
        /// The quantity, with its joint or symbol.
        quantity: String,
        /// Its value.
        value: f64,
    },
    /// The law computed an effort that is not finite.
    #[error(
        "the effort that the law {law} computed for joint '{joint}' is {value}; it must be finite"
    )]
    Effort {
        /// Name of the law.
        law: &'static str,
        /// Name of the joint.
        joint: String,
        /// The effort.
        value: f64,
    },
    /// The law changed the length of the vector of efforts.
    #[error("the law {law} gave {got} efforts; the robot has {joints} joints, so give {joints}")]
    EffortCount {
        /// Name of the law.
        law: &'static str,
        /// How many efforts it gave.
        got: usize,
        /// How many joints the robot has.
        joints: usize,
    },
    /// The law failed.
    #[error(transparent)]
    Law(#[from] LawError),
}

/// Why a law gives no efforts.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LawError {
    /// The law needs joint positions for the goal, and none were found.
    #[error(transparent)]
    Unreachable(#[from] IkError),
    /// The reason of a user-defined law.
    #[error("{0}")]
    Other(String),
}
