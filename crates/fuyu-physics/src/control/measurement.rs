//! Sensor data that a controller acts on, and the check that they are finite.

use nalgebra::{DVector, Vector3};

use super::ControlError;
use crate::model::Model;
use crate::spatial::Pose;

/// All measurements of a controller at one instant. The pose of the base is not among them.
#[derive(Debug, Clone, Copy)]
pub struct Measurement<'a> {
    /// Time of the joint state \[s\], on any clock that runs evenly.
    pub time: f64,
    /// Joint positions \[rad or m\].
    pub q: &'a DVector<f64>,
    /// Joint rates \[rad/s or m/s\].
    pub qd: &'a DVector<f64>,
    /// Last camera measurement of the first tip; `None` without one, or if it is too old to act on.
    pub tip: Option<&'a TipMeasurement>,
    /// Last camera measurements of the second and further tips of a robot with several arms.
    pub more_tips: &'a [Option<TipMeasurement>],
    /// Angular velocity of the base measured by its gyro, base axes \[rad/s\]. Without it the angular momentum of the
    /// robot is assumed to be zero.
    pub w_IB_B: Option<&'a Vector3<f64>>,
    /// Angular velocity of the goal, if an estimator provides it.
    pub goal_rate: Option<&'a GoalRate>,
}

/// The goal's angular velocity at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalRate {
    /// The time \[s\], on the clock of [`Measurement::time`].
    pub time: f64,
    /// Angular velocity in base axes at that time \[rad/s\].
    pub w_ID_B: Vector3<f64>,
}

/// Tip and goal, measured at one exposure of a camera on the base.
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
    /// Tip and goal poses in the base frame, exposed at `time` \[s\].
    pub fn new(time: f64, X_BE: Pose, X_BD: Pose) -> Self {
        Self { time, X_BE, X_BD }
    }
}

impl<'a> Measurement<'a> {
    /// A joint state without camera, gyro or estimator data.
    pub fn new(time: f64, q: &'a DVector<f64>, qd: &'a DVector<f64>) -> Self {
        Self {
            time,
            q,
            qd,
            tip: None,
            more_tips: &[],
            w_IB_B: None,
            goal_rate: None,
        }
    }

    /// The same measurement with the angular velocity from the gyro \[rad/s\].
    pub fn with_gyro(self, w_IB_B: Option<&'a Vector3<f64>>) -> Self {
        Self { w_IB_B, ..self }
    }

    /// The same measurement with a camera measurement of the first tip.
    pub fn with_tip(self, tip: Option<&'a TipMeasurement>) -> Self {
        Self { tip, ..self }
    }

    /// Refuses a joint state that does not fit `model` or is not finite.
    pub(super) fn check_joint_state(&self, model: &Model) -> Result<(), ControlError> {
        let joints = model.dof();
        for (values, quantity) in [(self.q, "position"), (self.qd, "rate")] {
            if values.len() != joints {
                return Err(ControlError::JointCount {
                    quantity,
                    got: values.len(),
                    joints,
                });
            }
            for (joint, value) in model.joints().iter().zip(values) {
                finite([*value], || {
                    format!("the {quantity} of joint '{}'", joint.name)
                })?;
            }
        }
        finite([self.time], || "the time of the joint state".to_owned())
    }

    /// Refuses camera, gyro and estimator data that are not finite.
    pub(super) fn check_sensors(&self) -> Result<(), ControlError> {
        let tips = std::iter::once(self.tip).chain(self.more_tips.iter().map(Option::as_ref));
        for (k, tip) in tips.enumerate() {
            let Some(TipMeasurement { time, X_BE, X_BD }) = tip else {
                continue;
            };
            let of_tip = || {
                if k == 0 {
                    String::new()
                } else {
                    format!(" of tip {}", k + 1)
                }
            };
            finite([*time], || format!("the exposure time{}", of_tip()))?;
            finite(elements(X_BE), || format!("the tip pose X_BE{}", of_tip()))?;
            finite(elements(X_BD), || format!("the goal pose X_BD{}", of_tip()))?;
        }
        if let Some(w) = self.w_IB_B {
            finite(w.iter().copied(), || {
                "the gyro's angular velocity w_IB_B".to_owned()
            })?;
        }
        if let Some(GoalRate { time, w_ID_B }) = self.goal_rate {
            finite(w_ID_B.iter().copied().chain([*time]), || {
                "the goal's angular velocity w_ID_B or its time".to_owned()
            })?;
        }
        Ok(())
    }
}

fn elements(pose: &Pose) -> impl Iterator<Item = f64> {
    let rotation = pose.rotation.matrix().iter();
    rotation.chain(pose.translation.vector.iter()).copied()
}

fn finite(
    values: impl IntoIterator<Item = f64>,
    quantity: impl Fn() -> String,
) -> Result<(), ControlError> {
    match values.into_iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(value) => Err(ControlError::Measurement {
            quantity: quantity(),
            value,
        }),
    }
}
