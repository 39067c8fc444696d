//! Tables 2.1 to 2.12 (transmission zeros and poles of the truss and of ETS-VI).

use fuyu_structures::kida1993::{Column, Printed, Table, Verdict, ets6, table};
use std::fmt::Write;

use super::diagrams::{marks, pole_map};
use super::{Outcome, completed, number};
use crate::experiments::Mark;
use crate::experiments::reproduce::Report;

/// Largest difference of a computed value from a value printed with three decimals.
const PRINTED: f64 = 5e-4;

/// One of the tables, chosen by its number in the report's name.
pub(super) fn chapter_2(report: Report) -> Report {
    completed(report, |report| {
        let number: usize = number(report).trim_start_matches("2.").parse()?;
        let table = table(number)?;
        match &table.verdict {
            Verdict::Input => input(report, &table)?,
            Verdict::Reproduced { first, second } => {
                for (column, tolerance) in table.columns.iter().zip([first, second]) {
                    rows(report, &table, column, *tolerance);
                }
            }
            Verdict::NotReproducible(reason) => {
                rows(report, &table, &table.columns[0], 1e-9);
                not_reproduced(report, &table.columns[1]);
                report.note(reason);
            }
        }
        if !matches!(table.verdict, Verdict::Input) {
            report.listings.push(listing(&table));
        }
        report.note(table.remark);
        if number <= 4 {
            report.note(
                "The truss's figure is lost: its dimensions were recovered from the 17 frequencies printed for the FEM \
                 model. The book's modal data are not its FEM model's (in Tables 2.1 and 2.4 exact theory makes both \
                 columns equal), which the second column's tolerance allows for.",
            );
        } else if number > 5 {
            report.note(
                "The couplings of the panels are not printed; they were identified from the poles of Table 2.6. All \
                 values are imaginary parts: nothing is damped.",
            );
        }
        if number == 7 {
            map(report)?;
        }
        Ok(())
    })
}

/// Name of row `i` in a table.
fn row_name(table: &Table, i: usize) -> String {
    match table.rows.get(i) {
        Some(&name) if name != "-" => name.to_owned(),
        Some(_) => format!("row {}, a mode that moves nothing", i + 1),
        None => format!("row {}", i + 1),
    }
}

fn rows(report: &mut Report, table: &Table, column: &Column, tolerance: f64) {
    // Printed values have few decimals; agreement beyond them is not claimed.
    let tolerance = tolerance.max(if tolerance < 1e-3 { PRINTED } else { 0.0 });
    for (i, (printed, computed)) in column.printed.iter().zip(&column.computed).enumerate() {
        if let (Printed::Value(printed), Some(computed)) = (printed, computed) {
            let quantity = match table.columns.len() {
                1 => format!("{} [Hz]", row_name(table, i)),
                _ => format!("{}, {} [Hz]", column.heading, row_name(table, i)),
            };
            report.near(&quantity, *printed, *computed, tolerance);
        }
    }
}

/// A column known to be misprinted: number of wrong values, and their largest error.
fn not_reproduced(report: &mut Report, column: &Column) {
    let pairs = column.printed.iter().zip(&column.computed);
    let differences = pairs.filter_map(|(p, c)| Some((p.value()? - (*c)?).abs()));
    let differences: Vec<f64> = differences.collect();
    let wrong = differences.iter().filter(|d| **d > PRINTED).count();
    let largest = differences.iter().copied().fold(0.0, f64::max);
    report.not_reproduced(
        &format!(
            "{}: printed values that are not the exact zeros",
            column.heading
        ),
        wrong as f64,
        wrong > 0,
    );
    report.holds(
        "their largest distance from the exact zeros [Hz], below 0.021",
        largest,
        largest < 0.021,
    );
}

/// Table 2.5 is input data: the only check is that the model has these frequencies when the satellite is held.
fn input(report: &mut Report, table: &Table) -> Outcome {
    let satellite = ets6()?;
    let model = satellite.model(std::f64::consts::PI, &[0, 1, 2, 3, 4, 5, 6])?;
    let held = fuyu_structures::frequencies_hz(&model.held(&[0, 1, 2, 3, 4, 5])?.poles()?);
    let printed = table.columns[0].printed.iter().filter_map(|p| p.value());
    for (i, printed) in printed.enumerate() {
        let pair = [held[2 * i], held[2 * i + 1]];
        let quantity = format!("{} [Hz]", row_name(table, i));
        let far = pair
            .into_iter()
            .max_by(|a, b| (a - printed).abs().total_cmp(&(b - printed).abs()));
        report.near(&quantity, printed, far.unwrap_or(f64::NAN), 1e-9);
    }
    report.note("Computed: both panels with the satellite held; the one of the pair that is farther from the print.");
    Ok(())
}

