//! Exceptions. Their text is that of the Rust library.

use std::fmt::Display;

use fuyu::model::Model;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::{PyErr, create_exception};

create_exception!(
    fuyu,
    InputError,
    PyValueError,
    "Invalid input: a file, a name, a value or a shape. The text says what would be right."
);
create_exception!(
    fuyu,
    RunError,
    PyRuntimeError,
    "A run that started but could not be completed, such as a motion that diverged."
);

/// An [`InputError`] with this text.
pub fn input(problem: impl Display) -> PyErr {
    InputError::new_err(problem.to_string())
}

/// A [`RunError`] with this text.
pub fn run(problem: impl Display) -> PyErr {
    RunError::new_err(problem.to_string())
}

/// Refuses objects of two robots.
pub fn same_robot(this: &str, of: &Model, other: &str, other_of: &Model) -> Result<(), PyErr> {
    if of == other_of {
        return Ok(());
    }
    let text = |model: &Model| format!("robot `{}` ({} joints)", model.name(), model.dof());
    let (of, other_of) = (text(of), text(other_of));
    Err(input(format!(
        "{this} was made for {of}, {other} for {other_of}: make both from the same model"
    )))
}

/// The value with the name `text`, of the list of all.
pub fn choose<T: Copy>(setting: &str, names: &[(&'static str, T)], text: &str) -> Result<T, PyErr> {
    let found = names.iter().find(|(name, _)| *name == text);
    found.map(|(_, value)| *value).ok_or_else(|| {
        let names: Vec<_> = names.iter().map(|(name, _)| *name).collect();
        input(format!(
            "{setting}: '{text}' is not one of {}",
            names.join(", ")
        ))
    })
}

/// Refuses a number that is not positive and finite.
pub fn positive(name: &str, value: f64) -> Result<f64, PyErr> {
    match value > 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(input(format!(
            "{name} is {value}; it must be positive and finite"
        ))),
    }
}

/// Refuses a number that is negative, NaN or infinite.
pub fn not_negative(name: &str, value: f64) -> Result<f64, PyErr> {
    match value >= 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(input(format!(
            "{name} is {value}; it must be zero or positive, and finite"
        ))),
    }
}

/// Refuses a number that is NaN or infinite.
pub fn finite(name: &str, value: f64) -> Result<f64, PyErr> {
    match value.is_finite() {
        true => Ok(value),
        false => Err(input(format!("{name} is {value}; it must be finite"))),
    }
}
