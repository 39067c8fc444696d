//! Inputs, commands and errors of a mission.

use nalgebra::Vector3;

use crate::control::gains::ConfigError;

/// Command to the gripper (or latch).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Gripper {
    /// Open.
    #[default]
    Open,
    /// Close and stay closed.
    Close,
}

/// Joint states and gyro at one time.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// Time \[s\].
    pub time: f64,
    /// Joint positions \[rad or m\].
    pub q: &'a [f64],
    /// Joint rates.
    pub qd: &'a [f64],
    /// Angular velocity of the base by the gyro, base axes \[rad/s\].
    pub w_B: Vector3<f64>,
    /// Speeds of the wheels relative to the base \[rad/s\]; empty for a mission without wheels.
    pub wheel_speeds: &'a [f64],
}

/// Commands of the mission.
#[derive(Debug, Clone, Copy)]
pub struct Command<'a> {
    /// Joint efforts \[N m or N\].
    pub efforts: &'a [f64],
    /// External couple on the base, base axes \[N m\]: that of ideal thrusters, or the mean couple of `on_times`.
    pub couple: Vector3<f64>,
    /// Motor torques of the wheels \[N m\]; empty for a mission without wheels.
    pub wheel_torques: &'a [f64],
    /// On-times of the thrusters from now on \[s\]. `None` while an earlier command lasts, and for a mission without
    /// thrusters.
    pub on_times: Option<&'a [f64]>,
    /// Command to the gripper.
    pub gripper: Gripper,
}

/// Why the mission refuses a setting, a sample or a command.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MissionError {
    /// A setting is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A measurement that is not finite, or does not fit the robot.
    #[error(
        "a sample of {joints} joints and {wheels} wheels with finite values is needed: {problem}"
    )]
    Sample {
        /// Number of the robot's joints.
        joints: usize,
        /// Number of wheels.
        wheels: usize,
        /// The problem.
        problem: &'static str,
    },
    /// The phase cannot be skipped.
    #[error("the phase {0} cannot be skipped: the next one needs what it does")]
    NotSkippable(&'static str),
    /// The mission is over.
    #[error("the mission is over: {0}")]
    Over(&'static str),
}
