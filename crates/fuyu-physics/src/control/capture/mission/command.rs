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
    /// Angular momentum of the wheels relative to the base, base axes \[N m s\]; zero without wheels.
    pub wheels: Vector3<f64>,
}

/// Commands of the mission.
#[derive(Debug, Clone, Copy)]
pub struct Command<'a> {
    /// Joint efforts \[N m or N\].
    pub efforts: &'a [f64],
    /// Couple on the base, by thrusters, base axes \[N m\].
    pub couple: Vector3<f64>,
    /// Couple on the base, by wheels, base axes \[N m\].
    pub wheel_couple: Vector3<f64>,
    /// The gripper.
    pub gripper: Gripper,
}

/// Why the mission refuses something.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MissionError {
    /// A setting is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A measurement that is not finite, or does not fit the robot.
    #[error("a sample of {joints} joints with finite values is needed: {problem}")]
    Sample {
        /// Number of the robot's joints.
        joints: usize,
        /// What is wrong.
        problem: &'static str,
    },
    /// The phase cannot be skipped.
    #[error("the phase {0} cannot be skipped: the next one needs what it does")]
    NotSkippable(&'static str),
    /// The mission is over.
    #[error("the mission is over: {0}")]
    Over(&'static str),
}
