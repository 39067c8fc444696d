//! Comparison of a published result with a computed one.

use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::experiments::{ChartError, Figure, MapFigure, PlaneFigure, ShapeFigure};

/// One number, published and computed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Quantity and unit.
    pub quantity: String,
    /// Published value; `None` if the source makes a statement without a number.
    pub published: Option<f64>,
    /// Computed value.
    pub computed: f64,
    /// Allowed difference; `None` without a published value.
    pub tolerance: Option<f64>,
    /// Whether the result is reproduced.
    pub passed: bool,
    /// Whether the source prints no number for it, so that quantity and limit are fuyu's own.
    pub own_claim: bool,
}

/// A published result compared with the computed one: table, pictures, verdict.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Name of the reproduction.
    pub name: String,
    /// Whether every row is reproduced.
    pub passed: bool,
    /// The table.
    pub rows: Vec<Row>,
    /// Notes on the table.
    pub notes: Vec<String>,
    /// Content and source.
    #[serde(skip)]
    pub shows: String,
    /// Pictures by the stem of their file names.
    #[serde(skip)]
    pub figures: Vec<(String, Figure)>,
    /// Maps by the stem of their file names.
    #[serde(skip)]
    pub maps: Vec<(String, MapFigure)>,
    /// Curves in a plane by the stem of their file names.
    #[serde(skip)]
    pub planes: Vec<(String, PlaneFigure)>,
    /// Shapes of structures by the stem of their file names.
    #[serde(skip)]
    pub shapes: Vec<(String, ShapeFigure)>,
    /// Preformatted tables of other layouts.
    #[serde(skip)]
    pub listings: Vec<String>,
    /// Published statements that are known not to be reproducible; their rows say so.
    #[serde(skip)]
    pub exceptions: usize,
}

impl Report {
    /// An empty report on `shows`.
    pub fn new(name: &str, shows: &str) -> Self {
        Self {
            name: name.to_owned(),
            passed: true,
            rows: Vec::new(),
            notes: Vec::new(),
            shows: shows.to_owned(),
            figures: Vec::new(),
            maps: Vec::new(),
            planes: Vec::new(),
            shapes: Vec::new(),
            listings: Vec::new(),
            exceptions: 0,
        }
    }

    /// Adds a published number with the allowed difference of the computed one.
    pub(super) fn near(&mut self, quantity: &str, published: f64, computed: f64, tolerance: f64) {
        // This is false for NaN.
        let passed = (computed - published).abs() <= tolerance;
        self.push(quantity, Some(published), computed, Some(tolerance), passed);
    }

    /// Adds a published statement without a number (its words in `quantity`), and the number that confirms it.
    pub(super) fn holds(&mut self, quantity: &str, computed: f64, holds: bool) {
        self.push(
            quantity,
            None,
            computed,
            None,
            holds && computed.is_finite(),
        );
    }

    /// Adds a published statement that is known not to be reproducible, with the number that shows it. `as_known` says
    /// whether the number agrees with the notes.
    pub(super) fn not_reproduced(&mut self, quantity: &str, computed: f64, as_known: bool) {
        self.exceptions += 1;
        self.holds(&format!("{quantity}: NOT REPRODUCED"), computed, as_known);
    }

    fn push(
        &mut self,
        quantity: &str,
        published: Option<f64>,
        computed: f64,
        tolerance: Option<f64>,
        passed: bool,
    ) {
        self.passed &= passed;
        self.rows.push(Row {
            quantity: quantity.to_owned(),
            published,
            computed,
            tolerance,
            passed,
            own_claim: published.is_none(),
        });
    }

    pub(super) fn note(&mut self, text: &str) {
        self.notes.push(text.to_owned());
    }

    /// The table for a terminal, with the verdict.
    pub fn table(&self) -> String {
        let mut out = format!("{}: {}\n\n", self.name, self.shows);
        let cells: Vec<[String; 5]> = std::iter::once(HEADER.map(str::to_owned))
            .chain(self.rows.iter().map(Row::cells))
            .collect();
        let width = |column: usize| {
            let lengths = cells.iter().map(|row| row[column].chars().count());
            lengths.max().unwrap_or(0)
        };
        let widths: [usize; 5] = std::array::from_fn(width);
        for row in &cells {
            let mut line = format!("  {:w$}", row[0], w = widths[0]);
            for (cell, w) in row[1..4].iter().zip(&widths[1..4]) {
                let _ = write!(line, "  {cell:>w$}");
            }
            let _ = writeln!(out, "{line}  {}", row[4]);
        }
        for listing in &self.listings {
            out.push('\n');
            for line in listing.lines() {
                let _ = writeln!(out, "  {line}");
            }
        }
        for note in &self.notes {
            let _ = writeln!(out, "\n  {note}");
        }
        let failed = self.rows.iter().filter(|row| !row.passed).count();
        let verdict = match failed {
            0 if self.exceptions > 0 => "reproduced, except for what is marked".to_owned(),
            0 => "reproduced".to_owned(),
            n => format!("not reproduced: {n} of {} rows differ", self.rows.len()),
        };
        let _ = writeln!(out, "\n  {verdict}; {}", self.claims());
        out
    }

