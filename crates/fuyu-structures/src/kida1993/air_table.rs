//! The air table of section 3.4 (Table 3.1) as a base with one flexible appendage.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use serde::Serialize;

use crate::{Appendage, StructureError};

/// Frequencies of Table 3.1 \[Hz\]; the first is the rigid-body mode.
const FREQUENCIES: [f64; 7] = [0.0, 1.15, 4.00, 4.17, 11.83, 13.65, 17.36];

/// Mode shapes of Table 3.1 at torque and angle \[kg^-1/2 m^-1\].
const SHAPES: [f64; 7] = [
    3.09e-1, -3.71e-1, -7.98e-2, 2.85e-2, 3.98e-3, -2.06e-1, -1.64e-3,
];

/// Damping ratio of the elastic modes \[-\].
const DAMPING: f64 = 5.0e-3;

/// The air table: an axis with a motor and an encoder, and a flexible panel.
#[derive(Clone, Debug, Serialize)]
pub struct AirTable {
    /// Frequencies of Table 3.1 \[Hz\], rigid-body mode first.
    pub frequencies_hz: [f64; 7],
    /// Mode shapes of Table 3.1 at the axis.
    pub shapes: [f64; 7],
    /// Moment of inertia of the whole about the axis, `1/φ₁²` \[kg m²\].
    pub inertia: f64,
    /// Frequencies with the axis held \[Hz\].
    pub constrained_hz: [f64; 6],
    /// Coupling of these modes with the rotation \[kg^1/2 m\], all positive.
    pub coupling: [f64; 6],
    /// Damping of the angle and the six constrained modes, 7 x 7, row by row: Table 3.1 has the same ratio for all unconstrained
    /// modes, which is not diagonal in the constrained ones.
    pub damping: [[f64; 7]; 7],
}

/// The air table, from Table 3.1: its constrained frequencies are the zeros of `Σ φ_i²/(s² + σ_i²)`, one between each pair of
/// successive poles, and the constrained mode k is the combination of unconstrained ones with amplitudes `φ_i/(σ_i² - Ω_k²)`.
pub fn air_table() -> AirTable {
    let squares = FREQUENCIES.map(|f| (f * std::f64::consts::TAU).powi(2));
    let mut table = AirTable {
        frequencies_hz: FREQUENCIES,
        shapes: SHAPES,
        inertia: SHAPES[0].powi(-2),
        constrained_hz: [0.0; 6],
        coupling: [0.0; 6],
        damping: [[0.0; 7]; 7],
    };
    // Columns: the unconstrained amplitudes of a unit angle, then those of each constrained mode.
    let mut T = DMatrix::zeros(7, 7);
    T[(0, 0)] = 1.0 / SHAPES[0];
    for k in 0..6 {
        let (square, differences) = zero_between(&squares, k);
        let amplitudes = DVector::from_fn(7, |i, _| SHAPES[i] / differences[i]);
        let norm = amplitudes.norm();
        table.constrained_hz[k] = square.sqrt() / std::f64::consts::TAU;
        // Row 0 of T with the normalised amplitudes, with the sign that makes it positive.
        table.coupling[k] = 1.0 / (square * norm);
        T.set_column(1 + k, &(amplitudes / -norm));
    }
    let modal = DMatrix::from_diagonal(&DVector::from_fn(7, |i, _| {
        2.0 * DAMPING * squares[i].sqrt()
    }));
    let damping = T.transpose() * modal * &T;
    table.damping = std::array::from_fn(|i| std::array::from_fn(|j| damping[(i, j)]));
    table
}

/// The root x of `Σ φ_i²/(σ_i² - x)` between the squares k and k + 1, by bisection to the last bit, and the differences `σ_i² - x`. The unknown
/// is the distance from the nearer of both squares, so that the smallest difference keeps all its digits.
fn zero_between(squares: &[f64; 7], k: usize) -> (f64, [f64; 7]) {
    let differences = |origin: f64, offset: f64| squares.map(|s| (s - origin) - offset);
    let value = |d: [f64; 7]| (0..7).map(|i| SHAPES[i].powi(2) / d[i]).sum::<f64>();
    let half = (squares[k + 1] - squares[k]) / 2.0;
    // The sum rises from minus to plus infinity between the squares.
    let nearer_to_lower = value(differences(squares[k], half)) > 0.0;
    let (origin, mut low, mut high) = if nearer_to_lower {
        (squares[k], 0.0, half)
    } else {
        (squares[k + 1], -half, 0.0)
    };
    for _ in 0..1100 {
        let middle = low + (high - low) / 2.0;
        if middle <= low || middle >= high {
            break;
        }
        if value(differences(origin, middle)) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    let offset = if nearer_to_lower { high } else { low };
    (origin + offset, differences(origin, offset))
}

impl AirTable {
    /// The flexible panel as an appendage of a base that turns about z, for the multibody equations. The panel as a rigid body
    /// has mass and moments of inertia zero here: they are part of the base's.
    ///
    /// # Errors
    /// Numerical failure, which does not occur with these data.
    pub fn appendage(&self) -> Result<Appendage, StructureError> {
        let frequencies = self.constrained_hz.map(|f| f * std::f64::consts::TAU);
        let mut P = DMatrix::zeros(6, 6);
        (0..6).for_each(|k| P[(k, 5)] = self.coupling[k]);
        let rigid = (0.0, Vector3::zeros(), Matrix3::zeros());
        let mut appendage =
            Appendage::from_coupling("air_table_panel", rigid, &frequencies, &[0.0; 6], &P)?;
        appendage.modal_damping = DMatrix::from_fn(6, 6, |i, j| self.damping[1 + i][1 + j]);
        appendage.check()?;
        Ok(appendage)
    }
}
