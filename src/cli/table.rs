//! Text tables.

use nalgebra::DMatrix;
use std::fmt::Write;

/// Longest name in a table \[characters\].
const LONGEST: usize = 100;

/// A name from a file for display in a table: on one line, without control characters, cut if very long.
pub(super) fn shown(name: &str) -> String {
    let plain = |c: char| if c.is_control() { '\u{fffd}' } else { c };
    let mut text: String = name.chars().take(LONGEST).map(plain).collect();
    if name.chars().nth(LONGEST).is_some() {
        text.push_str("...");
    }
    text
}

/// Width of a column with these cells.
pub(super) fn width<'a>(cells: impl Iterator<Item = &'a str>) -> usize {
    cells.map(|c| c.chars().count()).max().unwrap_or(0)
}

/// Appends `matrix` with its row and column names. Entries at the level of rounding print as 0.
pub(super) fn matrix(out: &mut String, rows: &[&str], columns: &[&str], matrix: &DMatrix<f64>) {
    let rounding = 1e-14 * matrix.amax();
    let cell = |x: f64| {
        if x.abs() <= rounding {
            "0".to_owned()
        } else {
            number(x)
        }
    };
    let [rows, columns] = [rows, columns]
        .map(|names| -> Vec<String> { names.iter().map(|name| shown(name)).collect() });
    let left = width(rows.iter().map(String::as_str));
    let widths: Vec<usize> = (0..matrix.ncols())
        .map(|j| {
            let cells = matrix.column(j).iter().map(|&x| cell(x).len()).max();
            cells.unwrap_or(0).max(columns[j].chars().count())
        })
        .collect();
    let mut line = |name: &str, cells: &mut dyn Iterator<Item = String>| {
        let mut text = format!("  {name:left$}");
        for (cell, width) in cells.zip(&widths) {
            let _ = write!(text, "  {cell:>width$}");
        }
        out.push_str(text.trim_end());
        out.push('\n');
    };
    line("", &mut columns.iter().cloned());
    for (name, row) in rows.iter().zip(matrix.row_iter()) {
        line(name, &mut row.iter().map(|&x| cell(x)));
    }
}

/// Six significant digits, in scientific notation only if necessary.
pub(super) fn number(x: f64) -> String {
    let magnitude = x.abs();
    if (1e-4..1e6).contains(&magnitude) {
        let digits = (5 - magnitude.log10().floor() as i32).clamp(0, 9) as usize;
        let text = format!("{x:.digits$}");
        match text.contains('.') {
            true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
            false => text,
        }
    } else if x == 0.0 {
        "0".to_owned()
    } else {
        format!("{x:.5e}")
    }
}