    /// Number of rows that compare with a published number, as text.
    fn claims(&self) -> String {
        let own = self.rows.iter().filter(|row| row.own_claim).count();
        let published = self.rows.len() - own;
        match own {
            0 => format!("{published} published numbers"),
            own => format!("{published} published numbers, {own} claims of our own"),
        }
    }

    /// Writes pictures (SVG and PNG) and the table (`NAME.md`, `NAME.csv`) into an existing folder. Returns the paths.
    ///
    /// # Errors
    /// A line that names the file that cannot be written.
    pub fn save(&self, folder: &Path) -> Result<Vec<PathBuf>, String> {
        let mut paths = Vec::new();
        // A dot in a name does not begin an extension.
        let path = |stem: &str| folder.join(format!("{stem}.svg"));
        let line = |e: ChartError| e.to_string();
        for (stem, figure) in &self.figures {
            paths.extend(figure.save(&path(stem)).map_err(line)?);
        }
        for (stem, map) in &self.maps {
            paths.extend(map.save(&path(stem)).map_err(line)?);
        }
        for (stem, plane) in &self.planes {
            paths.extend(plane.save(&path(stem)).map_err(line)?);
        }
        for (stem, shapes) in &self.shapes {
            paths.extend(shapes.save(&path(stem)).map_err(line)?);
        }
        for (ending, text) in [("csv", self.csv()), ("md", self.markdown())] {
            let path = folder.join(format!("{}.{ending}", self.name));
            std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
            paths.push(path);
        }
        Ok(paths)
    }

    fn csv(&self) -> String {
        let mut out = "quantity,published,computed,tolerance,passed,own_claim\n".to_owned();
        let number = |x: Option<f64>| x.map_or_else(String::new, |x| x.to_string());
        for row in &self.rows {
            let quantity = row.quantity.replace('"', "\"\"");
            let (published, tolerance) = (number(row.published), number(row.tolerance));
            let (computed, passed, own) = (row.computed, row.passed, row.own_claim);
            let _ = writeln!(
                out,
                "\"{quantity}\",{published},{computed},{tolerance},{passed},{own}"
            );
        }
        out
    }

    fn markdown(&self) -> String {
        let mut out = format!("# {}\n\n{}\n\n", self.name, self.shows);
        let _ = writeln!(out, "| {} |", HEADER.join(" | "));
        out.push_str("| --- | ---: | ---: | ---: | --- |\n");
        for row in &self.rows {
            let _ = writeln!(out, "| {} |", row.cells().join(" | "));
        }
        let _ = writeln!(out, "\n{}", self.claims());
        for listing in &self.listings {
            let _ = writeln!(out, "\n```\n{}\n```", listing.trim_end());
        }
        for note in &self.notes {
            let _ = writeln!(out, "\n{note}");
        }
        let figures = self.figures.iter().map(|(stem, f)| (stem, &f.title));
        let maps = self.maps.iter().map(|(stem, m)| (stem, &m.title));
        let planes = self.planes.iter().map(|(stem, p)| (stem, &p.title));
        let shapes = self.shapes.iter().map(|(stem, s)| (stem, &s.title));
        for (stem, title) in figures.chain(maps).chain(planes).chain(shapes) {
            let _ = writeln!(out, "\n![{title}]({stem}.svg)");
        }
        out
    }
}

const HEADER: [&str; 5] = ["quantity", "published", "computed", "tolerance", ""];

impl Row {
    fn cells(&self) -> [String; 5] {
        // One digit more than is significant at the tolerance.
        let decimals = match self.tolerance {
            Some(tolerance) if tolerance > 0.0 => {
                (1.0 - tolerance.log10().floor()).clamp(0.0, 15.0) as usize
            }
            // Counts: no decimals.
            Some(_) => 0,
            None if self.computed == self.computed.round() => 0,
            // Five significant digits.
            None => (4.0 - self.computed.abs().log10().floor()).clamp(3.0, 6.0) as usize,
        };
        let small = match self.tolerance {
            Some(_) => 0.1f64.powi(decimals as i32),
            None => 1e-3,
        };
        let value = |x: f64| match x != 0.0 && x.abs() < small {
            true => format!("{x:.2e}"),
            false => format!("{x:.decimals$}"),
        };
        let tolerance = |t: f64| match t {
            0.0 => "0".to_owned(),
            t if t < 1e-3 => format!("{t:e}"),
            // Hides rounding errors beyond the last digit.
            t => ((t * 1e9).round() / 1e9).to_string(),
        };
        [
            self.quantity.clone(),
            (self.published).map_or_else(|| "own claim".to_owned(), value),
            value(self.computed),
            self.tolerance.map_or_else(String::new, tolerance),
            if self.passed { "ok" } else { "DIFFERS" }.to_owned(),
        ]
    }
}
