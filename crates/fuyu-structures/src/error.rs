//! Errors in the description of a structure.

use std::fmt::Display;

use nalgebra::DMatrix;
use thiserror::Error;

/// Why a structure, a model or a modes file is rejected. Each message is one line that names field and value and says
/// what would be right.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum StructureError {
    /// A number outside of its range, or not a number.
    #[error("{field} is {value}; it must be {requirement}")]
    Value {
        /// What the number is, such as `length [m]`.
        field: String,
        /// The number.
        value: f64,
        /// The range.
        requirement: String,
    },
    /// A vector or matrix of the wrong size, or a missing part.
    #[error("{field} has {found}; it must have {expected}")]
    Size {
        /// What has the wrong size.
        field: String,
        /// Its size.
        found: String,
        /// The right size.
        expected: String,
    },
    /// A matrix that has to be symmetric is not.
    #[error(
        "{matrix} is not symmetric: entries ({row}, {column}) and ({column}, {row}) differ by {difference:e}"
    )]
    Asymmetric {
        /// The matrix.
        matrix: String,
        /// Row of the largest difference, from 0.
        row: usize,
        /// Column of the largest difference, from 0.
        column: usize,
        /// The difference.
        difference: f64,
    },
    /// A matrix that has to be positive definite or regular is not.
    #[error("{matrix} is not {property}; {remedy}")]
    Matrix {
        /// The matrix.
        matrix: String,
        /// `positive definite` or `regular`.
        property: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// An eigenvalue iteration reached its limit.
    #[error("the eigenvalues of {matrix} did not converge; check its entries for extreme scales")]
    NoConvergence {
        /// The matrix.
        matrix: String,
    },
    /// A modes file that cannot be read.
    #[error("{name}{}, {field}: {message}", match line { Some(n) => format!(", line {n}"), None => String::new() })]
    File {
        /// The file's name, as the caller gave it.
        name: String,
        /// The line, from 1, if known.
        line: Option<u64>,
        /// The field.
        field: String,
        /// What is wrong, and what would be right.
        message: String,
    },
}

/// Rejects numbers that are not finite.
pub(crate) fn finite(field: impl Display, value: f64) -> Result<f64, StructureError> {
    in_range(field, value, value.is_finite(), "finite")
}

/// Rejects a matrix with an entry that is not a finite number.
pub(crate) fn finite_entries(
    name: impl Display,
    matrix: &DMatrix<f64>,
) -> Result<(), StructureError> {
    for value in matrix.iter() {
        finite(format_args!("an entry of the {name}"), *value)?;
    }
    Ok(())
}

/// Rejects numbers that are not positive and finite.
pub(crate) fn positive(field: impl Display, value: f64) -> Result<f64, StructureError> {
    in_range(field, value, value.is_finite() && value > 0.0, "positive")
}

/// Rejects numbers that are negative or not finite.
pub(crate) fn not_negative(field: impl Display, value: f64) -> Result<f64, StructureError> {
    let right = value.is_finite() && value >= 0.0;
    in_range(field, value, right, "zero or positive")
}

/// Rejects a count outside of a range.
pub(crate) fn count(
    field: impl Display,
    value: usize,
    least: usize,
    most: usize,
) -> Result<(), StructureError> {
    let right = (least..=most).contains(&value);
    let requirement = format_args!("from {least} to {most}");
    in_range(field, value as f64, right, requirement).map(drop)
}

/// Rejects an index that is not below `n`.
pub(crate) fn index(field: impl Display, value: usize, n: usize) -> Result<(), StructureError> {
    match n {
        0 => in_range(field, value as f64, false, "absent, as there is none").map(drop),
        _ => count(field, value, 0, n - 1),
    }
}

/// The indices below `n` other than those in `some`, which have to be below `n` as well.
pub(crate) fn others(field: &str, some: &[usize], n: usize) -> Result<Vec<usize>, StructureError> {
    for i in some {
        index(field, *i, n)?;
    }
    Ok((0..n).filter(|i| !some.contains(i)).collect())
}

fn in_range(
    field: impl Display,
    value: f64,
    right: bool,
    requirement: impl Display,
) -> Result<f64, StructureError> {
    if right {
        return Ok(value);
    }
    Err(StructureError::Value {
        field: field.to_string(),
        value,
        requirement: requirement.to_string(),
    })
}

/// Rejects a size other than the expected one.
pub(crate) fn size(
    field: impl Display,
    found: (usize, usize),
    expected: (usize, usize),
) -> Result<(), StructureError> {
    if found == expected {
        return Ok(());
    }
    Err(StructureError::Size {
        field: field.to_string(),
        found: format!("{} x {} entries", found.0, found.1),
        expected: format!("{} x {}", expected.0, expected.1),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    // The largest index of nothing is not 0.
    #[test]
    fn nothing_has_no_index() {
        let message = |value, n| index("node", value, n).unwrap_err().to_string();
        assert!(message(0, 0).contains("node") && message(0, 0).contains("none"));
        assert!(message(2, 2).contains("from 0 to 1"));
        assert_eq!(index("node", 1, 2), Ok(()));
    }
}
