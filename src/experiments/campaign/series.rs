//! Time series of a run at a reduced rate.

use std::path::Path;

use serde_json::{Value, json};

use super::{
    file::SeriesFile,
    parameters::near,
    results::{leaves, value},
    row::{Cell, Column, ColumnKind},
    table,
};
use crate::{
    experiments::{
        FinalState, Fleet,
        simulation::{self, Observed},
    },
    nodes::scenario::Scenario,
};

/// Maximum number of values in the series of a run, which limits memory.
const MOST_VALUES: f64 = 1e7;

/// Samples the state of a run.
pub(super) struct SeriesRecorder {
    period: f64,
    columns: Vec<Column>,
    /// Number of samples taken.
    next: u64,
    rows: Vec<Vec<Cell>>,
}

impl SeriesRecorder {
    pub fn new(file: &SeriesFile) -> Self {
        let numbers = file.values.iter().map(|name| Column {
            name: name.clone(),
            kind: ColumnKind::Number,
        });
        let time = Column {
            name: "time".to_owned(),
            kind: ColumnKind::Number,
        };
        Self {
            period: file.period,
            columns: std::iter::once(time).chain(numbers).collect(),
            next: 0,
            rows: Vec::new(),
        }
    }

    /// Takes a sample, if one is due.
    pub fn see(&mut self, fleet: &Fleet, observed: &[Observed]) {
        let time = fleet.time();
        if time < self.next as f64 * self.period - 1e-9 {
            return;
        }
        self.next = ((time + 1e-9) / self.period) as u64 + 1;
        let sample = sample(fleet, observed);
        let cells = self.columns[1..].iter();
        let cells = cells.map(|column| value(&sample, &column.name, column.kind));
        self.rows
            .push(std::iter::once(Cell::Number(time)).chain(cells).collect());
    }

    /// Writes the samples.
    pub fn write(self, path: &Path) -> Result<(), String> {
        table::write(path, &self.columns, &self.rows)
    }
}

/// The values at a state that a series may contain: those of `final`, and the tip errors.
fn sample(fleet: &Fleet, observed: &[Observed]) -> Value {
    let robots = fleet
        .robots()
        .zip(observed)
        .map(|((namespace, closed_loop), observed)| {
            let mut state =
                serde_json::to_value(FinalState::of(&closed_loop.world)).unwrap_or_default();
            let [position, attitude] = observed.performance.tip_errors();
            if let Value::Object(entries) = &mut state {
                entries.insert("tip_position_error".to_owned(), json!(position));
                entries.insert("tip_attitude_error".to_owned(), json!(attitude));
            }
            (namespace.to_owned(), state)
        });
    let mut robots: serde_json::Map<String, Value> = robots.collect();
    match robots.len() {
        1 => robots
            .values_mut()
            .next()
            .map(Value::take)
            .unwrap_or_default(),
        _ => json!({ "robots": robots }),
    }
}

/// Checks that the scenario has the values named in `file`.
///
/// # Errors
/// A line that names the value and lists the known ones.
pub(super) fn check(file: &SeriesFile, scenario: &Scenario) -> Result<(), String> {
    let mut fleet = Fleet::new(scenario)?;
    let mut first = Value::Null;
    let stopped = simulation::simulate(&mut fleet, 0.0, None, |fleet, observed| {
        first = sample(fleet, observed);
        Ok(())
    });
    stopped.map_err(|stop| stop.describe(scenario))?;
    let leaves = leaves(&first);
    let numbers = leaves
        .iter()
        .filter(|(_, kind)| **kind == ColumnKind::Number);
    let names: Vec<&str> = numbers.map(|(name, _)| name.as_str()).collect();
    for name in &file.values {
        if !names.contains(&name.as_str()) {
            let hint = near(name, names.iter().copied()).map_or_else(
                || format!("there are {}", names.join(", ")),
                |near| format!("did you mean {near}?"),
            );
            return Err(format!(
                "keep.series.values: a state has no number {name}; {hint}"
            ));
        }
    }
    let samples = simulation::duration_of(&fleet, None) / file.period;
    match samples * (file.values.len() + 1) as f64 > MOST_VALUES {
        true => Err(format!(
            "keep.series: {samples:.0} samples of {} values per run are more than {MOST_VALUES:e} numbers; give a longer period",
            file.values.len()
        )),
        false => Ok(()),
    }
}
