//! The plane truss of section 2.2.3, figure 2.1.

use nalgebra::{DMatrix, Vector2};

use super::{BLANK, Column, INFINITE, QZ, Table, Verdict, column, printed_only};
use crate::{FemModel, Rod, StructureError, Truss, frequencies_hz};

/// Width of a bay \[m\]. The figure is lost: width and wave speed were recovered from the 17 printed frequencies, of which only their
/// quotient matters.
const BAY: f64 = 15.0;

/// Height over width of a bay, recovered; it rounds to 2/3.
const HEIGHT_OVER_BAY: f64 = 0.666_439_408_476_805_2;

/// `√(E/ρ) / (2π bay)` \[Hz\], recovered; it rounds to a wave speed of 4997 m/s for a bay of 15 m.
const SCALE: f64 = 53.012_051_664_882_655;

/// Degrees of freedom (2 node + 0 for x, 1 for y) of the three inputs of figure 2.1(a), recovered.
pub const TRUSS_INPUTS_3: [usize; 3] = [1, 4, 11];

/// Those of the four inputs of figure 2.1(b).
pub const TRUSS_INPUTS_4: [usize; 4] = [1, 4, 6, 11];

/// The truss: six nodes, 0 to 2 below and 3 to 5 above, nine rods with parallel diagonals, density and cross section 1.
pub fn truss() -> Truss {
    let node = |i: usize| {
        Vector2::new(
            (i % 3) as f64 * BAY,
            if i < 3 { 0.0 } else { BAY * HEIGHT_OVER_BAY },
        )
    };
    let wave_speed = SCALE * std::f64::consts::TAU * BAY;
    let rods = [
        [0, 1],
        [1, 2],
        [3, 4],
        [4, 5],
        [0, 3],
        [1, 4],
        [2, 5],
        [0, 4],
        [1, 5],
    ];
    Truss {
        nodes: (0..6).map(node).collect(),
        rods: rods
            .map(|nodes| Rod {
                nodes,
                EA: wave_speed * wave_speed,
                mass_per_length: 1.0,
            })
            .to_vec(),
    }
}

pub(super) fn table(number: usize) -> Result<Table, StructureError> {
    let inputs: &[usize] = if number == 4 {
        &TRUSS_INPUTS_4
    } else {
        &TRUSS_INPUTS_3
    };
    let modes = [12, 9, 6, 12][number - 1];
    let model = FemModel::collocated(truss().matrices()?, DMatrix::zeros(12, 12), inputs)?;
    let fem = frequencies_hz(&model.zeros()?);
    let modal = frequencies_hz(&model.modal(&vec![0.0; modes], modes)?.zeros()?);
    const FEM: [f64; 9] = [15.2, 18.3, 53.7, 64.9, 81.1, 88.7, 96.9, 100.6, 118.4];
    let fem_3 = |rows: &[usize]| {
        rows.iter()
            .map(|i| if *i < 9 { FEM[*i] } else { BLANK })
            .collect::<Vec<_>>()
    };
    let columns = |fem_column: &[f64], modal_column: &[f64], qz: &[f64]| -> Vec<Column> {
        vec![
            column("FEM model, theorem 2.1", fem_column, &fem),
            column("modal model, theorem 2.2", modal_column, &modal),
            printed_only("modal model, QZ algorithm of 1993", qz),
        ]
    };
    let none = 9;
    let (title, columns, verdict) = match number {
        1 => (
            "Transmission zeros of the truss, three inputs and outputs, 12 modes",
            columns(
                &fem_3(&[none, none, 0, 1, 2, 3, 4, 5, 6, 7, 8, none]),
                &[
                    BLANK, BLANK, 15.5, 18.4, 53.1, 65.0, 81.9, 88.8, 96.9, 101.0, 118.4, BLANK,
                ],
                &[
                    1.6, 2.1, 15.5, 18.4, 53.1, 65.0, 81.9, 88.8, 96.9, 101.0, 118.4, INFINITE,
                ],
            ),
            Verdict::Reproduced {
                first: 0.056,
                second: 0.83,
            },
        ),
        2 => (
            "Transmission zeros of the truss, three inputs and outputs, 9 modes",
            columns(
                &fem_3(&[0, 1, none, 2, 3, 4, 5, 6, 7, 8, none, none]),
                &[
                    15.6, 18.8, BLANK, 53.9, 65.1, BLANK, 88.4, 99.9, BLANK, BLANK, BLANK, BLANK,
                ],
                &[
                    15.6, 18.8, 46.1, 53.9, 65.1, BLANK, 88.4, 99.9, BLANK, BLANK, INFINITE,
                    INFINITE,
                ],
            ),
            Verdict::Reproduced {
                first: 0.056,
                second: 0.44,
            },
        ),
        3 => (
            "Transmission zeros of the truss, three inputs and outputs, 6 modes",
            columns(
                &fem_3(&[0, 1, none, 2, 3, 4, 5, 6, 7, 8, none, none]),
                &[
                    17.2, 20.5, BLANK, 62.0, BLANK, BLANK, BLANK, BLANK, BLANK, BLANK, BLANK, BLANK,
                ],
                &[
                    17.2, 20.5, 29.1, 62.0, BLANK, BLANK, BLANK, BLANK, BLANK, BLANK, INFINITE,
                    INFINITE,
                ],
            ),
            Verdict::Reproduced {
                first: 0.056,
                second: 0.44,
            },
        ),
        _ => (
            "Transmission zeros of the truss, four inputs and outputs, 12 modes",
            columns(
                &[
                    17.5, 29.0, BLANK, 60.7, 79.9, 82.3, 88.7, 99.6, 113.9, BLANK, BLANK, BLANK,
                ],
                &[
                    17.6, 29.1, BLANK, 60.3, 80.1, 81.9, 88.8, 100.0, 114.0, BLANK, BLANK, BLANK,
                ],
                &[
                    17.6, 29.1, 55.3, 60.3, 80.1, 81.9, 88.8, 100.0, 114.0, INFINITE, INFINITE,
                    INFINITE,
                ],
            ),
            Verdict::Reproduced {
                first: 0.056,
                second: 0.45,
            },
        ),
    };
    Ok(Table {
        number: format!("2.{number}"),
        title,
        rows: Vec::new(),
        columns,
        verdict,
        remark: QZ,
    })
}
