//! Matrices as text tables.

use nalgebra::DMatrix;
use std::fmt::Write;

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
    let left = rows.iter().map(|r| r.chars().count()).max().unwrap_or(0);
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
    line("", &mut columns.iter().map(|c| (*c).to_owned()));
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
