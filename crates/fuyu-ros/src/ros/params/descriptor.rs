//! Descriptor of a parameter: type, description, range.

use super::{Kind, ParameterValue};
use crate::msg::rcl_interfaces as msg;

/// Range of a numeric parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// Integers.
    Integer {
        /// Smallest.
        from: i64,
        /// Largest.
        to: i64,
    },
    /// Doubles.
    Double {
        /// Smallest.
        from: f64,
        /// Largest.
        to: f64,
    },
}

/// Descriptor of a parameter: all but its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Descriptor {
    /// Dotted name of the parameter.
    pub name: String,
    /// Type of the parameter, which never changes.
    pub kind: Kind,
    /// Purpose and unit of the parameter.
    pub description: String,
    /// Constraints beyond the range, in words.
    pub additional_constraints: String,
    /// Whether the parameter is fixed once the node runs.
    pub read_only: bool,
    /// Range of a number, or of every element of a list.
    pub range: Option<Range>,
}

impl Descriptor {
    /// Checks that `value`, which has the right type, is within the range.
    pub(super) fn check_range(&self, value: &ParameterValue) -> Result<(), String> {
        // The comparisons are ordered such that NaN fails.
        let inside = match (self.range, value) {
            (Some(Range::Double { from, to }), ParameterValue::Double(v)) => from <= *v && *v <= to,
            (Some(Range::Double { from, to }), ParameterValue::DoubleArray(v)) => {
                v.iter().all(|v| from <= *v && *v <= to)
            }
            (Some(Range::Integer { from, to }), ParameterValue::Integer(v)) => {
                (from..=to).contains(v)
            }
            (Some(Range::Integer { from, to }), ParameterValue::IntegerArray(v)) => {
                v.iter().all(|v| (from..=to).contains(v))
            }
            (None, ParameterValue::Double(v)) if v.is_nan() => {
                return Err("NaN is not a value".to_owned());
            }
            (None, ParameterValue::DoubleArray(v)) if v.iter().any(|v| v.is_nan()) => {
                return Err(format!("{value} holds NaN, which is not a value"));
            }
            _ => true,
        };
        match (inside, self.range) {
            (false, Some(Range::Double { from, to })) => {
                Err(format!("{value} is out of range, expected {from} to {to}"))
            }
            (false, Some(Range::Integer { from, to })) => {
                Err(format!("{value} is out of range, expected {from} to {to}"))
            }
            _ => Ok(()),
        }
    }
}

impl From<&Descriptor> for msg::ParameterDescriptor {
    fn from(d: &Descriptor) -> Self {
        let integer_range = match d.range {
            Some(Range::Integer { from, to }) => vec![msg::IntegerRange {
                from_value: from,
                to_value: to,
                step: 0,
            }],
            _ => Vec::new(),
        };
        let floating_point_range = match d.range {
            Some(Range::Double { from, to }) => vec![msg::FloatingPointRange {
                from_value: from,
                to_value: to,
                step: 0.0,
            }],
            _ => Vec::new(),
        };
        Self {
            name: d.name.clone(),
            r#type: d.kind as u8,
            description: d.description.clone(),
            additional_constraints: d.additional_constraints.clone(),
            read_only: d.read_only,
            dynamic_typing: false,
            // Each list has at most one element, which its bound allows.
            floating_point_range: floating_point_range.try_into().unwrap_or_default(),
            integer_range: integer_range.try_into().unwrap_or_default(),
        }
    }
}
