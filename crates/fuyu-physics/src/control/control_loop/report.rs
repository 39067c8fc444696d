//! Report of one step of a control loop.

use super::Stamp;
use crate::control::{ControlError, ControlReport, DelayStatus};

/// One step of a [`ControlLoop`](super::ControlLoop): which inputs were used and what was decided.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopReport {
    /// Stamp of the joint state that was answered.
    pub stamp: Stamp,
    /// Report of the controller, or the reason why its law gives no efforts.
    pub control: Result<ControlReport, ControlError>,
    /// Origin of the efforts.
    pub mode: ControlMode,
    /// Camera measurement of the first tip.
    pub tip: InputStatus,
    /// Camera measurement of the second tip; `None` for a robot with one tip.
    pub second_tip: Option<InputStatus>,
    /// Gyro of the base. Unless it was used, the base's angular velocity assumes zero angular momentum.
    pub gyro: InputStatus,
    /// Estimated angular velocity of the goal.
    pub goal_rate: InputStatus,
    /// Compensation of the delay of the efforts.
    pub delay: DelayStatus,
}

/// Origin of the efforts of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControlMode {
    /// Efforts of the law.
    Law,
    /// Damping of the joints, `-K_V q̇`: the law lacks a measurement or has no efforts.
    DampingOnly,
    /// Zero: the controller's efforts were not finite, or their delay is not known or too long.
    ZeroEfforts,
}

/// Whether an input was used in a step. Ages are relative to the joint state, negative for a sample with a later stamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InputStatus {
    /// Nothing has arrived since the run began.
    Missing,
    /// The newest sample was used.
    Used {
        /// Its age \[s\].
        age: f64,
    },
    /// The newest sample was not used: its age exceeds the timeout.
    Stale {
        /// Its age \[s\].
        age: f64,
    },
    /// The loop does not use this input (the goal's angular velocity in lockstep).
    Ignored,
}

impl InputStatus {
    /// Whether the newest sample was used.
    pub fn is_used(&self) -> bool {
        matches!(self, Self::Used { .. })
    }

    /// Age of the newest sample, used or not \[s\].
    pub fn age(&self) -> Option<f64> {
        match self {
            Self::Used { age } | Self::Stale { age } => Some(*age),
            Self::Missing | Self::Ignored => None,
        }
    }
}

/// Why a sample was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InputError {
    /// A value is NaN or infinite.
    #[error("{what} is not finite")]
    NotFinite {
        /// The quantity.
        what: &'static str,
    },
    /// A value is negative.
    #[error("{what} is negative")]
    Negative {
        /// The quantity.
        what: &'static str,
    },
    /// A vector does not have one value for each joint.
    #[error("{what} has {got} values; the robot has {joints} joints")]
    WrongLength {
        /// The quantity.
        what: &'static str,
        /// Its number of values.
        got: usize,
        /// The number of joints.
        joints: usize,
    },
    /// The stamp is later than that of the newest joint state by more than the timeout: another clock or another run.
    #[error("stamp is {ahead:.2} s after the newest joint state; at most {timeout} s is accepted")]
    TooFarAhead {
        /// Lead over the newest joint state \[s\].
        ahead: f64,
        /// The timeout \[s\].
        timeout: f64,
    },
    /// The robot has no such tip.
    #[error("there is no tip {tip}; the robot has {tips}, counted from 0")]
    NoSuchTip {
        /// Index of the tip, 0 is the first.
        tip: usize,
        /// How many there are.
        tips: usize,
    },
}
