//! What a law may know.

use nalgebra::{DVector, UnitQuaternion, Vector3};

use super::prediction::Predicted;
use crate::spatial::Pose;

/// Everything that a law may know at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Measurement<'a> {
    /// Time of the joint state \[s\], on any clock that runs on evenly.
    pub time: f64,
    /// Joint positions \[rad or m\].
    pub q: &'a DVector<f64>,
    /// Joint rates \[rad/s or m/s\].
    pub qd: &'a DVector<f64>,
    /// What the camera saw last; `None` if that is too old to act on, or nothing has come yet.
    pub tip: Option<&'a TipMeasurement>,
    /// The same of the second tip and those after it, of a robot with several arms.
    pub more_tips: &'a [Option<TipMeasurement>],
    /// What the gyro of the base measures, base axes \[rad/s\]. Without it the robot is taken to have no angular
    /// momentum.
    pub w_IB_B: Option<&'a Vector3<f64>>,
    /// How the goal turns, if somebody has estimated it.
    pub goal_rate: Option<&'a GoalRate>,
    /// Joint rates that move the tip with its goal \[rad/s or m/s\], where the [`Controller`](super::Controller) feeds them
    /// forward.
    pub lead: Option<&'a DVector<f64>>,
    /// Base and goals at present, which the [`Controller`](super::Controller) finds out for the laws.
    pub present: Option<Present<'a>>,
}

/// The goal's angular velocity at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalRate {
    /// The time \[s\], on the clock of [`Measurement::time`].
    pub time: f64,
    /// Angular velocity in base axes of that time \[rad/s\].
    pub w_ID_B: Vector3<f64>,
}

/// Base and goals at present, in or seen from the frame I of [`super::prediction`].
#[derive(Debug, Clone, Copy)]
pub struct Present<'a> {
    /// Angular velocity of the base, base axes \[rad/s\].
    pub w_IB_B: &'a Vector3<f64>,
    /// Attitude of the base.
    pub R_IB: &'a UnitQuaternion<f64>,
    /// Tip and goal for each tip; `None` for one that is not seen.
    pub goals: &'a [Option<Predicted>],
}

impl<'a> Measurement<'a> {
    /// A joint state, and nothing seen.
    pub fn new(time: f64, q: &'a DVector<f64>, qd: &'a DVector<f64>) -> Self {
        Self {
            time,
            q,
            qd,
            tip: None,
            more_tips: &[],
            w_IB_B: None,
            goal_rate: None,
            lead: None,
            present: None,
        }
    }

    /// The same with what the gyro measures \[rad/s\].
    pub fn with_gyro(self, w_IB_B: Option<&'a Vector3<f64>>) -> Self {
        Self { w_IB_B, ..self }
    }

    /// The same with what the camera saw.
    pub fn with_tip(self, tip: Option<&'a TipMeasurement>) -> Self {
        Self { tip, ..self }
    }
}

/// Tip and goal as a camera on the base saw them at one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipMeasurement {
    /// Time of the exposure \[s\], on the clock of [`Measurement::time`].
    pub time: f64,
    /// Tip pose in the base frame.
    pub X_BE: Pose,
    /// Goal pose in the base frame.
    pub X_BD: Pose,
}

impl TipMeasurement {
    /// Of tip and goal poses in the base frame.
    pub fn new(time: f64, X_BE: Pose, X_BD: Pose) -> Self {
        Self { time, X_BE, X_BD }
    }
}
