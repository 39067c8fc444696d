//! The tables of chapter 2 of Kida 1993 (Tables 2.1 to 2.12) and Table 3.1: printed and computed values.
//!
//! ```
//! let table = fuyu_structures::kida1993::table(6)?; // Table 2.6, poles of ETS-VI
//! let (printed, computed) = (&table.columns[0].printed, &table.columns[0].computed);
//! assert_eq!(printed[0].value(), Some(0.097));
//! assert!((computed[0].unwrap() - 0.097).abs() < 5e-4);
//! # Ok::<(), fuyu_structures::StructureError>(())
//! ```

mod air_table;
mod ets6;
mod truss;

use serde::Serialize;

pub use self::{
    air_table::{AirTable, air_table},
    ets6::{Ets6, Family, ets6},
    truss::{TRUSS_INPUTS_3, TRUSS_INPUTS_4, truss},
};
use crate::StructureError;

/// A value as printed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Printed {
    /// A number.
    Value(f64),
    /// An empty cell.
    Blank,
    /// "∞", or only an order of magnitude such as "~ 10^7": a zero at infinity that the QZ algorithm of 1993 found.
    Infinite,
}

impl Printed {
    /// The number, if one is printed.
    pub fn value(self) -> Option<f64> {
        match self {
            Self::Value(v) => Some(v),
            Self::Blank | Self::Infinite => None,
        }
    }
}

/// One column of a table.
#[derive(Clone, Debug, Serialize)]
pub struct Column {
    /// What the column contains.
    pub heading: &'static str,
    /// As printed \[Hz\], one entry for each row.
    pub printed: Vec<Printed>,
    /// As computed here \[Hz\], `None` where a row has no such value.
    pub computed: Vec<Option<f64>>,
}

/// Whether a table can be reproduced.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It is data of the problem.
    Input,
    /// The first column to the given difference \[Hz\], the last printed digit or what the recovered parameters allow, the others
    /// to another one.
    Reproduced {
        /// Largest difference in the first column \[Hz\].
        first: f64,
        /// Largest difference in the second column \[Hz\], if there is one.
        second: f64,
    },
    /// Not reproducible, for the given reason.
    NotReproducible(&'static str),
}

/// A table of Kida 1993.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// Such as "2.1".
    pub number: String,
    /// What it contains.
    pub title: &'static str,
    /// Names of the rows, or empty.
    pub rows: Vec<&'static str>,
    /// Its columns; frequencies \[Hz\].
    pub columns: Vec<Column>,
    /// Whether it is reproduced.
    pub verdict: Verdict,
    /// What to know about it.
    pub remark: &'static str,
}

/// Remark on the columns of the QZ algorithm, which this library does not compute.
pub(crate) const QZ: &str = "The third column is the QZ algorithm of 1993, whose rows without a value in the other columns are \
    not zeros of the system but rounding at infinity.";

/// Table `2.number`, from 1 to 12.
///
/// # Errors
/// Another number; numerical failure, which does not occur with these data.
pub fn table(number: usize) -> Result<Table, StructureError> {
    crate::error::count("number of the table in chapter 2", number, 1, 12)?;
    match number {
        1..=4 => truss::table(number),
        _ => ets6::table(number),
    }
}

/// All tables of chapter 2.
///
/// # Errors
/// As [`table`].
pub fn tables() -> Result<Vec<Table>, StructureError> {
    (1..=12).map(table).collect()
}

/// An empty cell among printed numbers.
const BLANK: f64 = f64::NAN;

/// What is printed as infinite.
const INFINITE: f64 = f64::INFINITY;

/// A column from printed numbers, [`BLANK`] and [`INFINITE`].
pub(crate) fn column(heading: &'static str, printed: &[f64], computed: &[f64]) -> Column {
    let mut values = computed.iter().copied();
    let as_printed = |v: &f64| match *v {
        v if v.is_nan() => Printed::Blank,
        v if v.is_infinite() => Printed::Infinite,
        v => Printed::Value(v),
    };
    let printed: Vec<Printed> = printed.iter().map(as_printed).collect();
    let computed = printed
        .iter()
        .map(|p| p.value().and_then(|_| values.next()))
        .collect();
    Column {
        heading,
        printed,
        computed,
    }
}

/// A column that is not computed.
pub(crate) fn printed_only(heading: &'static str, printed: &[f64]) -> Column {
    column(heading, printed, &[])
}
