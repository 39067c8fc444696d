//! Parameter values: converted from a campaign file, and changed by drawn numbers.

use serde_json::Value;

use super::{
    file::Apply,
    parameters::{Changes, Parameters, Place},
};
use crate::ros::ParameterValue;

/// A value of the file, converted to the type of `like` or of its elements.
pub(super) fn fit(
    value: &Value,
    like: &ParameterValue,
    is_element: bool,
) -> Result<ParameterValue, String> {
    use ParameterValue as P;
    fn all<T>(value: &Value, one: impl Fn(&Value) -> Option<T>) -> Option<Vec<T>> {
        value.as_array()?.iter().map(one).collect()
    }
    let double = |v: &Value| v.as_f64();
    let text = |v: &Value| v.as_str().map(str::to_owned);
    let byte = |v: &Value| u8::try_from(v.as_u64()?).ok();
    let fitted = match (like, is_element) {
        (P::NotSet, _) => None,
        (P::Bool(_), _) | (P::BoolArray(_), true) => value.as_bool().map(P::Bool),
        (P::Integer(_), _) | (P::IntegerArray(_) | P::ByteArray(_), true) => {
            value.as_i64().map(P::Integer)
        }
        (P::Double(_), _) | (P::DoubleArray(_), true) => double(value).map(P::Double),
        (P::String(_), _) | (P::StringArray(_), true) => text(value).map(P::String),
        (P::ByteArray(_), false) => all(value, byte).map(P::ByteArray),
        (P::BoolArray(_), false) => all(value, Value::as_bool).map(P::BoolArray),
        (P::IntegerArray(_), false) => all(value, Value::as_i64).map(P::IntegerArray),
        (P::DoubleArray(_), false) => all(value, double).map(P::DoubleArray),
        (P::StringArray(_), false) => all(value, text).map(P::StringArray),
    };
    fitted.ok_or_else(|| {
        let kind = like.kind();
        match is_element {
            true => format!("{value} does not fit an element of {kind}"),
            false => format!("{value} is given, expected {kind}"),
        }
    })
}

/// The numbers in a value; `None` if it has no numbers.
pub(super) fn numbers_of(value: &ParameterValue) -> Option<Vec<f64>> {
    match value {
        ParameterValue::Integer(i) => Some(vec![*i as f64]),
        ParameterValue::Double(x) => Some(vec![*x]),
        ParameterValue::IntegerArray(v) => Some(v.iter().map(|i| *i as f64).collect()),
        ParameterValue::DoubleArray(v) => Some(v.clone()),
        _ => None,
    }
}

/// The current value of a parameter, to be changed.
pub(super) fn current<'a>(
    place: &Place,
    parameters: &Parameters,
    changes: &'a mut Changes,
) -> &'a mut ParameterValue {
    let key = (place.node, place.parameter.clone());
    changes
        .entry(key)
        .or_insert_with(|| parameters.nominal(place).clone())
}

/// Replaces the value of a parameter or element.
pub(super) fn put_whole(
    place: &Place,
    value: &ParameterValue,
    parameters: &Parameters,
    changes: &mut Changes,
) {
    use ParameterValue as P;
    let now = current(place, parameters, changes);
    let Some(element) = place.element else {
        *now = value.clone();
        return;
    };
    match (now, value) {
        (P::BoolArray(v), P::Bool(x)) => v[element] = *x,
        (P::IntegerArray(v), P::Integer(x)) => v[element] = *x,
        // The range of a byte was checked when the campaign was read.
        (P::ByteArray(v), P::Integer(x)) => v[element] = u8::try_from(*x).unwrap_or(u8::MAX),
        (P::DoubleArray(v), P::Double(x)) => v[element] = *x,
        (P::StringArray(v), P::String(x)) => v[element].clone_from(x),
        _ => {}
    }
}

/// Changes a parameter or element by drawn numbers, one per element for a whole list.
pub(super) fn put_numbers(
    place: &Place,
    numbers: &[f64],
    apply: Apply,
    parameters: &Parameters,
    changes: &mut Changes,
) {
    let combine = |now: f64, drawn: f64| match apply {
        Apply::Set => drawn,
        Apply::Add => now + drawn,
        Apply::Scale => now * drawn,
    };
    // Integers are below 2^53, so that conversions are exact.
    let whole = |now: i64, drawn: f64| combine(now as f64, drawn) as i64;
    match (current(place, parameters, changes), place.element) {
        (ParameterValue::Double(x), _) => *x = combine(*x, numbers[0]),
        (ParameterValue::Integer(i), _) => *i = whole(*i, numbers[0]),
        (ParameterValue::DoubleArray(v), Some(element)) => {
            v[element] = combine(v[element], numbers[0])
        }
        (ParameterValue::IntegerArray(v), Some(element)) => {
            v[element] = whole(v[element], numbers[0])
        }
        (ParameterValue::DoubleArray(v), None) => {
            // Numbers added to an empty list are added to zeros.
            v.resize(numbers.len(), 0.0);
            v.iter_mut()
                .zip(numbers)
                .for_each(|(x, n)| *x = combine(*x, *n));
        }
        (ParameterValue::IntegerArray(v), None) => {
            v.resize(numbers.len(), 0);
            v.iter_mut()
                .zip(numbers)
                .for_each(|(i, n)| *i = whole(*i, *n));
        }
        _ => {}
    }
}
