//! Why settings or measurements are refused.

use fuyu_lti::LtiError;

/// Why an attitude controller cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AttitudeConfigError {
    /// A setting is out of its range.
    #[error("{what} is {value}; it must be {expected}")]
    Value {
        /// Name of the setting, with its unit.
        what: String,
        /// Its value.
        value: f64,
        /// The allowed range.
        expected: &'static str,
    },
    /// The robot lacks a part that the controller needs.
    #[error("{0}")]
    Robot(String),
    /// A design has no solution.
    #[error("{what}: {reason}")]
    Design {
        /// What was designed.
        what: String,
        /// Why there is no solution.
        reason: LtiError,
    },
}

impl AttitudeConfigError {
    pub(super) fn design(what: &str) -> impl FnOnce(LtiError) -> Self {
        let what = what.to_owned();
        move |reason| Self::Design { what, reason }
    }
}

/// Refuses a setting unless `is_right`.
pub(super) fn require(
    what: &str,
    value: f64,
    is_right: bool,
    expected: &'static str,
) -> Result<(), AttitudeConfigError> {
    if is_right && !value.is_nan() {
        return Ok(());
    }
    Err(AttitudeConfigError::Value {
        what: what.to_owned(),
        value,
        expected,
    })
}

/// Refuses a setting that is not positive and finite.
pub(super) fn require_positive(what: &str, value: f64) -> Result<(), AttitudeConfigError> {
    require(
        what,
        value,
        value > 0.0 && value.is_finite(),
        "positive and finite",
    )
}

/// Refuses a setting that is negative or not finite.
pub(super) fn require_not_negative(what: &str, value: f64) -> Result<(), AttitudeConfigError> {
    require(
        what,
        value,
        value >= 0.0 && value.is_finite(),
        "zero or positive, and finite",
    )
}

/// Why a measurement is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AttitudeInputError {
    /// A value is NaN or infinite.
    #[error("{what} is {value}; it must be finite")]
    NotFinite {
        /// Name of the quantity.
        what: String,
        /// Its value.
        value: f64,
    },
    /// A list has a wrong length.
    #[error("{what}: {got} values; {expected} are needed")]
    Length {
        /// Name of the quantity.
        what: &'static str,
        /// How many there are.
        got: usize,
        /// How many there must be.
        expected: usize,
    },
}

/// Refuses values that are not finite; `name` gives the name of value `i`.
pub(super) fn finite(
    values: &[f64],
    name: impl Fn(usize) -> String,
) -> Result<(), AttitudeInputError> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(i) => Err(AttitudeInputError::NotFinite {
            what: name(i),
            value: values[i],
        }),
    }
}

/// Refuses a vector that is not finite; `what` is its name.
pub(super) fn finite_vector(
    what: &str,
    vector: &nalgebra::Vector3<f64>,
) -> Result<(), AttitudeInputError> {
    finite(vector.as_slice(), |i| {
        format!("{what}.{}", ["x", "y", "z"][i])
    })
}