/// Printed and computed values as in the book; computed values that differ are marked with a cross.
fn listing(table: &Table) -> String {
    let decimals = if table.number.as_str() < "2.5" && table.number.len() == 3 {
        1
    } else {
        3
    };
    let mut out = String::new();
    for (i, column) in table.columns.iter().enumerate() {
        let _ = writeln!(out, "({}) {}", i + 1, column.heading);
    }
    for row in 0..table.columns[0].printed.len() {
        let _ = write!(out, "\n{:>4}", row + 1);
        for column in &table.columns {
            let printed = match column.printed[row] {
                Printed::Value(v) => format!("{v:.*}", decimals.max(if v < 0.05 { 4 } else { 0 })),
                Printed::Blank => "-".to_owned(),
                Printed::Infinite => "infinite".to_owned(),
            };
            let _ = write!(out, "  | {printed:>8}");
            if column.computed.iter().any(Option::is_some) {
                let value = column.computed[row];
                let text = value.map_or_else(|| "-".to_owned(), |v| format!("{v:.decimals$}"));
                let limit = 0.5 * 0.1f64.powi(decimals as i32);
                let pair = column.printed[row].value().zip(value);
                let differs = pair.is_some_and(|(p, v)| (p - v).abs() > limit * (1.0 + 1e-6));
                let _ = write!(out, " {text:>8} {}", if differs { 'x' } else { ' ' });
            }
        }
    }
    let _ = writeln!(
        out,
        "\n\nHz; printed, computed, x: they differ in the last printed digit or before"
    );
    out
}

/// Poles and zeros of ETS-VI on the imaginary axis.
fn map(report: &mut Report) -> Outcome {
    let satellite = ets6()?;
    let model = satellite.model(std::f64::consts::PI, &[0, 1, 2, 3, 4, 5, 6])?;
    // Nothing is damped, so all would lie on one line; therefore each family has its own column.
    let hz = |roots: &[fuyu_lti::Complex], x: f64| -> Vec<(f64, f64)> {
        let upper = roots.iter().filter(|s| s.im >= 0.0);
        upper.map(|s| (x, s.im / std::f64::consts::TAU)).collect()
    };
    let (mut poles, mut zeros) = (Vec::new(), Vec::new());
    for (i, coordinate) in [0, 2, 3, 4, 5].into_iter().enumerate() {
        let others: Vec<usize> = (0..6).filter(|k| *k != coordinate).collect();
        let family = satellite
            .families
            .iter()
            .find(|f| f.coordinate == coordinate);
        let Some(family) = family else { continue };
        let one = satellite
            .model(std::f64::consts::PI, &family.modes)?
            .held(&others)?;
        let moved = one.poles()?;
        let at = i as f64 + 1.0;
        let held = hz(&model.zeros()?, at);
        let own: Vec<f64> = family.poles.clone();
        poles.extend(
            hz(&moved, at)
                .into_iter()
                .filter(|p| own.iter().any(|f| (f - p.1).abs() < 1e-3)),
        );
        zeros.extend(held.into_iter().filter(|z| {
            hz(&one.zeros().unwrap_or_default(), at)
                .iter()
                .any(|own| (own.1 - z.1).abs() < 1e-9)
        }));
    }
    let mut figure = pole_map(
        "Kida 1993 Tables 2.6, 2.7: poles and zeros of ETS-VI by direction of motion",
        vec![
            marks("poles", Mark::Cross, poles),
            marks("zeros", Mark::Ring, zeros),
        ],
        Some([(0.5, 5.5), (0.0, 3.0)]),
    );
    figure.series.clear();
    figure.x_label = "1, 2: translation x, z; 3, 4, 5: rotation x, y, z".to_owned();
    figure.y_label = "frequency [Hz]".to_owned();
    report.planes.push(("kida-table-2.7".to_owned(), figure));
    Ok(())
}
