//! Modes in CSV: each line is a record of some kind, and all kinds have the same columns.

use nalgebra::{Matrix3, Vector3};

use super::{Document, ModeEntry, OutputEntry, PairEntry, ShapeEntry, listed, wrong};
use crate::StructureError;

const COLUMNS: [&str; 21] = [
    "record",
    "name",
    "with",
    "frequency_hz",
    "damping",
    "mass",
    "x",
    "y",
    "z",
    "rx",
    "ry",
    "rz",
    "xx",
    "xy",
    "xz",
    "yx",
    "yy",
    "yz",
    "zx",
    "zy",
    "zz",
];

/// Which columns each record uses; its other cells must be empty.
const RECORDS: [(&str, &[&str]); 6] = [
    ("body", &["name", "mass", "xyz", "matrix"]),
    (
        "mode",
        &["name", "frequency_hz", "damping", "mass", "xyz", "matrix"],
    ),
    ("D", &["name", "with", "matrix"]),
    ("second_order", &["name", "with", "xyz", "matrix"]),
    ("output", &["name", "xyz"]),
    ("shape", &["name", "with", "xyz", "rotation"]),
];

/// The group of columns that a column belongs to.
fn group(column: &str) -> &str {
    match column {
        "x" | "y" | "z" => "xyz",
        "rx" | "ry" | "rz" => "rotation",
        "xx" | "xy" | "xz" | "yx" | "yy" | "yz" | "zx" | "zy" | "zz" => "matrix",
        other => other,
    }
}

/// One line of the file.
struct Line<'a> {
    file: &'a str,
    number: Option<u64>,
    cells: Vec<String>,
}

impl Line<'_> {
    fn error(&self, field: &str, message: String) -> StructureError {
        wrong(self.file, self.number, field, message)
    }

    fn text(&self, column: &str) -> Result<String, StructureError> {
        let cell = self.cell(column);
        if cell.is_empty() {
            return Err(self.error(
                column,
                format!("is empty; a record '{}' needs it", self.cells[0]),
            ));
        }
        Ok(cell.to_owned())
    }

    fn cell(&self, column: &str) -> &str {
        let place = COLUMNS.iter().position(|c| *c == column);
        place.map_or("", |i| self.cells[i].as_str())
    }

    fn number(&self, column: &str) -> Result<f64, StructureError> {
        let cell = self.cell(column);
        let value: Option<f64> = cell.parse().ok().filter(|v: &f64| v.is_finite());
        value.ok_or_else(|| self.error(column, format!("is '{cell}'; it must be a number")))
    }

    fn vector(&self, columns: [&str; 3]) -> Result<Vector3<f64>, StructureError> {
        let [x, y, z] = columns.map(|c| self.number(c));
        Ok(Vector3::new(x?, y?, z?))
    }

    fn xyz(&self) -> Result<Vector3<f64>, StructureError> {
        self.vector(["x", "y", "z"])
    }

    fn matrix(&self) -> Result<Matrix3<f64>, StructureError> {
        let mut matrix = Matrix3::zeros();
        for (i, column) in COLUMNS[12..].iter().enumerate() {
            matrix[(i / 3, i % 3)] = self.number(column)?;
        }
        Ok(matrix)
    }

    /// Rejects an unknown record and cells that the record does not use.
    fn check(&self) -> Result<(), StructureError> {
        let kind = &self.cells[0];
        let Some((_, used)) = RECORDS.iter().find(|(name, _)| name == kind) else {
            let known: Vec<String> = RECORDS.iter().map(|r| r.0.to_owned()).collect();
            return Err(self.error(
                "record",
                format!("is '{kind}'; it must be one of {}", listed(known.iter())),
            ));
        };
        for (column, cell) in COLUMNS.iter().zip(&self.cells).skip(1) {
            if !cell.is_empty() && !used.contains(&group(column)) {
                return Err(self.error(
                    column,
                    format!("is '{cell}'; it must be empty in a record '{kind}'"),
                ));
            }
        }
        Ok(())
    }

    fn pair(&self, first: Vector3<f64>) -> Result<PairEntry, StructureError> {
        Ok(PairEntry {
            line: self.number,
            modes: [self.text("name")?, self.text("with")?],
            first,
            second: self.matrix()?,
        })
    }
}

pub(super) fn read(text: &str, file: &str) -> Result<Document, StructureError> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .flexible(true)
        .from_reader(text.as_bytes());
    let unreadable = |e: csv::Error| {
        wrong(
            file,
            e.position().map(csv::Position::line),
            "CSV",
            e.to_string(),
        )
    };
    let header = reader.headers().map_err(unreadable)?.clone();
    if !header.iter().eq(COLUMNS) {
        let found = header.iter().collect::<Vec<_>>().join(",");
        return Err(wrong(
            file,
            Some(1),
            "columns",
            format!("are '{found}'; they must be '{}'", COLUMNS.join(",")),
        ));
    }
    let mut document = Document::default();
    for record in reader.records() {
        let record = record.map_err(unreadable)?;
        let line = Line {
            file,
            number: record.position().map(csv::Position::line),
            cells: record.iter().map(str::to_owned).collect(),
        };
        if line.cells.len() != COLUMNS.len() {
            let message = format!(
                "there are {} of them; there must be {}",
                line.cells.len(),
                COLUMNS.len()
            );
            return Err(line.error("cells", message));
        }
        line.check()?;
        add(&mut document, &line)?;
    }
    if document.body_line.is_none() {
        return Err(wrong(
            file,
            None,
            "record",
            "there is no record 'body' with name, mass, first moment and inertia",
        ));
    }
    Ok(document)
}

