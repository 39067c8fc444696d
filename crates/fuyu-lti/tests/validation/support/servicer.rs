//! The servicer with two panels, joints locked, from the mass matrices in `flexible_panels_linear.json` (computed in Python from the URDF).

use fuyu_lti::{Matrix, Structure};

use super::*;

/// Axial inertia of each of the three wheels in kg m2.
const WHEEL: f64 = 0.2;

/// Mass matrix of the base with undeformed panels, from an entry of the fixture. `wheels`: the wheels turn freely under their motors, so their
/// axial inertia is not part of the plant.
pub fn base_mass(linear: &Value, wheels: bool) -> Matrix {
    let mut base = matrix(&linear["mass_matrix_base"]);
    if wheels {
        for i in 3..6 {
            base[(i, i)] -= WHEEL;
        }
    }
    base
}

/// Base (six coordinates, forces and torques in base axes) and eight panel modes; `linear` is the entry of the fixture `all`.
pub fn hybrid(all: &Value, linear: &Value, base: &Matrix) -> Structure {
    let one: Vec<f64> = list(&all["frequencies_hz"])
        .iter()
        .map(|f| f * std::f64::consts::TAU)
        .collect();
    Structure::hybrid(
        base,
        &matrix(&linear["P_base"]),
        &[one.clone(), one].concat(),
        &[number(&all["panel"]["zeta"]); 8],
    )
    .unwrap()
}

/// The same under torques only: three attitude angles and eight modes, with the translation, whose momentum stays zero, eliminated.
pub fn under_torques(free: &Structure) -> Structure {
    free.with_actuators(&[3, 4, 5])
        .unwrap()
        .without_free_coordinates(&[0, 1, 2])
        .unwrap()
}

/// The servicer under torques, without its wheels' axial inertia.
pub fn attitude(posture: &str, angle: &str) -> Structure {
    let all = fixture("flexible_panels_linear");
    let linear = &all["linear"][angle][posture];
    under_torques(&hybrid(&all, linear, &base_mass(linear, true)))
}

pub fn gains(p: f64, d: f64) -> (Matrix, Matrix) {
    (Matrix::identity(3, 3) * p, Matrix::identity(3, 3) * d)
}
