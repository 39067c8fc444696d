//! Modes that a finite-element program computed, as text in YAML or CSV.
//!
//! Both formats have the same content: mass properties of the undeformed body, and for each mode frequency, damping ratio, modal
//! mass and mass integrals; optionally products of modes, second-order integrals and output points. Everything is in SI units, in axes of the
//! attachment frame and about its origin.
//!
//! | quantity | unit | meaning |
//! | --- | --- | --- |
//! | `mass`, `first_moment`, `inertia` | kg, kg m, kg m² | of the undeformed body; first moment is `∫ X dm` |
//! | `frequency_hz`, `damping` | Hz, - | with the attachment held |
//! | `modal_mass` | kg for shapes in m | `∫ ψ·ψ dm`; 1 for mass-normalised modes |
//! | `S` | kg m per μ | `∫ ψ dm` |
//! | `N` | kg m² per μ | `∫ X ψᵀ dm`, row by row |
//! | `D` | kg m² per μ² | `∫ ψ_k ψ_lᵀ dm`, row by row; its trace is the modal mass for k = l |
//! | `second_order` | | `∫ χ dm` and `∫ X χᵀ dm` of a pair of modes |
//! | outputs | m, rad per μ | displacement and rotation of a point for each mode |
//!
//! Omitted products are zero, which neglects the second-order change of the moments of inertia by deformation. See
//! `docs/flexible.md` for examples.

mod csv_format;
mod yaml_format;

use nalgebra::{DMatrix, DVector, Matrix3, SymmetricEigen, Vector3};

use crate::{Appendage, Invariants, OutputPoint, StructureError};

/// Reads modes in YAML. `name` is the file's name for error messages.
///
/// # Errors
/// Text that is not YAML, lacks a field or has an unknown one; values that no body can have. Messages name line and field.
pub fn from_yaml(text: &str, name: &str) -> Result<Appendage, StructureError> {
    yaml_format::read(text, name)?.appendage(name)
}

/// Reads modes in CSV. `name` is the file's name for error messages.
///
/// # Errors
/// Wrong columns, a cell that is not a number; values that no body can have. Messages name line and column.
pub fn from_csv(text: &str, name: &str) -> Result<Appendage, StructureError> {
    csv_format::read(text, name)?.appendage(name)
}

/// Writes modes in YAML. [`from_yaml`] reads them to the last bit, except for second-order integrals other than `∫ χ dm` and `∫ X χᵀ dm`,
/// which are left out: their forces are of second order in the amplitude.
///
/// # Errors
/// Modal matrices that are not diagonal; [`Appendage::diagonalised`] makes them so.
pub fn to_yaml(appendage: &Appendage) -> Result<String, StructureError> {
    Ok(yaml_format::write(&Document::new(appendage)?))
}

/// Writes modes in CSV, with the content of [`to_yaml`].
///
/// # Errors
/// As [`to_yaml`].
pub fn to_csv(appendage: &Appendage) -> Result<String, StructureError> {
    Ok(csv_format::write(&Document::new(appendage)?))
}

/// Content of both formats, with line numbers for messages.
#[derive(Clone, Debug, Default)]
struct Document {
    name: String,
    mass: f64,
    first_moment: Vector3<f64>,
    inertia: Matrix3<f64>,
    body_line: Option<u64>,
    modes: Vec<ModeEntry>,
    products: Vec<PairEntry>,
    second_order: Vec<PairEntry>,
    outputs: Vec<OutputEntry>,
}

#[derive(Clone, Debug, Default)]
struct ModeEntry {
    line: Option<u64>,
    name: String,
    frequency_hz: f64,
    damping: f64,
    modal_mass: f64,
    S: Vector3<f64>,
    N: Matrix3<f64>,
}

/// An entry of a pair of modes: D, or the second-order integrals.
#[derive(Clone, Debug, Default)]
struct PairEntry {
    line: Option<u64>,
    modes: [String; 2],
    first: Vector3<f64>,
    second: Matrix3<f64>,
}

#[derive(Clone, Debug, Default)]
struct OutputEntry {
    line: Option<u64>,
    name: String,
    position: Vector3<f64>,
    shapes: Vec<ShapeEntry>,
}

#[derive(Clone, Debug, Default)]
struct ShapeEntry {
    line: Option<u64>,
    mode: String,
    translation: Vector3<f64>,
    rotation: Vector3<f64>,
}

/// A message about one place of a file.
fn wrong(file: &str, line: Option<u64>, field: &str, message: impl Into<String>) -> StructureError {
    StructureError::File {
        name: file.to_owned(),
        line,
        field: field.to_owned(),
        message: message.into(),
    }
}

/// How an appendage is described by name in lists of what exists.
fn listed<'a>(names: impl Iterator<Item = &'a String>) -> String {
    names.map(String::as_str).collect::<Vec<_>>().join(", ")
}

