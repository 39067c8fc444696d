//! Control laws: from joint states and base-frame measurements to joint efforts.
//!
//! No law here ever sees the pose of the base. A [`Measurement`] is all there is: joint positions and
//! rates from encoders, tip and goal poses as a sensor on the base sees them.

mod controller;
mod feed_forward;
mod inverse_kinematics;
mod joint_pd;
mod operational_space;
mod pose_error;
pub mod prediction;
mod task_priority;
mod transpose_jacobian;

pub use controller::{Acted, Controller, ControllerConfig, LawKind};
pub use feed_forward::{AHEAD, DAMPING, FASTEST, FeedForward, GoalRates};
pub use inverse_kinematics::{IkError, inverse_kinematics};
pub use joint_pd::JointPd;
pub use operational_space::{BaseTask, OperationalGains, OperationalSpace, Robot, TipTask};
pub use pose_error::{PoseError, Saturation};
pub use task_priority::{Rows, TaskPriority};
pub use transpose_jacobian::{Gains, JacobianKind, TransposeJacobian};

use nalgebra::DVector;

use crate::spatial::Pose;

/// Everything that a law may know at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Measurement<'a> {
    /// Joint positions \[rad or m\].
    pub q: &'a DVector<f64>,
    /// Joint rates \[rad/s or m/s\].
    pub qd: &'a DVector<f64>,
    /// Tip pose in the base frame.
    pub X_BE: &'a Pose,
    /// Goal pose in the base frame.
    pub X_BD: &'a Pose,
}

/// Why a set of gains cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GainError {
    /// A vector of gains does not fit the robot.
    #[error("{name} has {got} values; the robot has {joints} joints, so give {joints}")]
    Length {
        /// Which gain.
        name: &'static str,
        /// How many values were given.
        got: usize,
        /// How many joints the robot has.
        joints: usize,
    },
    /// A gain that must be positive and finite is not.
    #[error("{name} is {value}; it must be positive and finite")]
    NotPositive {
        /// Which gain.
        name: &'static str,
        /// Its value.
        value: f64,
    },
}

fn check_positive(name: &'static str, value: f64) -> Result<(), GainError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(GainError::NotPositive { name, value })
    }
}

fn check_joint_gains(name: &'static str, values: &[f64], joints: usize) -> Result<(), GainError> {
    if values.len() != joints {
        return Err(GainError::Length {
            name,
            got: values.len(),
            joints,
        });
    }
    values
        .iter()
        .try_for_each(|&value| check_positive(name, value))
}
