//! Gains that all laws share, and the checks of settings.

use super::Saturation;

/// Gains on the deviation of the tip and on the joint rates.
#[derive(Debug, Clone, PartialEq)]
pub struct Gains {
    /// Position gain `k_p` \[N/m\] (the thesis prints N).
    pub k_p: f64,
    /// Orientation gain `k_o` \[N m\]; zero leaves the attitude of the tip free, as in chapters 6 and 7.
    pub k_o: f64,
    /// Diagonal of the velocity gain `K_V` \[N m s/rad or N s/m\], one per joint.
    pub k_v: Vec<f64>,
    /// Saturation of the errors.
    pub saturation: Saturation,
}

impl Gains {
    /// Refuses gains that violate the conditions of the proof of stability.
    ///
    /// # Errors
    /// [`ConfigError`] when a gain has the wrong sign, is not finite, or when `k_v` does not have one value per joint.
    pub fn check(&self, joints: usize) -> Result<(), ConfigError> {
        check_positive("k_p", self.k_p)?;
        check_not_negative("k_o", self.k_o)?;
        check_joint_gains("k_v", &self.k_v, joints)?;
        self.saturation.check()
    }
}

/// Why settings cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// A vector of gains does not fit the robot.
    #[error("{name} has {got} values; the robot has {joints} joints, so give {joints}")]
    Length {
        /// Name of the gains.
        name: &'static str,
        /// How many values were given.
        got: usize,
        /// How many joints the robot has.
        joints: usize,
    },
    /// A setting that must be positive and finite is not.
    #[error("{name} is {value}; it must be positive and finite")]
    NotPositive {
        /// Name of the setting; for a gain of one joint with its index from zero, as in `k_v[2]`.
        name: String,
        /// Its value.
        value: f64,
    },
    /// A setting that must be zero or positive and finite is not.
    #[error("{name} is {value}; it must be finite and not negative")]
    Negative {
        /// Name of the setting.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// Gains are to be computed for a robot without joints that move its tip.
    #[error("no gains can be computed: no joint moves the tip")]
    NoAutoGains,
    /// [`LawConfig::Custom`](super::LawConfig::Custom) for a controller that has no user-defined law.
    #[error(
        "law is custom, but the controller has no user-defined law; give it to Controller::with_law"
    )]
    NoCustomLaw,
}

/// Refuses a value that is not positive and finite.
pub(super) fn check_positive(name: &str, value: f64) -> Result<(), ConfigError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(ConfigError::NotPositive {
            name: name.to_owned(),
            value,
        })
    }
}

/// Refuses a value that is negative or not finite.
pub(super) fn check_not_negative(name: &'static str, value: f64) -> Result<(), ConfigError> {
    if value >= 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(ConfigError::Negative { name, value })
    }
}

/// Refuses values that are not one positive number per joint.
pub(super) fn check_joint_gains(
    name: &'static str,
    values: &[f64],
    joints: usize,
) -> Result<(), ConfigError> {
    if values.len() != joints {
        return Err(ConfigError::Length {
            name,
            got: values.len(),
            joints,
        });
    }
    let wrong = values.iter().position(|k| !(*k > 0.0 && k.is_finite()));
    wrong.map_or(Ok(()), |j| {
        check_positive(&format!("{name}[{j}]"), values[j])
    })
}
