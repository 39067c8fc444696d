//! What a law may know.

use nalgebra::DVector;

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
    pub sight: Option<&'a Sight>,
}

impl<'a> Measurement<'a> {
    /// A joint state, and nothing seen.
    pub fn new(time: f64, q: &'a DVector<f64>, qd: &'a DVector<f64>) -> Self {
        Self {
            time,
            q,
            qd,
            sight: None,
        }
    }

    /// The same with what the camera saw.
    pub fn with_sight(self, sight: Option<&'a Sight>) -> Self {
        Self { sight, ..self }
    }
}

/// Tip and goal as a camera on the base saw them at one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// Time of the exposure \[s\], on the clock of [`Measurement::time`].
    pub time: f64,
    /// Tip pose in the base frame.
    pub X_BE: Pose,
    /// Goal pose in the base frame.
    pub X_BD: Pose,
}

impl Sight {
    /// Of tip and goal poses in the base frame.
    pub fn new(time: f64, X_BE: Pose, X_BD: Pose) -> Self {
        Self { time, X_BE, X_BD }
    }
}
