//! Declarations of bounded numbers and of directions, for the parts of a robot.

use nalgebra::{Unit, Vector3};

use crate::{nodes::placement::finite, ros::Declare};

/// Declares a required positive number.
pub(super) fn positive(declare: &mut Declare, name: &str, description: &str) -> f64 {
    let parameter = declare.required(name, description).read_only();
    parameter
        .check("a number above 0.0", |value: &f64| {
            match *value > 0.0 && value.is_finite() {
                true => Ok(()),
                false => Err(format!(
                    "{value} is out of range, expected a number above 0.0"
                )),
            }
        })
        .value()
}

/// Declares a non-negative number with a default.
pub(super) fn not_negative(
    declare: &mut Declare,
    name: &str,
    default: f64,
    description: &str,
) -> f64 {
    let parameter = declare.param(name, default, description).read_only();
    parameter
        .check("0.0 or above", |value: &f64| {
            match *value >= 0.0 && value.is_finite() {
                true => Ok(()),
                false => Err(format!("{value} is out of range, expected 0.0 or above")),
            }
        })
        .value()
}

/// Declares a limit; zero, the default, means no limit and is returned as infinity.
pub(super) fn limit(declare: &mut Declare, name: &str, description: &str) -> f64 {
    let text = format!("{description}; 0 is no limit");
    match not_negative(declare, name, 0.0, &text) {
        0.0 => f64::INFINITY,
        limit => limit,
    }
}

/// Declares a required direction: three numbers, not all zero.
pub(super) fn direction(
    declare: &mut Declare,
    name: &str,
    description: &str,
) -> Unit<Vector3<f64>> {
    let parameter = declare.required(name, description).read_only();
    let values: Vec<f64> = parameter
        .check("3 finite numbers, not all zero", |values: &Vec<f64>| {
            finite(values, 3)?;
            match values.iter().any(|x| x.abs() > 1e-9) {
                true => Ok(()),
                false => Err(format!(
                    "{values:?} has no direction, expected 3 numbers that are not all zero"
                )),
            }
        })
        .value();
    match values.as_slice() {
        &[x, y, z] => Unit::new_normalize(Vector3::new(x, y, z)),
        // Other values have been reported by the declaration.
        _ => Vector3::x_axis(),
    }
}

/// Declares a time \[s\]; a negative value, the default, means on command only and is returned as `None`.
pub(super) fn scheduled_time(declare: &mut Declare, name: &str, description: &str) -> Option<f64> {
    let text = format!("{description} [s]; negative is on command");
    let value: f64 = declare
        .param(name, -1.0, &text)
        .check("a finite number", |value: &f64| match value.is_finite() {
            true => Ok(()),
            false => Err(format!("{value} is not finite")),
        })
        .read_only()
        .value();
    (value >= 0.0).then_some(value)
}