fn add(document: &mut Document, line: &Line) -> Result<(), StructureError> {
    match line.cells[0].as_str() {
        "body" => {
            if document.body_line.is_some() {
                return Err(line.error(
                    "record",
                    "there are two records 'body'; there must be one".to_owned(),
                ));
            }
            document.name = line.text("name")?;
            document.mass = line.number("mass")?;
            document.first_moment = line.xyz()?;
            document.inertia = line.matrix()?;
            let difference = document.inertia - document.inertia.transpose();
            if difference.amax() > 1e-9 * document.inertia.amax() {
                return Err(line.error(
                    "xx to zz",
                    "are not symmetric; they must be the moments of inertia".to_owned(),
                ));
            }
            document.body_line = line.number;
        }
        "mode" => document.modes.push(ModeEntry {
            line: line.number,
            name: line.text("name")?,
            frequency_hz: line.number("frequency_hz")?,
            damping: line.number("damping")?,
            modal_mass: line.number("mass")?,
            S: line.xyz()?,
            N: line.matrix()?,
        }),
        "D" => document.products.push(line.pair(Vector3::zeros())?),
        "second_order" => document.second_order.push(line.pair(line.xyz()?)?),
        "output" => document.outputs.push(OutputEntry {
            line: line.number,
            name: line.text("name")?,
            position: line.xyz()?,
            shapes: Vec::new(),
        }),
        _ => {
            let point = line.text("with")?;
            let known = listed(document.outputs.iter().map(|o| &o.name));
            let Some(output) = document.outputs.iter_mut().find(|o| o.name == point) else {
                return Err(line.error(
                    "with",
                    format!("there is no output point '{point}' above; there are {known}"),
                ));
            };
            output.shapes.push(ShapeEntry {
                line: line.number,
                mode: line.text("name")?,
                translation: line.xyz()?,
                rotation: line.vector(["rx", "ry", "rz"])?,
            });
        }
    }
    Ok(())
}

pub(super) fn write(document: &Document) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut row = |kind: &str,
                   name: &str,
                   with: &str,
                   numbers: [Option<f64>; 3],
                   groups: [Option<Vec<f64>>; 3]| {
        let mut cells = vec![kind.to_owned(), name.to_owned(), with.to_owned()];
        cells.extend(numbers.map(|n| n.map_or(String::new(), |v| format!("{v:?}"))));
        for (group, size) in groups.into_iter().zip([3, 3, 9]) {
            match group {
                Some(values) => cells.extend(values.iter().map(|v| format!("{v:?}"))),
                None => cells.extend(std::iter::repeat_n(String::new(), size)),
            }
        }
        // Writing to memory cannot fail, and all rows have the same length.
        let _ = writer.write_record(&cells);
    };
    let vector = |v: &Vector3<f64>| Some(v.iter().copied().collect::<Vec<_>>());
    let matrix = |m: &Matrix3<f64>| Some(m.transpose().iter().copied().collect::<Vec<_>>());
    let mass = [None, None, Some(document.mass)];
    row(
        "body",
        &document.name,
        "",
        mass,
        [
            vector(&document.first_moment),
            None,
            matrix(&document.inertia),
        ],
    );
    for m in &document.modes {
        let numbers = [Some(m.frequency_hz), Some(m.damping), Some(m.modal_mass)];
        row(
            "mode",
            &m.name,
            "",
            numbers,
            [vector(&m.S), None, matrix(&m.N)],
        );
    }
    for (kind, entries) in [
        ("D", &document.products),
        ("second_order", &document.second_order),
    ] {
        for e in entries {
            let first = if kind == "D" { None } else { vector(&e.first) };
            row(
                kind,
                &e.modes[0],
                &e.modes[1],
                [None; 3],
                [first, None, matrix(&e.second)],
            );
        }
    }
    for output in &document.outputs {
        row(
            "output",
            &output.name,
            "",
            [None; 3],
            [vector(&output.position), None, None],
        );
        for s in &output.shapes {
            row(
                "shape",
                &s.mode,
                &output.name,
                [None; 3],
                [vector(&s.translation), vector(&s.rotation), None],
            );
        }
    }
    let bytes = writer.into_inner().unwrap_or_default();
    format!("{}\n{}", COLUMNS.join(","), String::from_utf8_lossy(&bytes))
}
