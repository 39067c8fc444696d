//! Modes in YAML.

use std::fmt::Write;

use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;
use serde_saphyr::Spanned;

use super::{Document, ModeEntry, OutputEntry, PairEntry, ShapeEntry, wrong};
use crate::StructureError;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: String,
    mass: Spanned<f64>,
    first_moment: [f64; 3],
    /// ixx, iyy, izz, ixy, ixz, iyz.
    inertia: [f64; 6],
    modes: Vec<Mode>,
    #[serde(default, rename = "D")]
    products: Vec<Product>,
    #[serde(default)]
    second_order: Vec<Quadratic>,
    #[serde(default)]
    outputs: Vec<Output>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mode {
    name: Spanned<String>,
    frequency_hz: f64,
    damping: f64,
    #[serde(default = "one")]
    modal_mass: f64,
    #[serde(rename = "S")]
    S: [f64; 3],
    #[serde(rename = "N")]
    N: [f64; 9],
}

fn one() -> f64 {
    1.0
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Product {
    modes: Spanned<[String; 2]>,
    value: [f64; 9],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Quadratic {
    modes: Spanned<[String; 2]>,
    #[serde(rename = "S")]
    S: [f64; 3],
    #[serde(rename = "N")]
    N: [f64; 9],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Output {
    name: Spanned<String>,
    position: [f64; 3],
    shapes: Vec<Shape>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Shape {
    mode: Spanned<String>,
    #[serde(default)]
    translation: [f64; 3],
    #[serde(default)]
    rotation: [f64; 3],
}

pub(super) fn read(text: &str, name: &str) -> Result<Document, StructureError> {
    let file: File = serde_saphyr::from_str(text).map_err(|e| {
        let plain = e.without_snippet();
        let message = plain.to_string();
        let first = message.lines().next().unwrap_or_default();
        let brief = first.split(" at line ").next().unwrap_or(first);
        wrong(name, plain.location().map(|l| l.line()), "YAML", brief)
    })?;
    let line = |l: &serde_saphyr::Location| Some(l.line());
    let [xx, yy, zz, xy, xz, yz] = file.inertia;
    let pair = |modes: Spanned<[String; 2]>, first: [f64; 3], second: [f64; 9]| PairEntry {
        line: line(&modes.referenced),
        modes: modes.value,
        first: first.into(),
        second: matrix(&second),
    };
    Ok(Document {
        name: file.name,
        body_line: line(&file.mass.referenced),
        mass: file.mass.value,
        first_moment: file.first_moment.into(),
        inertia: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
        modes: file
            .modes
            .into_iter()
            .map(|m| ModeEntry {
                line: line(&m.name.referenced),
                name: m.name.value,
                frequency_hz: m.frequency_hz,
                damping: m.damping,
                modal_mass: m.modal_mass,
                S: m.S.into(),
                N: matrix(&m.N),
            })
            .collect(),
        products: file
            .products
            .into_iter()
            .map(|p| pair(p.modes, [0.0; 3], p.value))
            .collect(),
        second_order: file
            .second_order
            .into_iter()
            .map(|p| pair(p.modes, p.S, p.N))
            .collect(),
        outputs: file
            .outputs
            .into_iter()
            .map(|o| OutputEntry {
                line: line(&o.name.referenced),
                name: o.name.value,
                position: o.position.into(),
                shapes: o
                    .shapes
                    .into_iter()
                    .map(|s| ShapeEntry {
                        line: line(&s.mode.referenced),
                        mode: s.mode.value,
                        translation: s.translation.into(),
                        rotation: s.rotation.into(),
                    })
                    .collect(),
            })
            .collect(),
    })
}

fn matrix(rows: &[f64; 9]) -> Matrix3<f64> {
    Matrix3::from_row_slice(rows)
}

/// A YAML string in double quotes.
fn quoted(text: &str) -> String {
    let mut result = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => result.extend(['\\', c]),
            c if c.is_control() => result.push_str(&format!("\\u{:04x}", u32::from(c))),
            c => result.push(c),
        }
    }
    result + "\""
}

/// Numbers as the shortest text that reads back to the same bits.
fn list(values: impl Iterator<Item = f64>) -> String {
    format!(
        "[{}]",
        values
            .map(|v| format!("{v:?}"))
            .collect::<Vec<_>>()
            .join(", ")
    )
}

fn vector(v: &Vector3<f64>) -> String {
    list(v.iter().copied())
}

fn rows(m: &Matrix3<f64>) -> String {
    list(m.transpose().iter().copied())
}

pub(super) fn write(document: &Document) -> String {
    let mut text = String::new();
    let I = &document.inertia;
    let inertia = [
        I[(0, 0)],
        I[(1, 1)],
        I[(2, 2)],
        I[(0, 1)],
        I[(0, 2)],
        I[(1, 2)],
    ];
    let mut line = |content: String| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{content}");
    };
    line(format!("name: {}", quoted(&document.name)));
    line(format!("mass: {:?} # kg", document.mass));
    line(format!(
        "first_moment: {} # kg m",
        vector(&document.first_moment)
    ));
    line(format!(
        "inertia: {} # ixx, iyy, izz, ixy, ixz, iyz about the attachment, kg m^2",
        list(inertia.into_iter())
    ));
    line("modes:".to_owned() + if document.modes.is_empty() { " []" } else { "" });
    for mode in &document.modes {
        line(format!("  - name: {}", quoted(&mode.name)));
        line(format!("    frequency_hz: {:?}", mode.frequency_hz));
        line(format!("    damping: {:?}", mode.damping));
        line(format!("    modal_mass: {:?}", mode.modal_mass));
        line(format!("    S: {}", vector(&mode.S)));
        line(format!("    N: {}", rows(&mode.N)));
    }
    if !document.products.is_empty() {
        line("D:".to_owned());
    }
    for entry in &document.products {
        let [a, b] = &entry.modes;
        line(format!(
            "  - {{modes: [{}, {}], value: {}}}",
            quoted(a),
            quoted(b),
            rows(&entry.second)
        ));
    }
    if !document.second_order.is_empty() {
        line("second_order:".to_owned());
    }
    for entry in &document.second_order {
        let [a, b] = &entry.modes;
        let (first, second) = (vector(&entry.first), rows(&entry.second));
        line(format!(
            "  - {{modes: [{}, {}], S: {first}, N: {second}}}",
            quoted(a),
            quoted(b)
        ));
    }
    if !document.outputs.is_empty() {
        line("outputs:".to_owned());
    }
    for output in &document.outputs {
        line(format!("  - name: {}", quoted(&output.name)));
        line(format!("    position: {}", vector(&output.position)));
        line("    shapes:".to_owned() + if output.shapes.is_empty() { " []" } else { "" });
        for shape in &output.shapes {
            let (translation, rotation) = (vector(&shape.translation), vector(&shape.rotation));
            line(format!(
                "      - {{mode: {}, translation: {translation}, rotation: {rotation}}}",
                quoted(&shape.mode)
            ));
        }
    }
    text
}
