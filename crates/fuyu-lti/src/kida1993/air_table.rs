//! The one-axis air table with two flexible panels (section 3.4, Table 3.1).

use crate::matrix::{Matrix, ascending_eigen, full_svd, identity, normal_modes};
use crate::{LtiError, StateSpace, Structure};

/// Frequencies of the unconstrained modes in Hz (Table 3.1).
pub const FREQUENCIES_HZ: [f64; 7] = [0.0, 1.15, 4.00, 4.17, 11.83, 13.65, 17.36];

/// Mode shapes at the table's axis in kg^-1/2 m^-1 (Table 3.1).
pub const SHAPES: [f64; 7] = [
    3.09e-1, -3.71e-1, -7.98e-2, 2.85e-2, 3.98e-3, -2.06e-1, -1.64e-3,
];

/// Damping ratios of the vibration modes (Table 3.1).
pub const DAMPING: f64 = 0.005;

/// Largest torque of the motor in N m (section 3.4 (b)).
pub const TORQUE_LIMIT: f64 = 0.37;

/// Sampling time of the experiments in s.
pub const SAMPLING_TIME: f64 = 0.01;

/// The structure with its first `modes` modes, 1 to 7; actuator and sensor: torque and angle of the table.
pub fn structure(modes: usize) -> Result<Structure, LtiError> {
    if !(1..=7).contains(&modes) {
        return Err(LtiError::Range {
            what: "the number of modes of the air table".into(),
            value: modes as f64,
            expected: "between 1 and 7",
        });
    }
    let frequencies: Vec<f64> = FREQUENCIES_HZ[..modes]
        .iter()
        .map(|f| std::f64::consts::TAU * f)
        .collect();
    Structure::modal(
        &frequencies,
        &[DAMPING; 7][..modes],
        &Matrix::from_column_slice(modes, 1, &SHAPES[..modes]),
    )
}

/// From torque in N m to angle in rad with the first `modes` modes; states `[eta; eta']` (eqs. (3.3), (3.4)).
pub fn plant(modes: usize) -> Result<StateSpace, LtiError> {
    structure(modes)?.displacement_system()
}

/// The same plant as a rigid base with one appendage, eqs. (3.17), (3.18).
#[derive(Debug, Clone)]
pub struct Hybrid {
    /// Moment of inertia of the whole in kg m2: `1 / phi_1^2`. (Eq. (A.1) of chapter 2 prints y' squared where y squared is meant.)
    pub inertia: f64,
    /// Frequencies in Hz with the table held.
    pub constrained_hz: [f64; 6],
    /// Coupling of each constrained mode with the rotation in kg^1/2 m, positive.
    pub coupling: [f64; 6],
    /// Damping matrix in the coordinates `[theta; mu]`, 7 x 7: that of Table 3.1, which is not diagonal here.
    pub damping: Matrix,
}

impl Hybrid {
    /// The structure of this hybrid model. Its modes are those of Table 3.1.
    pub fn structure(&self) -> Result<Structure, LtiError> {
        let mut mass = identity(7);
        mass[(0, 0)] = self.inertia;
        let mut stiffness = Matrix::zeros(7, 7);
        for i in 0..6 {
            mass[(0, i + 1)] = self.coupling[i];
            mass[(i + 1, 0)] = self.coupling[i];
            stiffness[(i + 1, i + 1)] = (std::f64::consts::TAU * self.constrained_hz[i]).powi(2);
        }
        Structure::new(
            mass,
            self.damping.clone(),
            stiffness,
            Matrix::from_fn(7, 1, |i, _| if i == 0 { 1.0 } else { 0.0 }),
        )
    }
}

/// Hybrid model from the modal one: the constrained modes are those of the modal coordinates on which the angle `phi' eta` vanishes, and `eta = r theta + V mu` with the rigid mode r.
pub fn hybrid() -> Result<Hybrid, LtiError> {
    let table = structure(7)?;
    let (_, _, v) = full_svd(&table.input().transpose())?;
    let held = v.columns(1, 6).into_owned();
    let (squares, vectors) = ascending_eigen(&(held.transpose() * table.stiffness() * &held))?;
    let modes = held * vectors;
    let rigid = 1.0 / SHAPES[0];
    let mut basis = Matrix::zeros(7, 7);
    basis[(0, 0)] = rigid;
    let (mut constrained_hz, mut coupling) = ([0.0; 6], [0.0; 6]);
    for i in 0..6 {
        let sign = modes[(0, i)].signum();
        basis.column_mut(i + 1).copy_from(&(modes.column(i) * sign));
        coupling[i] = rigid * modes[(0, i)] * sign;
        constrained_hz[i] = squares[i].sqrt() / std::f64::consts::TAU;
    }
    Ok(Hybrid {
        inertia: rigid * rigid,
        constrained_hz,
        coupling,
        damping: basis.transpose() * table.damping() * basis,
    })
}

/// One row of Table 3.1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModeRow {
    /// Frequency in Hz.
    pub frequency_hz: f64,
    /// Shape at the axis, kg^-1/2 m^-1.
    pub shape: f64,
}

/// Table 3.1 computed from a hybrid model. The first row is the rigid mode; shapes of the others have the printed sign.
pub fn table_3_1(model: &Hybrid) -> Result<Vec<ModeRow>, LtiError> {
    let s = model.structure()?;
    let (squares, shapes) = normal_modes("the mass matrix", s.mass(), s.stiffness())?;
    Ok((0..7)
        .map(|i| ModeRow {
            // The eigenvalue of the rigid mode is zero but for rounding.
            frequency_hz: if i == 0 {
                0.0
            } else {
                squares[i].max(0.0).sqrt() / std::f64::consts::TAU
            },
            shape: shapes[(0, i)].abs() * SHAPES[i].signum(),
        })
        .collect())
}