impl Document {
    fn mode(
        &self,
        file: &str,
        line: Option<u64>,
        field: &str,
        mode: &str,
    ) -> Result<usize, StructureError> {
        self.modes
            .iter()
            .position(|m| m.name == mode)
            .ok_or_else(|| {
                let known = listed(self.modes.iter().map(|m| &m.name));
                wrong(
                    file,
                    line,
                    field,
                    format!("there is no mode '{mode}'; the modes are {known}"),
                )
            })
    }

    fn appendage(&self, file: &str) -> Result<Appendage, StructureError> {
        self.check_values(file)?;
        let n = self.modes.len();
        let second_order = !self.second_order.is_empty();
        let mut invariants =
            Invariants::rigid(self.mass, self.first_moment, self.inertia, n, second_order);
        for (k, mode) in self.modes.iter().enumerate() {
            invariants.set_first(1 + k, mode.S);
            invariants.set_second(0, 1 + k, mode.N);
        }
        for entry in &self.products {
            let [k, l] =
                [&entry.modes[0], &entry.modes[1]].map(|m| self.mode(file, entry.line, "D", m));
            invariants.set_second(1 + k?, 1 + l?, entry.second);
        }
        for entry in &self.second_order {
            let [k, l] = [&entry.modes[0], &entry.modes[1]]
                .map(|m| self.mode(file, entry.line, "second_order", m));
            let pair = invariants.pair_function(k?, l?);
            invariants.set_first(pair, entry.first);
            invariants.set_second(0, pair, entry.second);
        }
        let mut outputs = Vec::new();
        for entry in &self.outputs {
            let mut output = OutputPoint {
                name: entry.name.clone(),
                position: entry.position,
                translation: vec![Vector3::zeros(); n],
                rotation: vec![Vector3::zeros(); n],
                chi: Vec::new(),
            };
            for shape in &entry.shapes {
                let k = self.mode(
                    file,
                    shape.line,
                    &format!("output {}", entry.name),
                    &shape.mode,
                )?;
                output.translation[k] = shape.translation;
                output.rotation[k] = shape.rotation;
            }
            outputs.push(output);
        }
        let diagonal = |f: &dyn Fn(&ModeEntry) -> f64| {
            DMatrix::from_diagonal(&DVector::from_iterator(n, self.modes.iter().map(f)))
        };
        let rate = |m: &ModeEntry| m.frequency_hz * std::f64::consts::TAU;
        let appendage = Appendage {
            name: self.name.clone(),
            mode_names: self.modes.iter().map(|m| m.name.clone()).collect(),
            invariants,
            modal_mass: diagonal(&|m| m.modal_mass),
            modal_stiffness: diagonal(&|m| m.modal_mass * rate(m).powi(2)),
            modal_damping: diagonal(&|m| 2.0 * m.damping * m.modal_mass * rate(m)),
            outputs,
        };
        appendage.check()?;
        self.check_mass(&appendage, file)?;
        Ok(appendage)
    }

    fn check_values(&self, file: &str) -> Result<(), StructureError> {
        let number = |line, field: &str, value: f64, right: bool, requirement: &str| {
            if value.is_finite() && right {
                return Ok(());
            }
            Err(wrong(
                file,
                line,
                field,
                format!("is {value}; it must be {requirement}"),
            ))
        };
        number(
            self.body_line,
            "mass",
            self.mass,
            self.mass > 0.0,
            "positive [kg]",
        )?;
        number(
            self.body_line,
            "first_moment",
            self.first_moment.sum(),
            true,
            "numbers [kg m]",
        )?;
        number(
            self.body_line,
            "inertia",
            self.inertia.sum(),
            true,
            "numbers [kg m²]",
        )?;
        let moments = SymmetricEigen::new(self.inertia).eigenvalues;
        let (sum, largest, least) = (moments.sum(), moments.max(), moments.min());
        if !sum.is_finite() || least < 0.0 || 2.0 * largest > sum * (1.0 + 1e-9) {
            let message = format!(
                "has principal moments {:.6}, {:.6}, {:.6}; none may be negative or larger than the sum of the others",
                moments[0], moments[1], moments[2]
            );
            return Err(wrong(file, self.body_line, "inertia", message));
        }
        for (k, mode) in self.modes.iter().enumerate() {
            let field = |f: &str| format!("mode {}, {f}", mode.name);
            number(
                mode.line,
                &field("frequency_hz"),
                mode.frequency_hz,
                mode.frequency_hz > 0.0,
                "positive [Hz]",
            )?;
            number(
                mode.line,
                &field("damping"),
                mode.damping,
                mode.damping >= 0.0,
                "a ratio, zero or positive",
            )?;
            number(
                mode.line,
                &field("modal_mass"),
                mode.modal_mass,
                mode.modal_mass > 0.0,
                "positive",
            )?;
            number(mode.line, &field("S"), mode.S.sum(), true, "numbers")?;
            number(mode.line, &field("N"), mode.N.sum(), true, "numbers")?;
            if self.modes[..k].iter().any(|m| m.name == mode.name) {
                return Err(wrong(
                    file,
                    mode.line,
                    "name",
                    format!(
                        "'{}' names two modes; each needs a name that differs from the others",
                        mode.name
                    ),
                ));
            }
        }
        for (i, output) in self.outputs.iter().enumerate() {
            let field = format!("output {}", output.name);
            let shapes: f64 = output
                .shapes
                .iter()
                .map(|s| s.translation.sum() + s.rotation.sum())
                .sum();
            number(
                output.line,
                &field,
                output.position.sum() + shapes,
                true,
                "numbers",
            )?;
            if self.outputs[..i].iter().any(|o| o.name == output.name) {
                return Err(wrong(
                    file,
                    output.line,
                    &field,
                    "names two output points; each needs another name",
                ));
            }
        }
        for entry in &self.products {
            let [a, b] = &entry.modes;
            let field = format!("D of modes {a} and {b}");
            let trace = entry.second.trace();
            number(entry.line, &field, trace, true, "numbers")?;
            let mass = self.modes[self.mode(file, entry.line, &field, a)?].modal_mass;
            if a == b && trace > mass * (1.0 + 1e-6) {
                let message =
                    format!("has trace {trace}; it must not exceed the mode's modal_mass {mass}");
                return Err(wrong(file, entry.line, &field, message));
            }
        }
        Ok(())
    }

