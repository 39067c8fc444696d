//! Gains that several laws share, and what is wrong with a gain.

use super::Saturation;

/// Gains on the deviation of the tip and on the joint rates.
#[derive(Debug, Clone, PartialEq)]
pub struct Gains {
    /// Position gain `k_p` \[N/m\] (the thesis prints N).
    pub k_p: f64,
    /// Orientation gain `k_o` \[N m\]; zero leaves the attitude of the tip free, as chapters 6 and 7 do.
    pub k_o: f64,
    /// Diagonal of the velocity gain `K_V` \[N m s/rad or N s/m\], one per joint.
    pub k_v: Vec<f64>,
    /// Saturation of the errors.
    pub saturation: Saturation,
}

impl Gains {
    /// Refuses gains that break the proof of stability.
    ///
    /// # Errors
    /// [`GainError`] when a gain has the wrong sign or `k_v` does not have one value per joint.
    pub fn check(&self, joints: usize) -> Result<(), GainError> {
        check_positive("k_p", self.k_p)?;
        check_not_negative("k_o", self.k_o)?;
        check_joint_gains("k_v", &self.k_v, joints)?;
        self.saturation.check()
    }
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
    /// A gain that may be zero is negative or not finite.
    #[error("{name} is {value}; it must be finite and not negative")]
    Negative {
        /// Which gain.
        name: &'static str,
        /// Its value.
        value: f64,
    },
}

/// Refuses what is not positive and finite.
pub(super) fn check_positive(name: &'static str, value: f64) -> Result<(), GainError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(GainError::NotPositive { name, value })
    }
}

/// Refuses what is negative or not finite.
pub(super) fn check_not_negative(name: &'static str, value: f64) -> Result<(), GainError> {
    if value >= 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(GainError::Negative { name, value })
    }
}

/// Refuses what is not one positive value per joint.
pub(super) fn check_joint_gains(
    name: &'static str,
    values: &[f64],
    joints: usize,
) -> Result<(), GainError> {
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
