//! Figs. 2.2 to 2.4: modes of the plane truss, free and with inputs held.

use fuyu_structures::kida1993::{Printed, TRUSS_INPUTS_3, TRUSS_INPUTS_4, table, truss};
use fuyu_structures::{Matrices, Truss};

use super::{Outcome, completed};
use crate::experiments::reproduce::Report;
use crate::experiments::{ShapeFigure, ShapePanel};

const LOST: &str = "The figure is lost; dimensions recovered from the printed frequencies. Arrows: where and in which \
    direction forces act and displacements are measured.";

pub(super) fn fig_2_2(report: Report) -> Report {
    completed(report, |report| {
        let (truss, matrices) = model()?;
        let modes = matrices.modes(&[], 12)?;
        let hz = modes.frequencies.map(|w| w / std::f64::consts::TAU);
        report.near("number of poles", 24.0, 2.0 * hz.len() as f64, 0.0);
        let rigid = hz.iter().filter(|f| **f == 0.0).count();
        report.near("rigid-body modes", 3.0, rigid as f64, 0.0);
        // The shapes are eigenvectors: K φ = ω² M φ, and mass-normalised.
        let stiff = &matrices.K * &modes.shapes;
        let mut inertial = &matrices.M * &modes.shapes;
        for (mut column, w) in inertial.column_iter_mut().zip(modes.frequencies.iter()) {
            column *= w * w;
        }
        let residual = (&stiff - inertial).amax() / stiff.amax();
        report.holds(
            "K phi - w^2 M phi, relative, below 1e-12",
            residual,
            residual < 1e-12,
        );
        report.note("The frequencies in the figure are not legible in the scan; those of the held truss are Tables 2.1 \
                     to 2.4.");
        report.note(LOST);
        let all: Vec<usize> = (0..12).collect();
        let figure = shapes(
            "Kida 1993 Fig. 2.2: modes of the free truss, three inputs",
            &truss,
            &TRUSS_INPUTS_3,
            all.iter()
                .map(|k| (hz[*k], modes.shapes.column(*k).into_owned())),
        );
        report.shapes.push(("kida-fig-2.2".to_owned(), figure));
        Ok(())
    })
}

pub(super) fn fig_2_3(report: Report) -> Report {
    held(report, 1, &TRUSS_INPUTS_3, "three")
}

pub(super) fn fig_2_4(report: Report) -> Report {
    held(report, 4, &TRUSS_INPUTS_4, "four")
}

fn model() -> Result<(Truss, Matrices), fuyu_structures::StructureError> {
    let truss = truss();
    let matrices = truss.matrices()?;
    Ok((truss, matrices))
}

/// Modes with the inputs held; their frequencies are the zeros (theorem 2.1), printed in the first column of a table.
fn held(report: Report, number: usize, inputs: &[usize], words: &str) -> Report {
    completed(report, |report| {
        let (truss, matrices) = model()?;
        let count = 12 - inputs.len();
        let modes = matrices.modes(inputs, count)?;
        let hz = modes.frequencies.map(|w| w / std::f64::consts::TAU);
        report.near(
            "number of zeros",
            2.0 * count as f64,
            2.0 * hz.len() as f64,
            0.0,
        );
        let table = table(number)?;
        let printed = table.columns[0]
            .printed
            .iter()
            .filter_map(|p: &Printed| p.value());
        for (k, (printed, f)) in printed.zip(hz.iter()).enumerate() {
            report.near(&format!("mode {} [Hz]", k + 1), printed, *f, 0.056);
        }
        report.note(LOST);
        let name = report.name.clone();
        let figure = shapes(
            &format!(
                "Kida 1993 Fig. 2.{}: modes with {words} inputs held, the zeros",
                if number == 1 { 3 } else { 4 }
            ),
            &truss,
            inputs,
            (0..count).map(|k| (hz[k], modes.shapes.column(k).into_owned())),
        );
        report.shapes.push((name, figure));
        Ok(()) as Outcome
    })
}

/// One drawing of the truss for each mode: frequency \[Hz\] and displacements.
fn shapes(
    title: &str,
    truss: &Truss,
    inputs: &[usize],
    modes: impl Iterator<Item = (f64, nalgebra::DVector<f64>)>,
) -> ShapeFigure {
    /// Largest displacement in a drawing \[m\].
    const LARGEST: f64 = 4.0;
    let lines = |points: &[(f64, f64)]| -> Vec<Vec<(f64, f64)>> {
        let ends = truss.rods.iter().map(|rod| rod.nodes);
        ends.map(|[i, j]| vec![points[i], points[j]]).collect()
    };
    let at_rest: Vec<(f64, f64)> = truss.nodes.iter().map(|p| (p.x, p.y)).collect();
    let panel = |(hz, shape): (f64, nalgebra::DVector<f64>)| {
        let factor = LARGEST / shape.amax();
        let moved = |(i, p): (usize, &(f64, f64))| {
            (p.0 + factor * shape[2 * i], p.1 + factor * shape[2 * i + 1])
        };
        let nodes: Vec<_> = at_rest.iter().enumerate().map(moved).collect();
        let arrows = inputs.iter().map(|dof| {
            let along = if dof % 2 == 0 { (1.0, 0.0) } else { (0.0, 1.0) };
            [at_rest[dof / 2], along]
        });
        ShapePanel {
            title: format!("{hz:.1} Hz"),
            reference: lines(&at_rest),
            shape: lines(&nodes),
            nodes,
            arrows: arrows.collect(),
        }
    };
    ShapeFigure {
        title: title.to_owned(),
        columns: 4,
        panels: modes.map(panel).collect(),
    }
}
