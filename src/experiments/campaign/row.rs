//! The row of a run, and its serialisation in a journal.

use serde::{Deserialize, Serialize};

/// Outcome of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All criteria are met.
    Success,
    /// The simulation ended, but a criterion is not met.
    Failure,
    /// The simulation could not start or ended early: an invalid value, a motion that diverged.
    Error,
    /// The run exceeded the time limit.
    Timeout,
    /// The program panicked.
    Panic,
    /// The process of the run died.
    Crash,
}

impl Verdict {
    /// All verdicts.
    pub const ALL: [Self; 6] = [
        Self::Success,
        Self::Failure,
        Self::Error,
        Self::Timeout,
        Self::Panic,
        Self::Crash,
    ];

    /// Its name in the dataset.
    pub fn name(self) -> &'static str {
        match self {
            Self::Success => "success",
            Self::Failure => "failure",
            Self::Error => "error",
            Self::Timeout => "timeout",
            Self::Panic => "panic",
            Self::Crash => "crash",
        }
    }
}

/// A value in a row.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// No value.
    Null,
    /// A floating-point number.
    Number(f64),
    /// An integer.
    Integer(i64),
    /// True or false.
    Bool(bool),
    /// A text.
    Text(String),
}

impl Cell {
    /// The value as a number, if possible; true is 1.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(x) => Some(*x),
            Self::Integer(i) => Some(*i as f64),
            Self::Bool(b) => Some(f64::from(u8::from(*b))),
            Self::Null | Self::Text(_) => None,
        }
    }
}

/// Serialised as text, since JSON has no infinity, and readers of its numbers may lose the last bit.
impl From<Cell> for String {
    fn from(cell: Cell) -> Self {
        match cell {
            Cell::Null => Self::new(),
            Cell::Number(x) => format!("n{x:?}"),
            Cell::Integer(i) => format!("i{i}"),
            Cell::Bool(b) => format!("b{b}"),
            Cell::Text(text) => format!("t{text}"),
        }
    }
}

impl TryFrom<String> for Cell {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let Some(kind) = text.chars().next() else {
            return Ok(Self::Null);
        };
        let value = &text[kind.len_utf8()..];
        let cell = match kind {
            'n' => value.parse().ok().map(Self::Number),
            'i' => value.parse().ok().map(Self::Integer),
            'b' => value.parse().ok().map(Self::Bool),
            't' => Some(Self::Text(value.to_owned())),
            _ => None,
        };
        cell.ok_or_else(|| format!("'{text}' is no value of a row"))
    }
}

impl Serialize for Cell {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&String::from(self.clone()))
    }
}

impl<'de> Deserialize<'de> for Cell {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Self::try_from(text).map_err(serde::de::Error::custom)
    }
}

/// Parameters, verdict and results of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Number of the run, from 0.
    pub run: u64,
    /// Seed of the run, from which the seeds of its sensors are derived.
    pub seed: u64,
    /// How it ended.
    pub verdict: Verdict,
    /// Reason if it is not a success.
    pub reason: Option<String>,
    /// Dispersed parameters, in the order of [`Campaign::parameters`](super::Campaign::parameters).
    pub parameters: Vec<Cell>,
    /// Kept results, in the order of [`Campaign::results`](super::Campaign::results).
    pub results: Vec<Cell>,
    /// Wall time of the run \[s\].
    pub wall_time: f64,
}

/// A column of the dataset.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Type of its cells.
    pub kind: ColumnKind,
}

/// Type of the non-empty cells of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColumnKind {
    /// Numbers.
    Number,
    /// Whole numbers.
    Integer,
    /// True or false.
    Bool,
    /// Texts.
    Text,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_survive_the_journal_to_the_bit() {
        for cell in [
            Cell::Null,
            Cell::Number(0.1 + 0.2),
            Cell::Number(-0.0),
            Cell::Number(5e-324),
            Cell::Number(f64::MAX),
            Cell::Number(f64::INFINITY),
            Cell::Integer(i64::MIN),
            Cell::Bool(true),
            Cell::Text("n1 \"x\"\n".to_owned()),
            Cell::Text(String::new()),
        ] {
            let text = serde_json::to_string(&cell).unwrap();
            let again: Cell = serde_json::from_str(&text).unwrap();
            let bits = |cell: &Cell| cell.number().map(f64::to_bits);
            assert_eq!((bits(&again), &again), (bits(&cell), &cell));
        }
        assert!(serde_json::from_str::<Cell>("\"x1\"").is_err());
    }
}