    /// The modes cannot move more mass than the body has. The usual causes are units of mm or t, or another reference point.
    fn check_mass(&self, appendage: &Appendage, file: &str) -> Result<(), StructureError> {
        let P = appendage.coupling();
        let weighted = DMatrix::from_fn(P.nrows(), 6, |k, j| {
            P[(k, j)] / appendage.modal_mass[(k, k)]
        });
        let rigid = appendage.rigid_mass_matrix();
        let rest = rigid - P.transpose() * weighted;
        for (i, axis) in [
            "translation x",
            "translation y",
            "translation z",
            "rotation x",
            "rotation y",
            "rotation z",
        ]
        .iter()
        .enumerate()
        {
            let total = rigid[(i, i)];
            if rest[(i, i)] < -1e-6 * total {
                let message = format!(
                    "the modes move {:.6} in {axis} where the body has {total:.6}; check units, reference point and modal_mass",
                    total - rest[(i, i)]
                );
                return Err(wrong(file, self.body_line, "S and N", message));
            }
        }
        Ok(())
    }

    fn new(appendage: &Appendage) -> Result<Self, StructureError> {
        let n = appendage.modes();
        let matrices = [
            &appendage.modal_mass,
            &appendage.modal_stiffness,
            &appendage.modal_damping,
        ];
        for (matrix, name) in
            matrices
                .into_iter()
                .zip(["modal mass", "modal stiffness", "modal damping"])
        {
            let off = matrix - DMatrix::from_diagonal(&matrix.diagonal());
            if n > 0 && off.amax() > 1e-13 * matrix.amax() {
                return Err(StructureError::Matrix {
                    matrix: format!("{}, {name}", appendage.name),
                    property: "diagonal",
                    remedy: "a modes file has one frequency, mass and damping ratio a mode; diagonalise first",
                });
            }
        }
        let invariants = &appendage.invariants;
        let names = &appendage.mode_names;
        let rates: Vec<f64> = (0..n)
            .map(|k| (appendage.modal_stiffness[(k, k)] / appendage.modal_mass[(k, k)]).sqrt())
            .collect();
        let mode = |k: usize| ModeEntry {
            line: None,
            name: names[k].clone(),
            frequency_hz: rates[k] / std::f64::consts::TAU,
            damping: appendage.modal_damping[(k, k)]
                / (2.0 * appendage.modal_mass[(k, k)] * rates[k]),
            modal_mass: appendage.modal_mass[(k, k)],
            S: invariants.first(1 + k),
            N: invariants.second(0, 1 + k),
        };
        let entry = |k: usize, l: usize, first, second| PairEntry {
            line: None,
            modes: [names[k].clone(), names[l].clone()],
            first,
            second,
        };
        let all = || crate::appendage::pairs(n);
        let products =
            all().map(|(k, l)| entry(k, l, Vector3::zeros(), invariants.second(1 + k, 1 + l)));
        let quadratic = all().filter(|_| invariants.second_order()).map(|(k, l)| {
            let pair = invariants.pair_function(k, l);
            entry(k, l, invariants.first(pair), invariants.second(0, pair))
        });
        let nonzero = |e: &PairEntry| e.first.amax() > 0.0 || e.second.amax() > 0.0;
        let output = |o: &OutputPoint| OutputEntry {
            line: None,
            name: o.name.clone(),
            position: o.position,
            shapes: (0..n)
                .map(|k| ShapeEntry {
                    line: None,
                    mode: names[k].clone(),
                    translation: o.translation[k],
                    rotation: o.rotation[k],
                })
                .collect(),
        };
        Ok(Self {
            name: appendage.name.clone(),
            mass: invariants.mass(),
            first_moment: invariants.first(0),
            inertia: invariants.inertia(),
            body_line: None,
            modes: (0..n).map(mode).collect(),
            products: products.filter(nonzero).collect(),
            second_order: quadratic.filter(nonzero).collect(),
            outputs: appendage.outputs.iter().map(output).collect(),
        })
    }
}
